from math import log10, nan, sqrt

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, uniform_filter
from scipy.stats import norm

from labcdp.contrast import cdp, cdp_correlated, variance_inflation
from labcdp.contrast.correlation_kernel import chosen
from labcdp.errors import InputError

SIDE = 40
SHAPE = (SIDE, 2 * SIDE + 6)
LEFT, RIGHT = np.zeros(SHAPE, dtype=bool), np.zeros(SHAPE, dtype=bool)
LEFT[:, :SIDE], RIGHT[:, -SIDE:] = True, True


def noise(rng, averaged, shape=SHAPE):
    """Normal noise of variance 1, averaged over squares of some pixels."""
    white = rng.normal(size=(shape[0] + 2 * averaged, shape[1] + 2 * averaged))
    return averaged * uniform_filter(white, averaged)[averaged:-averaged, averaged:-averaged]


def patches(rng, averaged):
    return np.where(LEFT, 100, 120) + 5 * noise(rng, averaged)


def truth():
    low, high = (norm.cdf((ratio * 100 - 120) / (5 * np.hypot(ratio, 1))) for ratio in (1.1, 1.3))
    return high - low


@pytest.mark.parametrize("averaged", [1, 3])
def test_the_confidence_interval_covers_the_truth(averaged):
    rng = np.random.default_rng(14)
    repeats = 400
    intervals = [cdp_correlated(patches(rng, averaged), LEFT, RIGHT, 0.2).confidence_interval for _ in range(repeats)]
    covered = np.mean([low <= truth() <= high for low, high in intervals])
    assert 0.93 - 3 * sqrt(0.93 * 0.07 / repeats) < covered < 0.97 + 3 * sqrt(0.97 * 0.03 / repeats)


def test_noise_correlated_over_3_x_3_pixels_doubles_to_triples_the_standard_error():
    rng = np.random.default_rng(15)
    results = [cdp_correlated(patches(rng, 3), LEFT, RIGHT, 0.2) for _ in range(60)]
    factors = [result.correlation_inflation for result in results]
    assert 2 < np.mean(factors) < 3
    scatter = np.std([result.cdp for result in results], ddof=1)
    stated = sqrt(np.mean([result.standard_error**2 for result in results]))
    assert stated == pytest.approx(scatter, rel=4 / sqrt(2 * 60))


def test_only_the_uncertainty_differs_from_cdp():
    image = patches(np.random.default_rng(16), 3)
    plain, corrected = cdp(image[LEFT], image[RIGHT], 0.2), cdp_correlated(image, LEFT, RIGHT, 0.2)
    for name in ("cdp", "below", "above", "undefined", "bright", "bright_size", "dark_size", "interval"):
        assert getattr(corrected, name) == getattr(plain, name)
    assert corrected.standard_error == pytest.approx(plain.standard_error * corrected.correlation_inflation)
    assert plain.correlation_inflation == 1


def test_where_all_pairs_agree_the_correlation_of_the_pixels_counts():
    image = np.where(LEFT, 100, 120) + 0.5 * noise(np.random.default_rng(17), 3)
    result = cdp_correlated(image, LEFT, RIGHT, 0.2)
    assert (result.cdp, result.standard_error) == (1, 0)
    assert result.correlation_inflation == pytest.approx(3, rel=0.3)
    assert result.confidence_interval[0] < cdp(image[LEFT], image[RIGHT], 0.2).confidence_interval[0] - 0.005


def test_without_any_noise_there_is_no_correlation():
    result = cdp_correlated(np.where(LEFT, 100, 120), LEFT, RIGHT, 0.2)
    assert (result.cdp, result.correlation_inflation) == (1, 1)


@pytest.mark.parametrize(("averaged", "expected"), [(1, 1), (2, 4), (3, 9)])
def test_the_inflation_is_the_sum_of_the_autocorrelation(averaged, expected):
    rng = np.random.default_rng(18)
    # A disc, to have a mask with no straight edge.
    y, x = np.ogrid[:90, :100]
    disc = (y - 45) ** 2 + (x - 50) ** 2 < 40**2
    found = [variance_inflation(noise(rng, averaged, (90, 100)), disc) for _ in range(30)]
    assert np.mean(found) == pytest.approx(expected, rel=0.1)


def test_a_pattern_of_rows_is_found():
    rng = np.random.default_rng(19)
    shape = (100, 80)
    found = [
        variance_inflation(rng.normal(size=shape) + rng.normal(0, 0.3, (shape[0], 1)), np.ones(shape, dtype=bool))
        for _ in range(30)
    ]
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
        factors[all_right].append(variance_inflation(strip[None], np.ones((1, strip.size), dtype=bool)))
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
    mask = np.ones(shape, dtype=bool)
    stated = [image.var(ddof=1) * variance_inflation(image, mask) for image in images]
    three_sigma = 3 * np.std(stated, ddof=1) / sqrt(len(stated))
    assert 1 - three_sigma <= np.mean(stated) <= 1.15 + three_sigma


def test_pixels_outside_the_mask_do_not_matter():
    image = noise(np.random.default_rng(20), 3)
    other = np.where(LEFT, image, nan)
    assert variance_inflation(other, LEFT) == pytest.approx(variance_inflation(image, LEFT))


def test_pixels_that_are_all_equal_tell_nothing():
    assert np.isnan(variance_inflation(np.full(SHAPE, 0.1), LEFT))


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 3)])
def test_a_handful_of_pixels_gives_1_or_nothing(shape):
    image = np.arange(np.prod(shape)).reshape(shape)
    found = variance_inflation(image, np.ones(shape, dtype=bool))
    assert np.isnan(found) if image.size == 1 else found >= 1


@pytest.mark.parametrize(
    ("masks", "message"),
    [
        ((LEFT, LEFT), "mask_a and mask_b have 1600 pixels in common: give two regions that do not overlap"),
        (
            (LEFT, RIGHT[:, 1:]),
            r"mask_b has type bool and shape \(40, 85\): give booleans of the image's shape \(40, 86\)",
        ),
        ((LEFT.astype(int), RIGHT), "mask_a has type int64 and shape"),
        ((LEFT, LEFT & RIGHT), "mask_b marks no pixel: mark at least one"),
    ],
)
def test_unusable_masks_are_refused(masks, message):
    with pytest.raises(InputError, match=message):
        cdp_correlated(np.ones(SHAPE), *masks, 0.2)


def test_unusable_images_are_refused():
    with pytest.raises(InputError, match="the image has 1 dimensions"):
        cdp_correlated([1, 2], [True, False], [False, True], 0.2)
    with pytest.raises(InputError, match="the mask marks pixels that are not finite: leave them out"):
        variance_inflation([[1, nan]], [[True, True]])
    with pytest.raises(InputError, match="neither region holds a value above 0"):
        cdp_correlated(np.zeros(SHAPE), LEFT, RIGHT, 0.2)
