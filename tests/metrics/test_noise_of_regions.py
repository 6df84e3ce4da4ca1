from math import sqrt

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from labcdp.core.luminance import LuminanceMap
from labcdp.core.roi import Roi
from labcdp.metrics import variance_inflation
from labcdp.metrics.regions.pair import evaluate_pair

SIZES, SMOOTHING_PX = (30, 60, 100, 150), (0.0, 0.6, 1.2, 2.0, 3.0)
REPEATS = {30: 100, 60: 60, 100: 30, 150: 30}


def _noise(rng, size, smoothing_px):
    """Noise of standard deviation 1, cut from a larger field."""
    margin = int(6 * smoothing_px) + 1
    impulse = np.zeros((41, 41))
    impulse[20, 20] = 1
    kernel = gaussian_filter(impulse, smoothing_px) if smoothing_px else impulse
    white = rng.normal(size=(size + 2 * margin,) * 2)
    smooth = gaussian_filter(white, smoothing_px) if smoothing_px else white
    return smooth[margin:-margin, margin:-margin] / sqrt(np.square(kernel).sum())


def _covers(noise):
    """Whether the 95 % interval of the mean of a whole image has 0 in it."""
    mask = np.ones(noise.shape, dtype=bool)
    uncertainty = noise.std(ddof=1) * sqrt(variance_inflation(noise, mask) / noise.size)
    return abs(noise.mean()) <= 1.96 * uncertainty, uncertainty


def test_intervals_of_means_cover_the_truth_however_far_the_noise_reaches():
    """Each case by itself, and all of them together: 3 sigma below 95 %."""
    rng = np.random.default_rng(12)
    all_covered = []
    for size in SIZES:
        for smoothing_px in SMOOTHING_PX:
            found = [_covers(_noise(rng, size, smoothing_px)) for _ in range(REPEATS[size])]
            covered = [covers for covers, _ in found]
            all_covered += covered
            assert np.mean(covered) >= 0.95 - 3 * sqrt(0.95 * 0.05 / len(covered)), (size, smoothing_px)
            # Smoothing by a Gaussian of s px makes the variance of a mean 4 pi s^2 times as large, once s is a pixel.
            truth = sqrt(max(1, 4 * np.pi * smoothing_px**2)) / size
            assert np.median([uncertainty for _, uncertainty in found]) <= 1.25 * truth, (size, smoothing_px)
    assert np.mean(all_covered) >= 0.95 - 3 * sqrt(0.95 * 0.05 / len(all_covered))


@pytest.mark.parametrize("smoothing_px", [0.0, 1.2, 3.0])
def test_intervals_of_contrasts_and_cdp_cover_the_truth(smoothing_px):
    """CDP of two normal regions of 100 and 140 with noise of 5, whose truth is known from a million pixels."""
    rng = np.random.default_rng(30 + int(10 * smoothing_px))
    bright, dark = (rng.normal(mean, 5.0, 10**6) for mean in (140, 100))
    truth = np.mean((bright / dark >= 1.15) & (bright / dark <= 1.45))
    size, repeats = 40, 60
    covered = np.zeros(2)
    for _ in range(repeats):
        light = np.concatenate([mean + 5 * _noise(rng, size, smoothing_px) for mean in (140, 100)], axis=1)
        image = LuminanceMap(light, np.full(light.shape, 0.05), (), np.zeros(light.shape, np.uint8))
        rois = [Roi.rectangle(name, x, 0, size, size) for name, x in (("bright", 0), ("dark", size))]
        found = evaluate_pair(image, *rois, (0.3,))
        low, high = found.results[0].confidence_interval
        covered += (abs(found.contrast.value - 0.4) <= 1.96 * found.contrast.standard_error, low <= truth <= high)
    assert (covered / repeats >= 0.95 - 3 * sqrt(0.95 * 0.05 / repeats)).all()


@pytest.mark.parametrize("size", SIZES)
def test_a_vignetting_of_ten_percent_does_not_widen_the_interval_of_white_noise(size):
    y, x = np.mgrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j]
    light = 100 * (1 - 0.05 * (x**2 + y**2)) + np.random.default_rng(size).normal(0, 2, (size, size))
    assert variance_inflation(light, np.ones(light.shape, dtype=bool)) == 1


@pytest.mark.parametrize("outline", ["203 x 199", "circle"])
def test_a_gradient_across_a_large_region_does_not_widen_the_interval_of_white_noise(outline):
    """Blocks of pixels do not fill it: those that are cut off would show the gradient as noise."""
    height, width = (203, 199) if outline == "203 x 199" else (400, 400)
    y, x = np.mgrid[:height, :width]
    inside = np.ones((height, width), dtype=bool) if outline == "203 x 199" else np.hypot(x - 200, y - 200) < 199
    light = 100 + 10 * (2 * y / height - 1) + np.random.default_rng(3).normal(0, 1, (height, width))
    assert variance_inflation(light, inside) == 1


def test_regions_of_any_outline_and_of_few_pixels_have_a_factor():
    rng = np.random.default_rng(0)
    for shape in ((1, 1), (1, 2), (2, 2), (1, 40), (40, 1), (3, 50), (5, 5)):
        for image in (rng.normal(size=shape), np.arange(np.prod(shape), dtype=float).reshape(shape)):
            assert variance_inflation(image, np.ones(shape, dtype=bool)) >= 1
    y, x = np.mgrid[:40, :40]
    disc = np.hypot(x - 20, y - 20) < 18
    assert variance_inflation(rng.normal(size=(40, 40)), disc) == 1
    smooth = _noise(rng, 40, 2.0)
    # What lies outside does not matter.
    assert variance_inflation(np.where(disc, smooth, 1e6), disc) == pytest.approx(variance_inflation(smooth, disc))


@pytest.mark.parametrize("width", [1, 6])
def test_a_thin_region_is_not_more_often_taken_for_correlated_than_chance_says(width):
    """Four tests at 1 % each, and one of the lags: a diagonal line, whose blocks, if it has any, are cut off."""
    rng = np.random.default_rng(8)
    y, x = np.mgrid[:600, :600]
    thin = np.abs(x - y) < width
    found = [variance_inflation(rng.normal(size=thin.shape), thin) > 1 for _ in range(40)]
    assert np.mean(found) <= 0.05 + 3 * sqrt(0.05 * 0.95 / 40)
    assert variance_inflation(_noise(rng, 600, 2.0), thin) > 5
