from functools import partial
from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, uniform_filter

import labcdp
from labcdp.core.roi import Roi
from labcdp.metrics import variance_inflation
from labcdp.metrics.correlation import lag_inflation, pairs_by_lag, products_by_lag
from labcdp.metrics.pair import evaluate_pair

from .closed_forms import share_of_normal
from .conftest import map_of

SIDE = 40
SHAPE = (SIDE, 2 * SIDE + 6)
LEFT, RIGHT = np.zeros(SHAPE, dtype=bool), np.zeros(SHAPE, dtype=bool)
LEFT[:, :SIDE], RIGHT[:, -SIDE:] = True, True
ROIS = Roi.rectangle("left", 0, 0, SIDE, SIDE), Roi.rectangle("right", SIDE + 6, 0, SIDE, SIDE)
REPEATS = {30: 60, 60: 40, 150: 20}


def smoothed(rng, shape, filtered=np.asarray, margin=20):
    """Normal noise, smoothed, with a standard deviation of 1; cut from a larger field."""
    impulse = np.zeros((41, 41))
    impulse[20, 20] = 1
    noise = filtered(rng.normal(size=(shape[0] + 2 * margin, shape[1] + 2 * margin)))
    return noise[margin:-margin, margin:-margin] / sqrt(np.square(filtered(impulse)).sum())


def gaussian(sigma):
    return partial(gaussian_filter, sigma=sigma) if sigma else np.asarray


def by_lags(image, mask=None):
    mask = np.ones(image.shape, dtype=bool) if mask is None else mask
    return lag_inflation(np.where(mask, image - image[mask].mean(), 0), pairs_by_lag(mask))


@given(shape=st.tuples(st.integers(1, 9), st.integers(1, 9)), seed=st.integers(0, 2**32 - 1))
def test_products_by_lag_as_by_brute_force(shape, seed):
    values, (height, width) = np.random.default_rng(seed).normal(size=shape), shape
    found = products_by_lag(values)
    for dy in range(1 - height, height):
        for dx in range(1 - width, width):
            first = values[max(-dy, 0) : height - max(dy, 0), max(-dx, 0) : width - max(dx, 0)]
            second = values[max(dy, 0) :, max(dx, 0) :][: first.shape[0], : first.shape[1]]
            assert found[dy, dx] == pytest.approx((first * second).sum(), abs=1e-12)


def rows(both, offset):
    """Noise of pixels with offsets of rows that both regions have, or each its own."""

    def field(rng):
        offsets = rng.normal(0, offset, (2, SIDE, 1))[[0, 0] if both else [0, 1]]
        return (rng.normal(size=SHAPE) + np.where(LEFT, *offsets)) / np.hypot(1, offset)

    return field


SMOOTHINGS = partial(uniform_filter, size=3), gaussian(2.0), np.asarray


@pytest.mark.parametrize(
    ("field", "widest"),
    [
        *((partial(smoothed, shape=SHAPE, filtered=one), 1.25) for one in SMOOTHINGS),
        *((rows(*of), 1.7) for of in ((True, 0.5), (True, 1.0), (False, 1.0))),
    ],
)
def test_intervals_cover_the_truth_and_are_hardly_wider_than_they_must_be(field, widest):
    """At contrasts on a flank of the CDP, where a pixel counts in proportion, and near its maximum."""
    rng, repeats = np.random.default_rng(14), 50
    found, covered = {0.15: [], 0.2: [], 0.3: []}, []
    for _ in range(repeats):
        image = np.where(LEFT, 100, 120) + 5 * field(rng)
        for contrast, results in found.items():
            results.append(evaluate_pair(map_of(image), *ROIS, (contrast,)).cdp[0])
    for contrast, results in found.items():
        true = share_of_normal((120, 5), (100, 5), 0.5 * contrast, 1.5 * contrast)
        ends = np.array([result.interval for result in results])
        covered.append(np.mean((ends[:, 0] <= true) & (true <= ends[:, 1])))
        scatter = sqrt(np.mean([(result.cdp - true) ** 2 for result in results]))
        stated = sqrt(np.mean([result.u**2 for result in results]))
        assert 0.9 * scatter * (1 - 3 / sqrt(2 * repeats)) <= stated <= widest * scatter * (1 + 3 / sqrt(2 * repeats))
    assert min(covered) >= 0.91 - 3 * sqrt(0.91 * 0.09 / repeats), covered
    assert np.mean(covered) >= 0.95 - 3 * sqrt(0.95 * 0.05 / repeats), covered


@pytest.mark.parametrize("filtered", SMOOTHINGS)
def test_parts_of_images_have_intervals_for_correlated_noise_and_a_finding(filtered):
    rng, repeats, covered, found = np.random.default_rng(15), 60, [], []
    true = share_of_normal((120, 5), (100, 5), 0.1, 0.3)
    for _ in range(repeats):
        bright, dark = (mean + 5 * smoothed(rng, (SIDE, SIDE), filtered) for mean in (120, 100))
        result = labcdp.cdp(bright, dark, 0.2)
        covered.append(result.interval.low <= true <= result.interval.high)
        found.append([one.code for one in result.findings])
        independent = labcdp.cdp(bright.ravel(), dark.ravel(), 0.2)
        assert (independent.cdp, independent.findings) == (result.cdp, ())
        assert result.u >= independent.u
    assert np.mean(covered) >= 0.95 - 3 * sqrt(0.95 * 0.05 / repeats)
    # Of independent pixels each of the tests of one in a hundred may say so.
    assert np.mean([one == ["pixels-correlated"] for one in found]) == (1 if filtered is not np.asarray else
                                                                        pytest.approx(0, abs=0.25))  # fmt: skip


