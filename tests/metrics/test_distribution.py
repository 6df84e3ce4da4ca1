from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labcdp.core.errors import InputError
from labcdp.metrics import Distribution, cdp_range

INTEGER_TYPES = ["u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8"]


@pytest.mark.parametrize("kind", INTEGER_TYPES)
@given(st.data())
def test_integers_of_every_type_are_counted(kind, data):
    limits = np.iinfo(kind)
    elements = st.integers(max(limits.min, -(2**53)), min(limits.max, 2**53))
    pixels = data.draw(hnp.arrays(kind, hnp.array_shapes(max_dims=2), elements=elements))
    distribution = Distribution.from_array(pixels)
    expected = sorted(Counter(pixels.ravel().tolist()).items())
    assert list(zip(distribution.values, distribution.weights, strict=True)) == expected
    assert distribution.size == pixels.size


@pytest.mark.parametrize("kind", ["f2", "f4", "f8"])
@given(st.data())
def test_floats_of_every_type_are_counted(kind, data):
    elements = st.sampled_from([-1.5, -0.0, 0.0, 0.1, 1.0, 2.0, 300.25])
    pixels = data.draw(hnp.arrays(kind, st.integers(1, 20), elements=elements))
    distribution = Distribution.from_array(pixels)
    expected = sorted(Counter(pixels.tolist()).items())
    assert list(zip(distribution.values, distribution.weights, strict=True)) == expected
    assert distribution.size == pixels.size


def test_mean_total_and_cumulative_are_weighted():
    distribution = Distribution([-1, 0, 3], [1, 2, 5])
    assert (distribution.mean, distribution.total, distribution.not_positive) == (14 / 8, 8, 3 / 8)
    assert distribution.cumulative.tolist() == [0, 1, 3, 8]


def test_converting_the_distinct_values_equals_converting_each_pixel():
    rng = np.random.default_rng(2)
    a, b = rng.integers(100, 140, 500), rng.integers(120, 180, 700)

    def to_luminance(dn):
        return (dn - 64) / 17.3

    converted = cdp_range(*(Distribution.from_array(dn).map(to_luminance) for dn in (a, b)), [0.2])
    assert converted == cdp_range(to_luminance(a), to_luminance(b), [0.2])


@pytest.mark.parametrize(
    ("pixels", "message"),
    [
        ([], "pixels holds no pixel: give at least one"),
        ([1.0, np.nan], "pixels holds 1 values that are not finite: leave such pixels out"),
        ([-np.inf, 1.0], "pixels holds 1 values that are not finite: leave such pixels out"),
        ([np.nan], "pixels holds 1 values that are not finite"),
        ([True, False], "pixels has type bool: give integers or floats of at most 64 bit"),
        ([1 + 2j], "pixels has type complex128: give integers or floats"),
        (["1"], "pixels has type <U1: give integers or floats"),
        ([None], "pixels has type object: give integers or floats"),
        (np.array([1], np.longdouble), "pixels has type float128: give integers or floats of at most 64 bit"),
        ([[1], [1, 2]], "pixels is not an array: "),
        (np.ma.masked_equal([1, 2], 2), r"pixels is a masked array: give its valid pixels with \.compressed\(\)"),
        ([0, 2**53 + 1], r"pixels spans 0 to 9007199254740993: give integers up to 2\^53, or floating-point numbers"),
        (np.array([2**64 - 1], "u8"), "pixels spans 18446744073709551615 to 18446744073709551615: give integers"),
    ],
)
def test_unusable_pixels_are_refused(pixels, message):
    with pytest.raises(InputError, match=message):
        Distribution.from_array(pixels)


@pytest.mark.parametrize(
    ("values", "weights", "message"),
    [
        ([1, 2], [1], r"values have shape \(2,\), weights \(1,\): give two lists of equal length"),
        ([], [], r"values have shape \(0,\), weights \(0,\): give two lists"),
        ([2, 1], [1, 1], "values are not finite or not rising: sort them and join equal ones"),
        ([1, 1], [1, 1], "values are not finite or not rising"),
        ([1, np.inf], [1, 1], "values are not finite or not rising"),
        ([1, np.nan, 3], [1, 1, 1], "values are not finite or not rising"),
        ([1, 2], [1, -1], "weights are not finite, negative or all 0: give how often each value occurs"),
        ([1, 2], [0, 0], "weights are not finite, negative or all 0"),
        ([1, 2], [1, np.nan], "weights are not finite, negative or all 0"),
    ],
)
def test_values_and_weights_that_make_no_distribution_are_refused(values, weights, message):
    with pytest.raises(InputError, match=message):
        Distribution(values, weights)


def test_a_conversion_of_another_shape_is_refused():
    with pytest.raises(InputError, match=r"the conversion returned shape \(\) for \(2,\): it must convert each value"):
        Distribution([1, 2], [1, 1]).map(np.mean)
