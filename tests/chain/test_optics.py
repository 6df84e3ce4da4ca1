"""Windscreen and lens with their inverse, and the image of a lens with a point spread, against closed forms."""

from dataclasses import replace
from math import asin, atan, cos, hypot, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import quad
from scipy.stats import norm

from labcdp.chain import (
    Chain,
    Checkerboard,
    Context,
    ImageScene,
    Optics,
    ThesisWindscreen,
    Windscreen,
    preset_text,
)
from labcdp.chain.point_spread import diffraction_mtf, disc_mtf, gaussian_mtf
from labcdp.chain.predict.chain import known_transitions
from labcdp.chain.signal import scene_signal
from labcdp.core.errors import InputError
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_run

PITCH_M = 3e-6
SHARP = Optics(2.0, 0.9)
LENSES = {
    "diffraction": replace(SHARP, diffraction_nm=550.0),
    "diffraction at f/8": replace(SHARP, f_number=8.0, diffraction_nm=550.0),
    "gaussian": replace(SHARP, blur_sigma_m=1.2e-6),
    "slight gaussian": replace(SHARP, blur_sigma_m=0.3e-6),
    "defocus": replace(SHARP, defocus_disc_m=7e-6),
    "measured": replace(SHARP, mtf=((0, 1.0), (60, 0.7), (180, 0.2), (320, 0.0))),
    "all": replace(SHARP, diffraction_nm=550.0, blur_sigma_m=0.5e-6, defocus_disc_m=2e-6, mtf=((0, 1.0), (400, 0.5))),
}
of_lenses = pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))


@pytest.mark.parametrize("f_number", [0.5, 2.0, 8.0])
def test_axial_illuminance_is_the_integral_over_the_cone_of_light(f_number):
    # A lens that obeys the sine condition fills the cone with half angle asin(1 / 2N) with the scene's luminance.
    cone, _ = quad(lambda theta: np.cos(theta) * 2 * pi * np.sin(theta), 0, asin(1 / (2 * f_number)))
    assert Optics(f_number, 1.0).axial_illuminance_per_cd_m2 == pytest.approx(cone, rel=1e-9)


@pytest.mark.parametrize("magnification", [0.1, 1.0, 3.0])
def test_all_light_that_enters_the_lens_is_in_the_image(magnification):
    # A small lamp (1 + 1/m) f in front of a thin lens of the diameter f / N: its flux L A pi r^2 / d^2 falls on A m^2.
    lens, distance_m = Optics(100.0, 1.0, 0.05, magnification), 0.05 * (1 + 1 / magnification)
    pupil_m2 = pi * (0.05 / 100 / 2) ** 2
    assert lens.axial_illuminance_per_cd_m2 == pytest.approx(pupil_m2 / distance_m**2 / magnification**2, rel=1e-12)


def test_vignetting_is_cos_4_of_the_angle():
    lens = Optics(2.0, 0.9, focal_length_m=6e-3)
    scene = scene_signal(np.full((602, 1002), 10.0))
    illuminance = lens.process(scene, Context("D65", pixel_pitch_m=PITCH_M)).values
    for row, column in ((0, 0), (0, 1000), (300, 20), (601, 1001)):
        radius_m = hypot(row - 300.5, column - 500.5) * PITCH_M
        expected = 10 * lens.axial_illuminance_per_cd_m2 * cos(atan(radius_m / 6e-3)) ** 4
        assert illuminance[row, column] == pytest.approx(expected, rel=1e-12)


def test_glare_of_levels_is_of_the_mean_by_their_shares():
    shares = np.array([[0.25, 0.75], [0.5, 0.5]])
    behind = Windscreen(0.5, 1.0).process(scene_signal(np.array([[1.0, 3.0], [1.0, 3.0]]), shares), Context("D65"))
    np.testing.assert_allclose(behind.values, [[1.75, 2.75], [1.5, 2.5]], rtol=1e-15)


