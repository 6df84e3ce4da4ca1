import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from labcdp.chain import Context, Optics, Signal, ThesisWindscreen, Windscreen

CONTEXT = Context("D65", pixel_pitch_m=3.45e-6)
maps = arrays(np.float64, (3, 5), elements=st.floats(0, 1e5))
transmittances = st.floats(0.01, 1)
glares = st.floats(0, 2)


def scene_signal(luminance_cd_m2: np.ndarray, shares: np.ndarray | None = None) -> Signal:
    return Signal(np.asarray(luminance_cd_m2, float), "luminance", lambda values: values, shares)


def test_glare_of_levels_is_of_the_mean_by_their_shares() -> None:
    shares = np.array([[0.25, 0.75], [0.5, 0.5]])
    behind = Windscreen(0.5, 1.0).process(scene_signal([[1.0, 3.0], [1.0, 3.0]], shares), CONTEXT)
    np.testing.assert_allclose(behind.values, [[1.75, 2.75], [1.5, 2.5]], rtol=1e-15)
    np.testing.assert_array_equal(behind.shares, shares)


@given(scene=maps, transmittance=transmittances, glare=glares)
def test_inverse_of_a_windscreen_leaves_the_glare_unless_it_is_subtracted(
    scene: np.ndarray, transmittance: float, glare: float
) -> None:
    for subtracted, left in ((True, 0.0), (False, glare * scene.mean())):
        behind = Windscreen(transmittance, glare, subtracted).process(scene_signal(scene), CONTEXT)
        tolerance = 1e-9 * scene.max() + 1e-300
        np.testing.assert_allclose(behind.luminance_cd_m2, scene + left, rtol=1e-9, atol=tolerance)


@given(scene=maps, transmittance=transmittances, fraction=glares)
def test_the_thesis_way_back_leaves_a_known_error(scene: np.ndarray, transmittance: float, fraction: float) -> None:
    behind = ThesisWindscreen(transmittance, fraction).process(scene_signal(scene), CONTEXT)
    glare = fraction * scene.mean()
    expected = transmittance * scene + glare * (transmittance - 1 / transmittance)
    np.testing.assert_allclose(
        behind.luminance_cd_m2, expected, rtol=1e-9, atol=1e-11 * scene.max() / transmittance + 1e-300
    )


@given(scene=maps, focal_length_m=st.none() | st.floats(1e-3, 1.0), magnification=st.floats(0, 2))
def test_optics_are_undone_by_their_way_back(
    scene: np.ndarray, focal_length_m: float | None, magnification: float
) -> None:
    image = Optics(1.6, 0.8, focal_length_m, magnification).process(scene_signal(scene), CONTEXT)
    np.testing.assert_allclose(image.luminance_cd_m2, scene, rtol=1e-12, atol=1e-300)


@given(scene=maps)
def test_ways_back_compose(scene: np.ndarray) -> None:
    behind = Windscreen(0.9, 0.3, glare_subtracted=True).process(scene_signal(scene), CONTEXT)
    image = Optics(2.0, 0.9, focal_length_m=6e-3).process(behind, CONTEXT)
    np.testing.assert_allclose(image.luminance_cd_m2, scene, rtol=1e-9, atol=1e-9 * scene.max() + 1e-300)
