from fractions import Fraction
from math import sqrt

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import norm, poisson

from labcdp.core.errors import InputError
from labcdp.metrics import Distribution, cdp

# 12-bit values around each other, so that ties, zeros and negative ones (darkness subtracted) are common.
levels = st.one_of(st.integers(-3, 12), st.integers(90, 130), st.integers(0, 4095))
region = st.lists(levels, min_size=1, max_size=12)
positive_region = st.lists(st.integers(1, 4095), min_size=1, max_size=12)
contrasts = st.one_of(
    st.sampled_from(["0.1", "0.2", "0.3", "0.4", "0.5", "1", "0.7", "2.5"]),
    st.decimals("0.001", "20", places=3).map(str),
)
epsilons = st.one_of(st.sampled_from(["0.5", "1", "0.1", "0.9"]), st.decimals("0.01", "1", places=2).map(str))


def shares(pairs, contrast, epsilon):
    """Below, inside, above and undefined as exact shares of all pairs, undefined ones below."""
    k, eps = Fraction(contrast), Fraction(epsilon)
    flat = [value for row in pairs for value in row]
    below = sum(not value >= k * (1 - eps) for value in flat)
    above = sum(value > k * (1 + eps) for value in flat)
    undefined = sum(value != value for value in flat)
    return [float(Fraction(n, len(flat))) for n in (below, len(flat) - below - above, above, undefined)]


@given(region, region, contrasts, epsilons)
def test_integers_give_the_shares_of_exact_arithmetic(all_contrasts, a, b, contrast, epsilon):
    assume(max(a + b) > 0)
    expected = shares(all_contrasts(a, b), contrast, epsilon)
    result = cdp(np.array(a), np.array(b), float(contrast), float(epsilon))
    assert [result.below, result.cdp, result.above] == expected[:3]
    assert result.undefined == pytest.approx(expected[3], abs=1e-15)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("contrast", ["0.2800043", "0.6400127"])
def test_the_closest_miss_of_24_bit_integers_does_not_count(contrast, side):
    factor = 1 + Fraction(contrast) * (1 + side * Fraction("0.5"))
    numerator, denominator = factor.numerator, factor.denominator
    # Here bright * denominator and dark * numerator differ by 1: no pair this dark comes closer to the end.
    dark = pow(-side * numerator, -1, denominator)
    bright = (numerator * dark + side) // denominator
    assert max(dark, bright) < 2**24 < 2 * denominator
    assert bright * denominator == numerator * dark + side
    assert cdp([bright], [dark], float(contrast)).cdp == 0


def test_24_bit_integers_nearest_to_an_end_are_decided_as_in_exact_arithmetic():
    factor = 1 + Fraction("0.1234567") * Fraction("0.5")
    rng = np.random.default_rng(3)
    for dark in rng.integers(2**22, 2**23, 300).tolist():
        for bright in range(int(factor * dark) - 1, int(factor * dark) + 3):
            assert cdp([bright], [dark], 0.1234567).cdp == (bright >= factor * dark)


@given(region, region, contrasts, epsilons)
def test_floats_and_integers_of_any_type_give_the_same(a, b, contrast, epsilon):
    assume(max(a + b) > 0)
    expected = cdp(np.array(a), np.array(b), float(contrast), float(epsilon))
    for kind in (np.int16, np.float32, np.float64):
        assert repr(cdp(np.array(a, kind), np.array(b, kind), float(contrast), float(epsilon))) == repr(expected)


@given(positive_region, positive_region, contrasts, st.floats(1e-6, 1e6))
def test_the_unit_does_not_matter(a, b, contrast, cd_m2_per_dn):
    assume(sum(a) * len(b) != sum(b) * len(a))
    dn = cdp(a, b, float(contrast))
    luminance = cdp(np.array(a) * cd_m2_per_dn, np.array(b) * cd_m2_per_dn, float(contrast))
    assert repr(luminance) == repr(dn)


@given(region, region, contrasts, epsilons, epsilons)
def test_shares_add_up_and_rise_with_epsilon(a, b, contrast, epsilon, wider):
    assume(max(a + b) > 0)
    narrow, wide = sorted((float(epsilon), float(wider)))
    results = [cdp(a, b, float(contrast), e) for e in (narrow, wide)]
    for result in results:
        assert result.below + result.cdp + result.above == pytest.approx(1, abs=1e-15)
        assert 0 <= result.undefined <= result.below
    assert results[0].cdp <= results[1].cdp