@given(
    scene=arrays(np.float64, (3, 5), elements=st.floats(0, 1e5)),
    transmittance=st.floats(0.01, 1),
    fraction=st.floats(0, 2),
    focal_length_m=st.none() | st.floats(1e-3, 1.0),
    magnification=st.floats(0, 2),
)
def test_the_inverse_through_lens_and_windscreen_leaves_the_glare_unless_it_is_subtracted(
    scene, transmittance, fraction, focal_length_m, magnification
):
    context, glare = Context("D65", pixel_pitch_m=3.45e-6), fraction * scene.mean()
    lens = Optics(1.6, 0.8, focal_length_m, magnification)
    of_thesis = transmittance * scene + glare * (transmittance - 1 / transmittance)
    for windscreen, expected in (
        (Windscreen(transmittance, fraction, glare_subtracted=True), scene),
        (Windscreen(transmittance, fraction), scene + glare),
        (ThesisWindscreen(transmittance, fraction), of_thesis),
    ):
        behind = windscreen.process(scene_signal(scene), context)
        np.testing.assert_allclose(behind.values, transmittance * (scene + glare), rtol=1e-12)
        tolerance = 1e-11 * scene.max() / transmittance + 1e-300
        for signal in (behind, lens.process(behind, context)):
            np.testing.assert_allclose(signal.luminance_cd_m2, expected, rtol=1e-9, atol=tolerance)


def test_diffraction_is_the_overlap_of_two_apertures():
    # The OTF of incoherent light is the pupil's autocorrelation; here of a disc of 401 cells.
    x = np.arange(-512, 512)
    pupil = (x[:, None] ** 2 + x**2 <= 200.5**2).astype(float)
    overlap = np.fft.ifft2(np.abs(np.fft.fft2(pupil)) ** 2).real[0]
    shift = np.arange(0, 402, 20)
    frequency_per_m = shift / 401 / (550e-9 * 2.8)
    np.testing.assert_allclose(diffraction_mtf(frequency_per_m, 550e-9, 2.8), overlap[shift] / overlap[0], atol=2e-3)


@pytest.mark.parametrize("frequency_per_m", [0.0, 3e4, 1.7e5, 4e5])
def test_transfer_functions_are_those_of_their_line_spreads(frequency_per_m):
    sigma_m, radius_m = 1.1e-6, 2.5e-6

    def transformed(line_spread, half_m):
        found, _ = quad(lambda x: line_spread(x) * np.cos(2 * pi * frequency_per_m * x), -half_m, half_m, limit=200)
        return float(found)

    gaussian = transformed(lambda x: norm.pdf(x, scale=sigma_m), 8 * sigma_m)
    disc = transformed(lambda x: 2 * np.sqrt(max(radius_m**2 - x**2, 0)) / (pi * radius_m**2), radius_m)
    frequency = np.array([frequency_per_m])
    assert gaussian_mtf(frequency, sigma_m)[0] == pytest.approx(gaussian, abs=1e-6)
    assert disc_mtf(frequency, 2 * radius_m)[0] == pytest.approx(disc, abs=1e-6)


@of_lenses
@pytest.mark.parametrize("square_px", [1, 2])
def test_modulation_of_a_checkerboard_is_the_mtf_and_the_pixels_at_its_harmonics(lens, square_px):
    scene = Checkerboard(160, 160, 1.0, 1.0, square_px).luminance_map().astype(float)
    image = lens.spread(scene, PITCH_M)[64:96, 64:96]
    # A square wave has the odd harmonics m with 4 / (pi m), and a pixel averages over its side.
    order = np.arange(1, 400, 2)
    phase = np.sin(pi * order / (2 * square_px)) if square_px > 1 else np.sin(pi * order / 2)
    amplitude = 4 / (pi * order) * np.sinc(order / (2 * square_px)) * phase
    transfer = lens.transfer(np.hypot(order[:, None], order) / (2 * square_px * PITCH_M))
    modulation = float(amplitude @ transfer @ amplitude)
    assert image.mean() == pytest.approx(1.5, rel=1e-6)
    assert np.abs(image - 1.5) == pytest.approx(abs(modulation) / 2, abs=1.5e-3)


@of_lenses
def test_light_is_spread_and_not_lost(lens):
    scene = np.zeros((300, 300))
    scene[150, 150] = 7.0
    image = lens.spread(scene, PITCH_M)
    assert image.sum() == pytest.approx(7.0, rel=2e-3)
    assert image.min() >= 0
    np.testing.assert_allclose(image, image.T, atol=1e-9)
    np.testing.assert_allclose(lens.spread(np.full((20, 30), 4.0), PITCH_M), 4.0, rtol=1e-9)


