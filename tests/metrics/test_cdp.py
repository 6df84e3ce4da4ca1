"""CDP between regions: every pair in exact arithmetic, closed forms, what is refused; and their distributions."""

from collections import Counter
from fractions import Fraction
from math import inf, nan, sqrt

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.stats import poisson

from labcdp.core.errors import InputError
from labcdp.metrics import DetectionInterval, Distribution, cdp, cdp_neighbours

from .closed_forms import NORMAL, share_of_normal

# 12-bit values around each other, so that ties, zeros and negative ones (darkness subtracted) are common.
region = st.lists(st.one_of(st.integers(-3, 12), st.integers(90, 130), st.integers(0, 4095)), min_size=1, max_size=10)
contrasts = st.one_of(st.sampled_from([0.1, 0.2, 0.3, 0.5, 0.7]), st.decimals("0.001", "0.999", places=3).map(float))
tolerance = st.one_of(st.none(), st.sampled_from([0.5, 1.0]), st.decimals("0", "1", places=2).map(float))


def exact(value):
    return Fraction(str(value))


@given(region, region, contrasts, tolerance, tolerance, st.sampled_from(["weber", "michelson"]))
def test_all_shares_are_those_of_exact_arithmetic(all_contrasts, a, b, contrast, below, above, definition):
    assume(max(a + b) > 0 and (below, above) not in [(None, None), (0, 0)])
    low = -inf if below is None else exact(contrast) * (1 - exact(below))
    high = inf if above is None else exact(contrast) * (1 + exact(above))
    flat = [value for row in all_contrasts(a, b) for value in row]
    if definition == "michelson":
        # Values below 0 count as 0.
        bright, dark = (a, b) if exact(sum(a)) * len(b) >= exact(sum(b)) * len(a) else (b, a)
        flat = [
            Fraction(max(x, 0) - max(d, 0), max(x, 0) + max(d, 0)) if max(x, d) > 0 else nan
            for d in dark
            for x in bright
        ]

    def share(condition):
        return float(Fraction(sum(map(condition, flat)), len(flat)))

    result = cdp(np.array(a), np.array(b), contrast, DetectionInterval(below, above), definition=definition)
    assert result.cdp == share(lambda value: low <= value <= high)
    assert result.above == share(lambda value: value > high)
    assert result.below == share(lambda value: not value >= low)
    assert result.undefined == pytest.approx(share(lambda value: value != value), abs=1e-15)
    assert result.detected_range == (float(low), float(high))


@given(region, region, st.lists(contrasts, min_size=1, max_size=3), st.decimals("0.01", "1", places=2).map(float))
def test_arrays_records_types_and_units_give_the_same(assert_array_equals_numbers, a, b, asked, epsilon):
    assume(max(a + b) > 0)
    array = cdp(a, b, np.array(asked), epsilon)
    assert_array_equals_numbers(array, [cdp(a, b, one, epsilon) for one in asked])
    for kind in (np.int16, np.float32, np.float64):
        for index, record in enumerate(cdp(np.array(a, kind), np.array(b, kind), asked, epsilon)):
            found = (record.cdp, record.below, record.above, record.u)
            alone = (array.cdp[index], array.below[index], array.above[index], array.u[index])
            np.testing.assert_array_equal(found, alone)
    assert repr(cdp(np.array(a) * 2.0**-7, np.array(b) * 2.0**-7, asked, epsilon)) == repr(cdp(a, b, asked, epsilon))


def test_the_end_of_an_interval_beyond_the_largest_number_is_not_open():
    # The pair with a dark value of 0 has an unbounded contrast.
    result = cdp([1.0, 2.0], [0.0, 1.0], 1.7e308)
    assert (result.cdp, result.above, result.below) == (0.0, 0.5, 0.5)


@pytest.mark.parametrize("of", [cdp, cdp_neighbours])
def test_number_in_gives_numbers_out_and_an_array_an_array(of):
    rng = np.random.default_rng(1)
    images = [rng.normal(120, 5, (20, 30)), rng.normal(100, 5, (15, 10))][: 2 if of is cdp else 1]
    one, square = of(*images, np.float64(0.2)), of(*images, [[0.1, 0.2], [0.5, 1.0]])
    assert type(one.cdp) is float
    assert square.cdp.shape == square.interval.low.shape == (2, 2)
    # A contrast in single precision is the decimal that it is written as.
    assert one.cdp == square.cdp[0, 1] == of(*images, np.array([0.2], np.float32)).cdp[0]


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("contrast", ["0.2800043", "0.6400127"])
def test_the_closest_miss_of_24_bit_integers_does_not_count(contrast, side):
    factor = 1 + Fraction(contrast) * (1 + side * Fraction("0.5"))
    numerator, denominator = factor.numerator, factor.denominator
    # Here bright * denominator and dark * numerator differ by 1: no pair this dark comes closer to the end.
    dark = pow(-side * numerator, -1, denominator)
    bright = (numerator * dark + side) // denominator
    assert max(dark, bright) < 2**24 < 2 * denominator
    assert cdp([bright], [dark], float(contrast)).cdp == 0


@pytest.mark.parametrize(("patches", "published"), NORMAL)
def test_normal_patches_give_the_closed_form(patches, published):
    dark, dark_std, bright, bright_std = patches
    contrast = bright / dark - 1
    closed_form = share_of_normal((bright, bright_std), (dark, dark_std), 0.5 * contrast, 1.5 * contrast)
    assert closed_form == pytest.approx(published, abs=5e-6)
    rng, n = np.random.default_rng(11), 40_000
    result = cdp(rng.normal(bright, bright_std, n), rng.normal(dark, dark_std, n), contrast)
    assert abs(result.cdp - published) < 4 * result.u
    exactly = cdp(Distribution.normal(bright, bright_std), Distribution.normal(dark, dark_std), contrast)
    assert exactly.cdp == pytest.approx(published, abs=1e-5)


