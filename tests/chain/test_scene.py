import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.chain import Checkerboard, Flat, Patch, PatchScene, Scene, StepChart, luminance_map, with_patches
from labcdp.core.errors import InputError


def test_patches_lie_over_any_map_and_leave_it_unchanged() -> None:
    background = np.arange(6, dtype=np.float32).reshape(2, 3)
    scene = with_patches(background, [Patch(0, 0, 1, 1, 9.0)])
    np.testing.assert_array_equal(scene, [[9, 1, 2], [3, 4, 5]])
    assert background[0, 0] == 0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1.0, 2.0], r"non-empty 2-D map of luminance in cd/m\^2, got the shape \(2,\)"),
        (np.empty((0, 3)), r"got the shape \(0, 3\)"),
        ([[1.0, -2.0]], r"luminance from -2 to 1 cd/m\^2: give numbers from 0 to 1e\+12"),
        ([[1.0, np.nan]], r"luminance from nan to nan cd/m\^2"),
        ([[1.0, np.inf]], r"luminance from 1 to inf cd/m\^2"),
        ([[1.0, 1e39]], r"luminance from 1 to inf cd/m\^2"),  # too large for float32
        ([[1.0, 2e12]], r"luminance from 1 to 2e\+12 cd/m\^2"),
    ],
)
def test_what_is_not_a_scene_is_refused(values: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        luminance_map(values)  # type: ignore[arg-type]


def test_patch_outside_the_scene_is_refused() -> None:
    patch = Patch(x=6, y=2, width=5, height=2, luminance_cd_m2=3.0)
    with pytest.raises(InputError, match=r"a patch spans x 6 to 11, y 2 to 4, but the scene is 10 x 8 pixels"):
        PatchScene(10, 8, 1.0, (patch,))


sides = st.integers(1, 23)
luminances = st.floats(0, 1e6)


@st.composite
def patches_inside(draw: st.DrawFn, width: int, height: int) -> Patch:
    x, y = draw(st.integers(0, width - 1)), draw(st.integers(0, height - 1))
    return Patch(
        x, y, draw(st.integers(1, width - x)), draw(st.integers(1, height - y)), luminance_cd_m2=draw(luminances)
    )


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """Any scene of any size, sizes that are no multiple of the squares or stripes among them."""
    kind = draw(st.sampled_from(["flat", "checkerboard", "step chart", "patches"]))
    width, height = draw(sides), draw(sides)
    if kind == "flat":
        return Flat(width, height, draw(luminances))
    if kind == "step chart":
        return StepChart(width, height, tuple(draw(st.lists(luminances, min_size=1, max_size=width))))
    if kind == "patches":
        patches = draw(st.lists(patches_inside(width, height), max_size=4))
        return PatchScene(width, height, draw(luminances), tuple(patches))
    width = max(width, 2)
    return Checkerboard(
        width, height, draw(luminances), draw(st.floats(1e-3, 99)), draw(st.integers(1, max(width, height) - 1))
    )


@given(scene=scenes())
def test_map_regions_levels_and_pairs_agree(scene: Scene) -> None:
    image, regions = scene.luminance_map(), scene.regions()
    assert image.dtype == np.float32
    assert {image.shape} | {mask.shape for mask in regions.values()} == {scene.shape}
    assert (sum(mask.astype(int) for mask in regions.values()) == 1).all()
    levels = {level.name: level for level in scene.levels()}
    assert list(levels) == list(regions)
    for name, level in levels.items():
        np.testing.assert_array_equal(image[regions[name]], np.float32(level.luminance_cd_m2))
        assert level.share == pytest.approx(regions[name].mean(), rel=1e-12)
    assert all(levels[dark].luminance_cd_m2 <= levels[bright].luminance_cd_m2 for dark, bright in scene.pairs())


def test_checkerboard_is_dark_upper_left_and_ends_within_a_square() -> None:
    scene = Checkerboard(width=5, height=3, luminance_cd_m2=10.0, contrast=0.5, square_px=2)
    expected = [[10, 10, 15, 15, 10], [10, 10, 15, 15, 10], [15, 15, 10, 10, 15]]
    np.testing.assert_array_equal(scene.luminance_map(), expected)
    assert scene.pairs() == (("dark", "bright"),)


def test_step_chart_has_stripes_of_equal_width_up_to_a_column() -> None:
    scene = StepChart(width=8, height=2, luminances_cd_m2=(1.0, 4.0, 2.0))
    np.testing.assert_array_equal(scene.luminance_map(), [[1, 1, 1, 4, 4, 4, 2, 2]] * 2)
    assert [level.share for level in scene.levels()] == [3 / 8, 3 / 8, 2 / 8]


def test_pairs_of_a_step_chart_are_neighbours_that_differ() -> None:
    scene = StepChart(8, 1, (1.0, 4.0, 4.0, 2.0))
    assert scene.pairs() == (("step 1", "step 2"), ("step 4", "step 3"))


def test_pairs_of_one_patch_are_with_the_background() -> None:
    assert PatchScene(4, 4, 5.0, (Patch(0, 0, 1, 1, 2.0),)).pairs() == (("patch 1", "background"),)


def test_pairs_of_patches_are_neighbours_in_luminance() -> None:
    patches = tuple(Patch(x, 0, 1, 1, luminance) for x, luminance in enumerate([30.0, 10.0, 20.0, 20.0]))
    scene = PatchScene(6, 2, 1.0, patches)
    assert scene.pairs() == (("patch 2", "patch 3"), ("patch 4", "patch 1"))


def test_a_patch_under_another_is_not_a_region_and_in_no_pair() -> None:
    scene = PatchScene(3, 3, 1.0, (Patch(1, 1, 1, 1, 7.0), Patch(1, 1, 2, 2, 9.0)))
    assert list(scene.regions()) == ["background", "patch 2"]
    assert scene.pairs() == (("background", "patch 2"),)
