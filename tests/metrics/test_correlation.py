from functools import partial
from math import log10, nan, sqrt

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, gaussian_filter1d, uniform_filter
from scipy.stats import norm

from labcdp.core.errors import InputError
from labcdp.metrics import cdp_correlated, variance_inflation
from labcdp.metrics.correlation.lags import chosen, inflation_of_scores

SIDE = 40
SHAPE = (SIDE, 2 * SIDE + 6)
LEFT, RIGHT = np.zeros(SHAPE, dtype=bool), np.zeros(SHAPE, dtype=bool)
LEFT[:, :SIDE], RIGHT[:, -SIDE:] = True, True


def noise(rng, averaged, shape=SHAPE):
    """Normal noise of variance 1, averaged over squares of some pixels."""
    white = rng.normal(size=(shape[0] + 2 * averaged, shape[1] + 2 * averaged))
    return averaged * uniform_filter(white, averaged)[averaged:-averaged, averaged:-averaged]


def by_lags(image, mask=None):
    mask = np.ones(image.shape, dtype=bool) if mask is None else mask
    return inflation_of_scores(np.where(mask, image - image[mask].mean(), 0), mask)


def patches(rng, averaged):
    return np.where(LEFT, 100, 120) + 5 * noise(rng, averaged)


def truth():
    low, high = (norm.cdf((ratio * 100 - 120) / (5 * np.hypot(ratio, 1))) for ratio in (1.1, 1.3))
    return high - low


@pytest.mark.parametrize("smoothed", [partial(uniform_filter, size=3), partial(gaussian_filter, sigma=2.0), np.asarray])
def test_intervals_cover_the_truth_and_are_hardly_wider_than_they_must_be(smoothed):
    """At contrasts on a flank of the CDP, where a pixel counts in proportion, and near its maximum."""
    rng, margin, repeats = np.random.default_rng(14), 20, 200
    impulse = np.zeros((41, 41))
    impulse[20, 20] = 1
    scale = 5 / sqrt(np.square(smoothed(impulse)).sum())
    found, covered = {0.15: [], 0.2: [], 0.3: []}, []
    for _ in range(repeats):
        noise = scale * smoothed(rng.normal(size=(SHAPE[0] + 2 * margin, SHAPE[1] + 2 * margin)))
        image = np.where(LEFT, 100, 120) + noise[margin:-margin, margin:-margin]
        for contrast, results in found.items():
            results.append(cdp_correlated(image, LEFT, RIGHT, contrast))
    for contrast, results in found.items():
        low, high = 1 + contrast / 2, 1 + 1.5 * contrast
        true = np.subtract(*(norm.cdf((ratio * 100 - 120) / (5 * np.hypot(ratio, 1))) for ratio in (high, low)))
        ends = np.array([result.confidence_interval for result in results])
        covered.append(np.mean((ends[:, 0] <= true) & (true <= ends[:, 1])))
        scatter = sqrt(np.mean([(result.cdp - true) ** 2 for result in results]))
        stated = sqrt(np.mean([result.standard_error**2 for result in results]))
        assert 0.9 * scatter * (1 - 3 / sqrt(2 * repeats)) <= stated <= 1.25 * scatter * (1 + 3 / sqrt(2 * repeats))
    assert min(covered) >= 0.93 - 3 * sqrt(0.93 * 0.07 / repeats), covered
    assert np.mean(covered) >= 0.95 - 3 * sqrt(0.95 * 0.05 / repeats), covered


@pytest.mark.parametrize("sigma", [0.0, 0.7])
@pytest.mark.parametrize("slope", [0.3, 0.5, 1.0, 2.0])
def test_uncertainty_does_not_jump_between_pictures_of_an_unchanged_scene(sigma, slope):
    """Light that rises across a region by about the noise is neither noise in one picture nor light in the next."""
    rng, mask, repeats = np.random.default_rng(43), np.ones((60, 60), dtype=bool), 60
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