def test_published_figures_of_michelson_contrast_shot_noise_and_veiling_glare():
    patches = Distribution.normal(120, 5), Distribution.normal(100, 5)
    assert cdp(*patches, 20 / 220, definition="michelson").cdp == pytest.approx(0.84057, abs=1e-5)
    quanta = np.arange(1000)
    result = cdp(*(Distribution(quanta, poisson.pmf(quanta, mean)) for mean in (250, 300)), 0.2)
    assert result.cdp == pytest.approx(0.6706, abs=5e-5)
    assert (result.swapped, result.pairs) == (True, None)
    assert np.isnan([result.u, *result.interval]).all()
    # 100 and 120 with 100 added to both, SNR 100: the contrast left is the lower end of the interval.
    assert cdp(Distribution.normal(220, 2.2), Distribution.normal(200, 2), 0.2).cdp == pytest.approx(0.5, abs=1e-4)


def test_long_float_regions_agree_with_a_plain_search():
    rng, n = np.random.default_rng(7), 70_000
    dark, bright = np.sort(rng.normal(1000, 30, n)), np.sort(rng.normal(1100, 35, n))
    per_dark = np.searchsorted(bright, 1.15 * dark) - np.searchsorted(bright, 1.05 * dark)
    per_bright = np.searchsorted(dark, bright / 1.05) - np.searchsorted(dark, bright / 1.15)
    result = cdp(rng.permutation(dark), rng.permutation(bright), 0.1)
    share = result.cdp
    assert share == per_dark.sum() / n**2
    scatter = np.var(per_dark / n) * n + np.var(per_bright / n) * n
    assert result.u == pytest.approx(sqrt(scatter - share * (1 - share)) / (n - 1), rel=1e-12)
    at_least = cdp(dark, bright, 0.1, DetectionInterval.at_least(0.5))
    assert at_least.cdp == pytest.approx(result.cdp + result.above, abs=1e-14)


REFUSED = [
    *({"contrast": value} for value in (0, -0.1, nan, inf, "10", None, [[1], [1, 2]], True, 1j, [0.1, "a"])),
    *({"epsilon": value} for value in (0, 1.01, nan)),
    *({"bright": [-1, 0], "dark": [-5, 0]}, {"bright": [1, nan]}),
    *({"definition": "rms"}, {"contrast": 1.0, "definition": "michelson"}),
]


@pytest.mark.parametrize("values", REFUSED, ids=str)
def test_what_cannot_be_used_is_refused_in_one_sentence(values):
    with pytest.raises(InputError, match=r"^[^\n]*(contrast|epsilon|region)[^\n]*: (give|check|leave|correct)[^\n]*\Z"):
        cdp(**({"bright": [2], "dark": [1], "contrast": 0.2} | values))


@pytest.mark.parametrize("ends", [(None, None), (1.1, None), (0.1, inf), (0, 0)])
def test_detection_intervals_without_an_extent_are_refused(ends):
    with pytest.raises(InputError, match=r"detection interval|tolerance .* the contrast"):
        DetectionInterval(*ends)


FLOATS = st.sampled_from([-1.5, -0.0, 0.0, 0.1, 1.0, 2.0, 300.25])


@given(st.sampled_from(["u1", "u2", "u8", "i4", "i8", "f2", "f4", "f8"]), st.data())
def test_values_of_every_type_are_counted(kind, data):
    elements = FLOATS
    if kind[0] != "f":
        limits = np.iinfo(kind)
        elements = st.integers(max(limits.min, -(2**53)), min(limits.max, 2**53))
    pixels = data.draw(hnp.arrays(kind, hnp.array_shapes(max_dims=2), elements=elements))
    distribution = Distribution.from_array(pixels)
    expected = sorted(Counter(pixels.ravel().tolist()).items())
    assert list(zip(distribution.values, distribution.weights, strict=True)) == expected
    assert distribution.size == pixels.size


def test_mean_total_and_cumulative_are_weighted():
    distribution = Distribution([-1, 0, 3], [1, 2, 5])
    assert (distribution.mean, distribution.total, distribution.not_positive) == (14 / 8, 8, 3 / 8)
    assert distribution.cumulative.tolist() == [0, 1, 3, 8]


def test_converting_the_distinct_values_equals_converting_each_pixel():
    rng = np.random.default_rng(2)
    regions = rng.integers(100, 140, 500), rng.integers(120, 180, 700)
    converted = cdp(*(Distribution.from_array(dn).map(lambda dn: (dn - 64) / 17.3) for dn in regions), [0.2])
    assert repr(converted) == repr(cdp(*((dn - 64) / 17.3 for dn in regions), [0.2]))


LONG, MASKED = np.array([1], np.longdouble), np.ma.masked_equal([1, 2], 2)


@pytest.mark.parametrize("pixels", [[], [-np.inf, 1.0], [True, False], LONG, [[1], [1, 2]], MASKED, [0, 2**53 + 1]])
def test_what_makes_no_distribution_is_refused(pixels):
    with pytest.raises(InputError, match=r"^pixels "):
        Distribution.from_array(pixels)


def test_contrasts_are_exact_whatever_the_print_options():
    """Other packages choose the options of NumPy 1.13, with 12 digits."""
    contrast = 0.12345678901234567
    with np.printoptions(legacy="1.13"):
        assert cdp([120, 121], [100, 101], np.array([contrast])).contrast[0] == contrast
        assert cdp([120, 121], [100, 101], np.array([0.2], np.float32)).contrast[0] == 0.2