def test_regions_in_which_correlation_cannot_be_seen_are_stated():
    image = np.random.default_rng(1).normal(100, 5, SHAPE)
    small = Roi.rectangle("small", 2, 3, 6, 6)
    found = evaluate_pair(map_of(image), ROIS[1], small, (0.2,)).findings
    assert [(one.code, one.subject) for one in found] == [("region-correlation-unknown", "small")]
    assert evaluate_pair(map_of(image), *ROIS, (0.2,)).findings == ()


@pytest.mark.parametrize("sigma", [0.0, 0.7, 3.0])
def test_intervals_of_means_cover_the_truth_however_far_the_noise_reaches(sigma):
    """Each size by itself, and all of them together: 3 sigma below 95 %."""
    rng, all_covered = np.random.default_rng(12), []
    for size, repeats in REPEATS.items():
        mask, found = np.ones((size, size), dtype=bool), []
        for _ in range(repeats):
            noise = smoothed(rng, mask.shape, gaussian(sigma))
            u = noise.std(ddof=1) * sqrt(variance_inflation(noise, mask) / noise.size)
            found.append((abs(noise.mean()) <= 1.96 * u, u))
        covered, stated = np.array(found).T
        all_covered += covered.tolist()
        assert covered.mean() >= 0.95 - 3 * sqrt(0.95 * 0.05 / repeats), size
        # Smoothing by a Gaussian of s px makes the variance of a mean 4 pi s^2 times as large, once s is a pixel.
        assert np.median(stated) <= 1.25 * sqrt(max(1, 4 * np.pi * sigma**2)) / size
    assert np.mean(all_covered) >= 0.95 - 3 * sqrt(0.95 * 0.05 / len(all_covered))


@pytest.mark.parametrize(("sigma", "slope"), [(0.0, 0.5), (0.7, 0.3), (0.7, 2.0)])
def test_uncertainty_does_not_jump_between_pictures_of_an_unchanged_scene(sigma, slope):
    """Light that rises across a region by about the noise is neither noise in one picture nor light in the next."""
    rng, mask, repeats = np.random.default_rng(43), np.ones((60, 60), dtype=bool), 40
    light = slope * np.linspace(-1, 1, 60)[None, :]
    stated, means = [], []
    for _ in range(repeats):
        grain = gaussian_filter(rng.normal(size=(80, 80)), sigma)[10:-10, 10:-10]
        image = grain / (0.4 if sigma else 1.0)
        means.append(image.mean())
        stated.append(sqrt(variance_inflation(image + light, mask) * (image + light).var() / mask.sum()))
    scatter = np.std(means, ddof=1)
    assert max(stated) < 5 * scatter
    assert np.median(stated) > 0.9 * scatter * (1 - 3 / sqrt(2 * repeats))


def test_the_inflation_is_the_sum_of_the_autocorrelation():
    rng, repeats = np.random.default_rng(18), 20
    # A disc, to have a mask with no straight edge.
    y, x = np.ogrid[:90, :100]
    disc = (y - 45) ** 2 + (x - 50) ** 2 < 40**2
    for side in (1, 2, 3):
        found = [by_lags(smoothed(rng, (90, 100), partial(uniform_filter, size=side)), disc) for _ in range(repeats)]
        assert np.mean(found) == pytest.approx(side**2, rel=0.1)
    # A pattern of rows: variance of the mean of a row over that of 80 independent pixels of the same variance.
    found = [by_lags(rng.normal(size=(100, 80)) + rng.normal(0, 0.3, (100, 1))) for _ in range(repeats)]
    assert np.mean(found) == pytest.approx((0.3**2 + 1 / 80) / ((1 + 0.3**2) / 80), rel=0.15)


@pytest.mark.parametrize(("height", "width", "radius"), [(203, 199, np.inf), (400, 400, 199)])
def test_a_gradient_across_a_large_region_does_not_widen_the_interval_of_white_noise(height, width, radius):
    """Blocks of pixels do not fill it: those that are cut off would show the gradient as noise."""
    y, x = np.mgrid[:height, :width]
    inside = np.hypot(x - 200, y - 200) < radius
    light = 100 + 10 * (2 * y / height - 1) + np.random.default_rng(3).normal(0, 1, (height, width))
    assert variance_inflation(light, inside) == 1


def test_regions_of_any_outline_and_of_few_pixels_have_a_factor():
    rng = np.random.default_rng(0)
    for shape in ((1, 1), (1, 2), (2, 2), (1, 40), (40, 1), (3, 50), (5, 5)):
        for image in (rng.normal(size=shape), np.arange(np.prod(shape), dtype=float).reshape(shape)):
            assert variance_inflation(image, np.ones(shape, dtype=bool)) >= 1
    y, x = np.mgrid[:40, :40]
    disc = np.hypot(x - 20, y - 20) < 18
    smooth = smoothed(rng, (40, 40), gaussian(2.0))
    # What lies outside does not matter.
    assert variance_inflation(np.where(disc, smooth, 1e6), disc) == pytest.approx(variance_inflation(smooth, disc))


@pytest.mark.parametrize("width", [1, 6])
def test_a_thin_region_is_not_more_often_taken_for_correlated_than_chance_says(width):
    """Four tests at 1 % each, and one of the lags: a diagonal line, whose blocks, if it has any, are cut off."""
    rng = np.random.default_rng(8)
    y, x = np.mgrid[:600, :600]
    thin = np.abs(x - y) < width
    found = [variance_inflation(rng.normal(size=thin.shape), thin) > 1 for _ in range(20)]
    assert np.mean(found) <= 0.05 + 3 * sqrt(0.05 * 0.95 / 20)
    assert variance_inflation(smoothed(rng, (600, 600), gaussian(2.0)), thin) > 5
