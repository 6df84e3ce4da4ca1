"""The image of a lens with a point spread, against closed forms."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from labcdp.chain import Chain, Checkerboard, ImageScene, Optics, PatchScene, Scene, StepChart
from labcdp.chain.point_spread import diffraction_mtf, disc_mtf, gaussian_mtf
from labcdp.chain.predict.chain import predict_chain
from labcdp.chain.scene.scene import Patch
from labcdp.core.errors import ConfigurationError, InputError
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


def of_lenses() -> Any:
    return pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))


def test_diffraction_is_the_overlap_of_two_apertures() -> None:
    # The OTF of incoherent light is the pupil's autocorrelation; here of a disc of 401 cells.
    x = np.arange(-512, 512)
    pupil = (x[:, None] ** 2 + x**2 <= 200.5**2).astype(float)
    overlap = np.fft.ifft2(np.abs(np.fft.fft2(pupil)) ** 2).real[0]
    shift = np.arange(0, 402, 20)
    frequency_per_m = shift / 401 / (550e-9 * 2.8)
    np.testing.assert_allclose(diffraction_mtf(frequency_per_m, 550e-9, 2.8), overlap[shift] / overlap[0], atol=2e-3)


@pytest.mark.parametrize("frequency_per_m", [0.0, 3e4, 1.7e5, 4e5])
def test_transfer_functions_are_those_of_their_line_spreads(frequency_per_m: float) -> None:
    sigma_m, radius_m = 1.1e-6, 2.5e-6

    def transformed(line_spread: Any, half_m: float) -> float:
        found, _ = quad(lambda x: line_spread(x) * np.cos(2 * pi * frequency_per_m * x), -half_m, half_m, limit=200)
        return float(found)

    gaussian = transformed(lambda x: norm.pdf(x, scale=sigma_m), 8 * sigma_m)
    disc = transformed(lambda x: 2 * np.sqrt(max(radius_m**2 - x**2, 0)) / (pi * radius_m**2), radius_m)
    frequency = np.array([frequency_per_m])
    assert gaussian_mtf(frequency, sigma_m)[0] == pytest.approx(gaussian, abs=1e-6)
    assert disc_mtf(frequency, 2 * radius_m)[0] == pytest.approx(disc, abs=1e-6)


@of_lenses()
@pytest.mark.parametrize("square_px", [1, 2])
def test_modulation_of_a_checkerboard_is_the_mtf_and_the_pixels_at_its_harmonics(lens: Optics, square_px: int) -> None:
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


@of_lenses()
def test_light_is_spread_and_not_lost(lens: Optics) -> None:
    scene = np.zeros((300, 300))
    scene[150, 150] = 7.0
    image = lens.spread(scene, PITCH_M)
    assert image.sum() == pytest.approx(7.0, rel=2e-3)
    assert image.min() >= 0
    np.testing.assert_allclose(image, image.T, atol=1e-9)
    np.testing.assert_allclose(lens.spread(np.full((20, 30), 4.0), PITCH_M), 4.0, rtol=1e-9)


@pytest.mark.parametrize(("square_px", "contrast"), [(0.25, 0.0), (0.5, 0.0), (1, 1.0), (2.5, None)])
def test_pixels_see_the_mean_of_the_samples(square_px: float, contrast: float | None) -> None:
    board = Checkerboard(40, 40, 1.0, 1.0, square_px, oversampling=4)
    seen = SHARP.spread(board.luminance_map(), None, 4)
    np.testing.assert_allclose(seen, board.luminance_map().reshape(40, 4, 40, 4).mean(axis=(1, 3)))
    if contrast is not None:
        assert seen.max() / seen.min() - 1 == pytest.approx(contrast)
    assert sum(level.share for level in board.levels()) == pytest.approx(1)
    assert board.levels()[1].share == pytest.approx(board.is_bright().mean())


def camera(scene: Scene, lens: Optics, exposure_s: float = 0.02) -> Chain:
    height, width = scene.shape
    size = {"sensor.width": width, "sensor.height": height, "scene.square_px": 8}
    chain = Chain.load("manta-g505").with_(**size, **{"exposure.exposure_s": exposure_s})
    return replace(chain, scene=scene, before=(("optics", lens),))


@of_lenses()
@pytest.mark.parametrize(
    "scene",
    [
        Checkerboard(96, 96, 20.0, 0.6, 1),
        Checkerboard(96, 96, 20.0, 0.6, 4),
        Checkerboard(96, 96, 20.0, 0.6, 2.5, oversampling=2),
        StepChart(96, 96, (10.0, 14.0, 20.0, 40.0)),
        PatchScene(96, 96, 30.0, (Patch(10, 10, 9, 7, 20.0), Patch(40, 40, 12, 12, 26.0))),
    ],
    ids=["pixels", "squares", "fractions", "steps", "patches"],
)
def test_exact_and_simulated_agree(scene: Scene, lens: Optics) -> None:
    chain = camera(scene, lens)
    stage = evaluate_run(chain.run(seed=5)).stages[-1]
    pair = stage.pairs[0]
    exact = predict_chain(chain, contrast=pair.true_contrast)
    assert pair.cdp is not None
    # The fixed pattern is part of both; five standard errors, and the classes of the mixed pixels.
    assert exact.cdp[0] == pytest.approx(pair.cdp.cdp, abs=5 * pair.cdp.standard_error + 2e-3)
    regions = scene.regions()
    rows = {row.region: row.luminance_snr.value**2 * regions[row.region].sum() for row in stage.regions}
    sigma = (1 + pair.mean_contrast) * sqrt(1 / rows[pair.dark] + 1 / rows[pair.bright])
    assert exact.mean_contrast[0] == pytest.approx(pair.mean_contrast, abs=5 * sigma + 1e-4)


def test_image_scene_is_sampled_finer_than_the_pixels(tmp_path: Path) -> None:
    values = np.random.default_rng(1).uniform(1, 9, (60, 80)).astype(np.float32)
    np.save(tmp_path / "fine.npy", values)
    scene = ImageScene(tmp_path / "fine.npy", 1.0, {"left": (0, 0, 5, 10), "right": (10, 0, 5, 10)}, oversampling=4)
    assert scene.shape == (15, 20)
    chain = replace(camera(scene, SHARP), sensors=(), settings=None)
    seen = chain.run()["optics"].luminance_cd_m2
    np.testing.assert_allclose(seen, values.reshape(15, 4, 20, 4).mean(axis=(1, 3)), rtol=1e-6)
    rows = {row.region: row for row in evaluate_run(chain.run()).stages[0].regions}
    assert rows["left"].true_cd_m2 == pytest.approx(values[:40, :20].mean(), rel=1e-6)
    with pytest.raises(InputError, match="80 x 60 values, which 7 samples on each side of a pixel do not divide"):
        _ = replace(scene, oversampling=7).shape


def test_point_spread_needs_the_pixel_pitch() -> None:
    chain = camera(Checkerboard(20, 15, 1.0, 1.0), LENSES["gaussian"])
    with pytest.raises(InputError, match="the point spread needs the pixel pitch: add a sensor"):
        replace(chain, sensors=(), settings=None).run()
    with pytest.raises(ConfigurationError, match=r"optics.mtf is \[\[0.0, 0.5\]\]: give pairs"):
        chain.with_(optics__mtf=[[0, 0.5]])
