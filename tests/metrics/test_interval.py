from fractions import Fraction
from math import inf

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.metrics import DetectionInterval, Distribution, cdp, cdp_range, contrast_range

region = st.lists(st.one_of(st.integers(-3, 12), st.integers(90, 130)), min_size=1, max_size=10)
tolerance = st.one_of(st.none(), st.decimals("0", "1", places=2).map(float))
contrasts = st.decimals("0.01", "0.99", places=2).map(float)


def detected(value, low, high):
    """Whether a contrast (Fraction, inf or nan) counts; undefined ones never do."""
    return value == value and (low is None or value >= low) and (high is None or value <= high)


def share(pairs, condition):
    flat = [value for row in pairs for value in row]
    return float(Fraction(sum(map(condition, flat)), len(flat)))


@given(region, region, contrasts, tolerance, tolerance)
def test_each_end_is_that_of_exact_arithmetic_or_open(all_contrasts, a, b, contrast, below, above):
    assume(max(a + b) > 0 and (below, above) not in [(None, None), (0, 0)])
    asked = Fraction(str(contrast))
    low = None if below is None else asked * (1 - Fraction(str(below)))
    high = None if above is None else asked * (1 + Fraction(str(above)))
    pairs = all_contrasts(a, b)
    result = cdp(a, b, contrast, DetectionInterval(below, above))
    assert result.cdp == share(pairs, lambda value: detected(value, low, high))
    assert result.below == share(pairs, lambda value: value != value or (low is not None and value < low))
    assert result.above == share(pairs, lambda value: high is not None and value > high)
    assert result.below + result.cdp + result.above == pytest.approx(1, abs=1e-15)
    assert result.detected == (-inf if low is None else float(low), inf if high is None else float(high))


@given(region, region, contrasts, st.decimals("0.01", "1", places=2).map(float))
def test_michelson_cdp_is_that_of_exact_arithmetic(a, b, contrast, epsilon):
    assume(max(a + b) > 0)
    bright, dark = (a, b) if Fraction(sum(a), len(a)) >= Fraction(sum(b), len(b)) else (b, a)
    low, high = (Fraction(str(contrast)) * (1 + sign * Fraction(str(epsilon))) for sign in (-1, 1))

    def michelson(x, d):
        x, d = max(x, 0), max(d, 0)
        return Fraction(x - d, x + d) if x + d else float("nan")

    pairs = [[michelson(x, d) for x in bright] for d in dark]
    result = cdp(a, b, contrast, epsilon, definition="michelson")
    assert result.cdp == share(pairs, lambda value: low <= value <= high)
    assert result.above == share(pairs, lambda value: value > high)
    assert result.definition == "michelson"
    assert result.detected == (float(low), float(high))


def test_michelson_cdp_of_normal_patches_is_the_published_one():
    patches = Distribution.normal(120, 5), Distribution.normal(100, 5)
    assert cdp(*patches, 20 / 220, definition="michelson").cdp == pytest.approx(0.84057, abs=1e-5)


def test_long_regions_without_an_end_agree_with_a_symmetric_interval():
    rng_values = [(k * 7919) % 99_991 / 1000 + 1 for k in range(70_000)]
    a, b = [value + 20 for value in rng_values], rng_values
    both = cdp(a, b, 0.4, 0.5)
    at_least = cdp(a, b, 0.4, DetectionInterval.at_least(0.5))
    at_most = cdp(a, b, 0.4, DetectionInterval.at_most(0.5))
    assert at_least.cdp == pytest.approx(both.cdp + both.above, abs=1e-14)
    assert at_most.cdp == pytest.approx(both.below + both.cdp, abs=1e-14)


@given(region, region, st.lists(contrasts, max_size=4))
def test_a_range_of_contrasts_equals_single_ones(assert_array_equals_numbers, a, b, asked):
    assume(max(a + b) > 0)
    for definition in ("weber", "michelson"):
        array = cdp(a, b, np.array(asked), 0.3, definition=definition)
        assert_array_equals_numbers(array, [cdp(a, b, one, 0.3, definition=definition) for one in asked])
        for index, record in enumerate(cdp_range(a, b, asked, 0.3, definition=definition)):
            assert (array.cdp[index], array.below[index], array.above[index]) == (
                *(record.cdp, record.below, record.above),
            )


def test_contrasts_are_the_decimals_typed_and_both_ends_are_in():
    tenths = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    assert contrast_range(0.1, 1.0, 0.1) == tenths
    assert contrast_range(0.3, 0.3, 5) == (0.3,)
    assert contrast_range(1, 10, 4.5) == (1, 5.5, 10)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, 1, 0.1), r"start of the contrasts is 0: give a fraction above 0 \(1\.0 is 100 %\)"),
        ((0.1, inf, 0.1), "stop of the contrasts is inf: give a fraction above 0"),
        ((0.1, 1, -0.1), r"step of the contrasts is -0\.1: give a fraction above 0"),
        ((1, 0.1, 0.1), r"contrasts run from 1 down to 0\.1: give the smaller one first"),
        ((0.1, 1, 0.4), r"steps of 0\.4 from 0\.1 do not meet 1: end at 0\.9 or 1\.3"),
    ],
)
def test_unusable_ranges_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        contrast_range(*arguments)


@pytest.mark.parametrize(
    ("below", "above", "message"),
    [
        (None, None, "the detection interval has no end: give a tolerance below or above the contrast"),
        (1.1, None, r"tolerance below the contrast is 1\.1: give a fraction from 0 to 1, or None"),
        (float("nan"), 0.1, "tolerance below the contrast is nan"),
        (0.1, -0.1, r"tolerance above the contrast is -0\.1: give a fraction of 0 or more, or None"),
        (0.1, inf, "tolerance above the contrast is inf"),
        (0, 0, "both tolerances of the detection interval are 0: give one above 0, or None"),
    ],
)
def test_unusable_intervals_are_refused(below, above, message):
    with pytest.raises(InputError, match=message):
        DetectionInterval(below, above)


def test_unusable_definitions_and_michelson_contrasts_are_refused():
    with pytest.raises(InputError, match=r"Michelson contrast is 1\.0: give a fraction above 0 and below 1"):
        cdp([2], [1], 1.0, definition="michelson")
    with pytest.raises(InputError, match="contrast definition is 'rms': give 'weber' or 'michelson'"):
        cdp([2], [1], 0.5, definition="rms")
    with pytest.raises(InputError, match=r"contrast is -0\.1: give a fraction above 0"):
        cdp_range([2], [1], [0.1, -0.1])
