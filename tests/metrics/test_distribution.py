from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labcdp.core.errors import InputError
from labcdp.metrics import Distribution, cdp_range

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
    converted = cdp_range(*(Distribution.from_array(dn).map(lambda dn: (dn - 64) / 17.3) for dn in regions), [0.2])
    assert converted == cdp_range(*((dn - 64) / 17.3 for dn in regions), [0.2])


LONG, MASKED = np.array([1], np.longdouble), np.ma.masked_equal([1, 2], 2)


@pytest.mark.parametrize("pixels", [[], [-np.inf, 1.0], [True, False], LONG, [[1], [1, 2]], MASKED, [0, 2**53 + 1]])
def test_what_makes_no_distribution_is_refused(pixels):
    with pytest.raises(InputError, match=r"^pixels "):
        Distribution.from_array(pixels)