def test_noise_correlated_over_3_x_3_pixels_doubles_to_triples_the_standard_error():
    rng = np.random.default_rng(15)
    results = [cdp_correlated(patches(rng, 3), LEFT, RIGHT, 0.2) for _ in range(60)]
    factors = [result.correlation_inflation for result in results]
    assert 2 < np.mean(factors) < 3
    scatter = np.std([result.cdp for result in results], ddof=1)
    stated = sqrt(np.mean([result.standard_error**2 for result in results]))
    assert stated == pytest.approx(scatter, rel=4 / sqrt(2 * 60))


@pytest.mark.parametrize(("averaged", "expected"), [(1, 1), (2, 4), (3, 9)])
def test_the_inflation_is_the_sum_of_the_autocorrelation(averaged, expected):
    rng = np.random.default_rng(18)
    # A disc, to have a mask with no straight edge.
    y, x = np.ogrid[:90, :100]
    disc = (y - 45) ** 2 + (x - 50) ** 2 < 40**2
    found = [by_lags(noise(rng, averaged, (90, 100)), disc) for _ in range(30)]
    assert np.mean(found) == pytest.approx(expected, rel=0.1)


def test_a_pattern_of_rows_is_found():
    rng = np.random.default_rng(19)
    shape = (100, 80)
    found = [by_lags(rng.normal(size=shape) + rng.normal(0, 0.3, (shape[0], 1))) for _ in range(30)]
    # Variance of the mean of a row over that of 80 independent pixels of the same variance.
    assert np.mean(found) == pytest.approx((0.3**2 + 1 / 80) / ((1 + 0.3**2) / 80), rel=0.15)


def test_a_strip_whose_far_lags_count_is_not_taken_for_independent():
    """The sum over all lags of a strip is 0 whatever the noise: by itself it would say that nothing is correlated."""
    rng = np.random.default_rng(41)
    strips = gaussian_filter1d(rng.normal(size=(6000, 160)), 6, axis=1)[:, 60:-60]
    factors = {True: [], False: []}
    for strip in strips:
        limit = 2 * sqrt(log10(strip.size) / strip.size)
        *_, all_right = chosen((strip - strip.mean())[None], np.ones((1, strip.size)), limit, 5, 2.3)
        factors[all_right].append(by_lags(strip[None]))
    assert len(factors[True]) >= 20
    # What a strip knows of its noise is little, but about as much as others do of theirs.
    spread = np.std(factors[True], ddof=1) / sqrt(len(factors[True]))
    assert np.mean(factors[True]) > np.mean(factors[False]) / 2 + 3 * spread
    assert 1 not in factors[True]


@pytest.mark.parametrize("shape", [(1, 4), (1, 8), (1, 16), (16, 1), (1, 40), (2, 8), (3, 3), (4, 4), (8, 8)])
def test_independent_noise_stays_so_on_tiny_regions(shape):
    """Stated variance of a mean: the true one, and up to 15 % more for what chance alone makes of few pixels."""
    rng = np.random.default_rng(42)
    images = rng.normal(size=(1500, *shape))
    stated = [image.var(ddof=1) * by_lags(image) for image in images]
    three_sigma = 3 * np.std(stated, ddof=1) / sqrt(len(stated))
    assert 1 - three_sigma <= np.mean(stated) <= 1.15 + three_sigma


def test_pixels_outside_the_mask_do_not_matter():
    image = noise(np.random.default_rng(20), 3)
    other = np.where(LEFT, image, nan)
    assert variance_inflation(other, LEFT) == pytest.approx(variance_inflation(image, LEFT))


@pytest.mark.parametrize(
    ("masks", "message"),
    [
        ((LEFT, LEFT), "mask_a and mask_b have 1600 pixels in common: give two regions that do not overlap"),
        ((LEFT, RIGHT[:, 1:]), r"mask_b has type bool and shape \(40, 85\)"),
        ((LEFT.astype(int), RIGHT), "mask_a has type int64 and shape"),
        ((LEFT, LEFT & RIGHT), "mask_b marks no pixel: mark at least one"),
    ],
)
def test_unusable_masks_are_refused(masks, message):
    with pytest.raises(InputError, match=message):
        cdp_correlated(np.ones(SHAPE), *masks, 0.2)
