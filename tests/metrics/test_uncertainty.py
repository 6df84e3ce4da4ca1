from fractions import Fraction
from itertools import permutations
from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from labcdp.metrics import cdp

several = st.lists(st.integers(90, 130), min_size=2, max_size=5)


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
    least = share * (1 - share) / (m * n)
    result = cdp(a, b, 0.2)
    assert result.cdp == float(share)
    assert result.u == pytest.approx(sqrt(max(unbiased, least)), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("patches", [(100, 5, 120, 5), (100, 20, 150, 25), (100, 2.5, 120, 2.5)])
@pytest.mark.parametrize("sizes", [(40, 40), (25, 160)])
def test_the_stated_variance_is_the_variance_of_repeated_measurements(patches, sizes):
    rng = np.random.default_rng(20)
    repeats = 1500
    contrast = patches[2] / patches[0] - 1
    results = [cdp(*normal_regions(rng, patches, *sizes), contrast) for _ in range(repeats)]
    deviations = np.array([r.cdp for r in results])
    deviations -= deviations.mean()
    stated = np.array([r.u**2 for r in results])
    # Standard errors of the two means compared; the first carries the fourth moment of the CDP itself.
    tolerance = 4 * np.hypot(np.std(deviations**2), np.std(stated)) / sqrt(repeats)
    assert abs(np.mean(stated) - np.var(deviations, ddof=1)) < tolerance


@pytest.mark.parametrize(("n", "published"), [(400, 0.0127), (10_000, 0.0026)])
def test_the_standard_error_is_that_of_normal_patches(n, published):
    # Shares of the pairs of one dark, and of one bright, pixel of the patches (100, 5) and (120, 5).
    def per_dark(value):
        return norm.cdf(1.3 * value, 120, 5) - norm.cdf(1.1 * value, 120, 5)

    def per_bright(value):
        return norm.cdf(value / 1.1, 100, 5) - norm.cdf(value / 1.3, 100, 5)

    share = norm.expect(per_dark, loc=100, scale=5)
    zeta10 = norm.expect(lambda value: (per_dark(value) - share) ** 2, loc=100, scale=5)
    zeta01 = norm.expect(lambda value: (per_bright(value) - share) ** 2, loc=120, scale=5)
    expected = sqrt((n - 1) * (zeta10 + zeta01) + share * (1 - share)) / n
    rng = np.random.default_rng(4)
    repeats = 60
    variances = [cdp(*normal_regions(rng, (100, 5, 120, 5), n, n), 0.2).u ** 2 for _ in range(repeats)]
    assert abs(np.mean(variances) - expected**2) < 4 * np.std(variances) / sqrt(repeats)
    # The published figures are estimates of a few repetitions.
    assert expected == pytest.approx(published, rel=0.12)


@pytest.mark.parametrize("std", [10, 5, 3, 2.2, 1.9])
@pytest.mark.parametrize("sizes", [(30, 30), (100, 100), (20, 400)])
def test_the_confidence_interval_covers_the_truth(std, sizes):
    def up_to(ratio):
        return norm.cdf((ratio * 100 - 120) / (std * np.hypot(ratio, 1)))

    truth = up_to(1.3) - up_to(1.1)
    rng = np.random.default_rng(30)
    repeats = 500
    intervals = [cdp(*normal_regions(rng, (100, std, 120, std), *sizes), 0.2).interval for _ in range(repeats)]
    covered = np.mean([low <= truth <= high for low, high in intervals])
    # At least 93 %, as stated where the interval is made.
    assert covered > 0.93 - 4 * sqrt(0.93 * 0.07 / repeats)
    assert all(0 <= low <= high <= 1 for low, high in intervals)


@pytest.mark.parametrize(("bright", "cdp_expected"), [(120, 1), (100, 0)])
def test_where_all_pixels_agree_the_interval_is_that_of_the_smaller_region(bright, cdp_expected):
    result = cdp(np.full(900, bright), np.full(400, 100), 0.2)
    assert (result.cdp, result.u) == (cdp_expected, 0)
    # Score interval for 400 of 400 trials, or none.
    far_end = 1 / (1 + norm.ppf(0.975) ** 2 / 400)
    expected = (far_end, 1) if cdp_expected else (0, 1 - far_end)
    assert result.interval == pytest.approx(expected, abs=1e-12)


def test_the_interval_does_not_jump_where_one_pair_of_a_million_fails():
    everything = cdp(np.full(1000, 120), np.full(1000, 100), 0.2).interval
    # 110 is on the end for 100 and outside for 101.
    one_pair = cdp([110] + [120] * 999, [101] + [100] * 999, 0.2)
    assert one_pair.cdp == 1 - 1e-6
    assert one_pair.interval == pytest.approx(everything, abs=1e-4)