@pytest.mark.parametrize("sigma_px", [0.3, 3.0, 40.0])
def test_the_image_of_a_line_is_its_blur_averaged_over_line_and_pixel(sigma_px):
    scene, x = np.zeros((1, 801)), np.arange(-401, 402) / sigma_px
    scene[0, 400] = 1.0
    image = replace(SHARP, blur_sigma_m=sigma_px * PITCH_M).spread(scene, PITCH_M)[0]
    # Of the normal distribution, integrated twice.
    expected = np.diff(sigma_px * (x * norm.cdf(x) + norm.pdf(x)), 2)
    np.testing.assert_allclose(image, expected, atol=1e-3 * expected.max())


@pytest.mark.parametrize("square_px", [0.25, 0.5, 1, 2.5])
def test_pixels_see_the_mean_of_the_samples(square_px):
    board = Checkerboard(40, 40, 1.0, 1.0, square_px, oversampling=4)
    seen = SHARP.spread(board.luminance_map(), None, 4)
    np.testing.assert_allclose(seen, board.luminance_map().reshape(40, 4, 40, 4).mean(axis=(1, 3)))
    assert sum(level.share for level in board.levels()) == pytest.approx(1)
    assert board.levels()[1].share == pytest.approx(board.is_bright().mean())


def test_image_scene_is_sampled_finer_than_the_pixels(tmp_path):
    values = np.random.default_rng(1).uniform(1, 9, (60, 80)).astype(np.float32)
    np.save(tmp_path / "fine.npy", values)
    scene = ImageScene(tmp_path / "fine.npy", 1.0, {"left": (0, 0, 5, 10)}, oversampling=4)
    chain = replace(Chain.load("manta-g505"), scene=scene, before=(("optics", SHARP),), sensors=(), settings=None)
    run = chain.run()
    np.testing.assert_allclose(run["optics"].luminance_cd_m2, values.reshape(15, 4, 20, 4).mean(axis=(1, 3)), rtol=1e-6)
    (row,) = evaluate_run(run).stages[0].regions
    assert row.true_cd_m2 == pytest.approx(values[:40, :20].mean(), rel=1e-6)


@pytest.mark.parametrize("preset", ["split-pixel", "dual-gain", "lofic", "small-pixel-hdr"])
def test_a_veil_in_cd_m2_lowers_the_contrast_of_a_camera_behind_a_windscreen(preset):
    """It is added whatever the luminance of the scene is."""
    chain = Chain.load(preset).with_(scene__width=32, scene__height=24, scene__square_px=4)
    for luminance in (5.0, 500.0):
        run = chain.with_(scene__luminance_cd_m2=luminance, scene__contrast=0.8, windscreen__glare_cd_m2=20.0).run()
        behind = np.unique(run["windscreen"].values)
        np.testing.assert_allclose(behind, [luminance + 20, 1.8 * luminance + 20], rtol=1e-6)
        known = chain.with_(
            scene__luminance_cd_m2=luminance, windscreen__glare_cd_m2=20.0, windscreen__glare_subtracted=True
        )
        signal = known.run()["windscreen"]
        np.testing.assert_allclose(np.unique(signal.to_luminance(signal.values)), [luminance, 2 * luminance], rtol=1e-5)
    neutral = chain.run()
    np.testing.assert_array_equal(neutral["windscreen"].values, neutral["scene"].values)


def test_a_camera_that_subtracts_a_veil_is_no_linear_one():
    text = preset_text("imx250").replace("[optics]", "[windscreen]\ntransmittance = 1.0\nglare_cd_m2 = 3.0\n[optics]")
    chain = Chain.from_toml(text)
    camera = chain.with_(windscreen__glare_subtracted=True).camera()
    with pytest.raises(InputError, match="glare_cd_m2 of 3 is to be subtracted"):
        camera.responsivity_dn_s_cd_m2()
    assert chain.camera().responsivity_dn_s_cd_m2() > 0


def test_a_sensor_changes_exposure_at_a_lower_luminance_behind_a_veil():
    chain = Chain.load("dual-gain").with_(scene__width=32, scene__height=24, scene__square_px=4)
    (without,), (behind,) = (known_transitions(chain.with_(windscreen__glare_cd_m2=veil), None) for veil in (0.0, 7.0))
    assert behind == pytest.approx(without - 7.0)