NORMAL = [
    ((100, 5, 120, 5), 0.79940),
    ((100, 10, 120, 10), 0.47840),
    ((100, 20, 150, 25), 0.47971),
    ((50, 10, 60, 10), 0.25145),
    ((1000, 30, 1100, 35), 0.70136),
]


def closed_form(dark, dark_std, bright, bright_std):
    """CDP of independent normal pixels with the contrast of the means and epsilon 0.5."""

    def up_to(ratio):
        return norm.cdf((ratio * dark - bright) / np.hypot(ratio * dark_std, bright_std))

    contrast = bright / dark - 1
    return up_to(1 + 1.5 * contrast) - up_to(1 + 0.5 * contrast)


@pytest.mark.parametrize(("patches", "published"), NORMAL)
def test_normal_patches_give_the_closed_form(patches, published):
    dark, dark_std, bright, bright_std = patches
    assert closed_form(*patches) == pytest.approx(published, abs=5e-6)
    rng = np.random.default_rng(11)
    n = 40_000
    result = cdp(rng.normal(bright, bright_std, n), rng.normal(dark, dark_std, n), bright / dark - 1)
    assert abs(result.cdp - published) < 4 * result.u


def test_shot_noise_gives_the_exact_poisson_figure():
    quanta = np.arange(1000)
    dark, bright = (Distribution(quanta, poisson.pmf(quanta, mean)) for mean in (250, 300))
    result = cdp(dark, bright, 0.2)
    assert result.cdp == pytest.approx(0.6706, abs=5e-5)
    assert result.swapped
    assert np.isnan([result.u, *result.interval]).all()
    assert result.pairs is None


def test_a_megapixel_counts_every_one_of_its_pairs():
    rng = np.random.default_rng(5)
    a, b = (rng.normal(mean, 30, (1000, 1000)).round().astype(np.uint16) for mean in (1000, 1200))
    dark, bright = np.bincount(a.ravel()).tolist(), np.bincount(b.ravel()).tolist()
    inside = sum(n * m for d, n in enumerate(dark) if n for x, m in enumerate(bright) if 11 * d <= 10 * x <= 13 * d)
    assert cdp(a, b, 0.2).cdp == inside / 10**12


def test_long_float_regions_agree_with_a_plain_search():
    rng = np.random.default_rng(7)
    n = 70_000
    dark, bright = np.sort(rng.normal(1000, 30, n)), np.sort(rng.normal(1100, 35, n))
    per_dark = np.searchsorted(bright, 1.15 * dark) - np.searchsorted(bright, 1.05 * dark)
    per_bright = np.searchsorted(dark, bright / 1.05) - np.searchsorted(dark, bright / 1.15)
    result = cdp(rng.permutation(dark), rng.permutation(bright), 0.1)
    assert result.cdp == per_dark.sum() / n**2
    share = result.cdp
    scatter = np.var(per_dark / n) * n + np.var(per_bright / n) * n
    assert result.u == pytest.approx(sqrt(scatter - share * (1 - share)) / (n - 1), rel=1e-12)


def test_dark_pixels_of_0_and_below_have_an_unbounded_or_undefined_contrast():
    result = cdp([0, 120, 120, 121], [100, 0, -1, -5], 0.2)
    # 16 pairs: dark 100 against 0 is below, against the rest inside; the others above, against 0 undefined.
    assert (result.below, result.cdp, result.above, result.undefined) == (4 / 16, 3 / 16, 9 / 16, 3 / 16)


@pytest.mark.parametrize("contrast", [0, -0.1, float("nan"), float("inf")])
def test_an_unusable_contrast_is_refused(contrast):
    with pytest.raises(InputError, match=rf"contrast is {float(contrast)}: give a fraction above 0 \(1\.0 is 100 %\)"):
        cdp([2], [1], contrast)


@pytest.mark.parametrize("epsilon", [0, -0.5, 1.01, float("nan")])
def test_an_unusable_epsilon_is_refused(epsilon):
    with pytest.raises(InputError, match=f"epsilon is {epsilon}: give a fraction above 0, up to 1"):
        cdp([2], [1], 0.2, epsilon)


@pytest.mark.parametrize("regions", [([0, 0], [0]), ([-1, 0], [-5, 0])])
def test_regions_without_any_light_are_refused(regions):
    with pytest.raises(InputError, match="neither region holds a value above 0, so no contrast is defined: check"):
        cdp(*regions, 0.2)
