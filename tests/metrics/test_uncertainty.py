"""Uncertainty of a CDP by the number of pixels, and the number of pixels for an uncertainty."""

from fractions import Fraction
from itertools import permutations
from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from labcdp.core.errors import InputError
from labcdp.metrics import Distribution, cdp, pixels_needed

from .closed_forms import share_of_normal

several = st.lists(st.integers(90, 130), min_size=2, max_size=5)
PATCHES = Distribution.normal(120, 5), Distribution.normal(100, 5)


def normal_regions(rng, patches, n_dark, n_bright):
    dark, dark_std, bright, bright_std = patches
    return rng.normal(bright, bright_std, n_bright), rng.normal(dark, dark_std, n_dark)


@given(several, several)
def test_the_variance_is_the_unbiased_one_by_definition(all_contrasts, a, b):
    inside = [[Fraction(1, 10) <= value <= Fraction(3, 10) for value in row] for row in all_contrasts(a, b)]
    m, n = len(inside), len(inside[0])
    share = Fraction(sum(map(sum, inside)), m * n)
    # U^2 less the unbiased square of the mean, over all pairs of pairs without a common pixel.
    rows, columns = list(permutations(range(m), 2)), list(permutations(range(n), 2))
    apart = sum(inside[i][j] and inside[k][col] for i, k in rows for j, col in columns)
    unbiased = share**2 - Fraction(apart, len(rows) * len(columns))
    result = cdp(a, b, 0.2)
    assert result.cdp == float(share)
    assert result.u == pytest.approx(sqrt(max(unbiased, share * (1 - share) / (m * n))), rel=1e-12, abs=1e-12)


def exact_standard_error(n):
    """Of the CDP of normal patches of n pixels, (100, 5) and (120, 5), by numerical integration."""

    def per_dark(value):
        return norm.cdf(1.3 * value, 120, 5) - norm.cdf(1.1 * value, 120, 5)

    def per_bright(value):
        return norm.cdf(value / 1.1, 100, 5) - norm.cdf(value / 1.3, 100, 5)

    share = norm.expect(per_dark, loc=100, scale=5)
    zeta = norm.expect(lambda value: (per_dark(value) - share) ** 2, loc=100, scale=5)
    zeta += norm.expect(lambda value: (per_bright(value) - share) ** 2, loc=120, scale=5)
    return sqrt((n - 1) * zeta + share * (1 - share)) / n


@pytest.mark.parametrize(("n", "published"), [(400, 0.01180), (10_000, 0.00236)])
def test_the_standard_error_and_the_pixels_needed_are_those_of_the_closed_form(n, published):
    exact = exact_standard_error(n)
    assert exact == pytest.approx(published, abs=5e-6)
    # A little more than exact is reached with n pixels, a little less only with more.
    assert pixels_needed(*PATCHES, 0.2, standard_error=exact * (1 + 1e-5)) == n
    assert pixels_needed(*PATCHES, 0.2, standard_error=exact * (1 - 1e-5)) == n + 1
    rng, repeats = np.random.default_rng(4), 60
    variances = [cdp(*normal_regions(rng, (100, 5, 120, 5), n, n), 0.2).u ** 2 for _ in range(repeats)]
    assert abs(np.mean(variances) - exact**2) < 4 * np.std(variances) / sqrt(repeats)


@pytest.mark.parametrize("std", [10, 3, 1.9])
@pytest.mark.parametrize("sizes", [(30, 30), (20, 400)])
def test_the_confidence_interval_covers_the_truth(std, sizes):
    truth, rng, repeats = share_of_normal((120, std), (100, std), 0.1, 0.3), np.random.default_rng(30), 500
    found = [cdp(*normal_regions(rng, (100, std, 120, std), *sizes), 0.2) for _ in range(repeats)]
    covered = np.mean([one.interval.low <= truth <= one.interval.high for one in found])
    # At least 93 %, as stated where the interval is made.
    assert covered > 0.93 - 4 * sqrt(0.93 * 0.07 / repeats)
    deviations, stated = np.array([one.cdp for one in found]) - truth, np.array([one.u**2 for one in found])
    # Standard errors of the two means compared; the first carries the fourth moment of the CDP itself.
    tolerance = 4 * np.hypot(np.std(deviations**2), np.std(stated)) / sqrt(repeats)
    assert abs(np.mean(stated) - np.mean(deviations**2)) < tolerance


def test_where_all_pixels_agree_the_interval_is_that_of_the_smaller_region():
    # Score interval for 400 of 400 trials, or none.
    far_end = 1 / (1 + norm.ppf(0.975) ** 2 / 400)
    for bright, expected in ((120, (far_end, 1)), (100, (0, 1 - far_end))):
        result = cdp(np.full(900, bright), np.full(400, 100), 0.2)
        assert result.u == 0
        assert result.interval == pytest.approx(expected, abs=1e-12)
    # It does not jump where one pair of a million fails: 110 is on the end for 100 and outside for 101.
    everything = cdp(np.full(1000, 120), np.full(1000, 100), 0.2).interval
    one_pair = cdp([110] + [120] * 999, [101] + [100] * 999, 0.2)
    assert one_pair.cdp == 1 - 1e-6
    assert one_pair.interval == pytest.approx(everything, abs=1e-4)


@pytest.mark.parametrize(("bright", "dark", "u"), [((5, 6), (3, 4), 0), ((5, 6), (4,), 0.01), ((5, 5), (4, 4), 0.01)])
def test_unusable_plans_are_refused(bright, dark, u):
    with pytest.raises(InputError, match=r"standard_error is 0|pilot"):
        pixels_needed(bright, dark, 0.2, standard_error=u)


@pytest.mark.parametrize(("contrast", "target", "published"), [(0.1, 0.5, 420), (0.1, 0.95, 3555), (0.2, 0.9, 717)])
def test_shot_noise_needs_the_published_number_of_dark_electrons(contrast, target, published):
    def normal(electrons):
        mean = electrons * (1 + contrast)
        return cdp(Distribution.normal(mean, sqrt(mean)), Distribution.normal(electrons, sqrt(electrons)), contrast).cdp

    # The nearest integer, by the slope of the CDP.
    assert abs(normal(published) - target) < normal(published + 1) - normal(published)
