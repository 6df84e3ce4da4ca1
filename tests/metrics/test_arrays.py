"""Contrasts as numbers, lists and arrays of any shape."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import labcdp

CONTRASTS = [0.1, 0.2, 0.5, 1.0, 2.5]
small = st.lists(st.integers(1, 30), min_size=1, max_size=6)


@given(
    bright=small,
    dark=small,
    contrasts=st.lists(st.sampled_from(CONTRASTS), max_size=4),
    epsilon=st.sampled_from([0.1, 0.5, 1]),
)
def test_array_of_contrasts_is_that_of_a_visit_of_every_pair(bright, dark, contrasts, epsilon):
    if Fraction(sum(dark), len(dark)) > Fraction(sum(bright), len(bright)):
        bright, dark = dark, bright
    found = [Fraction(b, d) - 1 for b in bright for d in dark]
    result = labcdp.cdp(bright, dark, np.array(contrasts), epsilon)
    for index, contrast in enumerate(map(Fraction, map(str, contrasts))):
        low, high = contrast * (1 - Fraction(str(epsilon))), contrast * (1 + Fraction(str(epsilon)))
        assert result.cdp[index] == pytest.approx(sum(low <= one <= high for one in found) / len(found), abs=1e-15)
        assert result.below[index] == pytest.approx(sum(one < low for one in found) / len(found), abs=1e-15)
        assert result.above[index] == pytest.approx(sum(one > high for one in found) / len(found), abs=1e-15)


@pytest.fixture
def regions():
    rng = np.random.default_rng(1)
    return rng.normal(120, 5, (20, 30)), rng.normal(100, 5, (15, 10))


@pytest.mark.parametrize("of", [labcdp.cdp, labcdp.cdp_neighbours])
def test_number_in_gives_numbers_out_and_an_array_an_array(of, regions, assert_array_equals_numbers):
    images = regions if of is labcdp.cdp else regions[:1]
    numbers = [of(*images, contrast) for contrast in CONTRASTS]
    for one in numbers:
        assert all(
            type(value) is float for value in (one.cdp, one.u, *one.interval, one.below, one.above, one.contrast)
        )
        assert one.interval.low <= one.cdp <= one.interval.high
    assert_array_equals_numbers(of(*images, CONTRASTS), numbers)
    assert_array_equals_numbers(of(*images, tuple(CONTRASTS)), numbers)
    assert_array_equals_numbers(of(*images, np.array(CONTRASTS)), numbers)
    square = of(*images, np.array(CONTRASTS[:4]).reshape(2, 2))
    assert square.cdp.shape == square.u.shape == square.interval.low.shape == (2, 2)
    np.testing.assert_array_equal(square.cdp.ravel(), [one.cdp for one in numbers[:4]])
    assert of(*images, np.float64(0.2)).cdp == numbers[1].cdp
    assert of(*images, []).cdp.shape == (0,)


def test_single_precision_contrast_is_the_decimal_it_is_written_as():
    bright, dark = np.arange(100, 140), np.full(4, 100)
    contrasts = np.array([0.1, 0.2, 0.3], np.float32)
    np.testing.assert_array_equal(
        labcdp.cdp(bright, dark, contrasts).cdp, labcdp.cdp(bright, dark, [0.1, 0.2, 0.3]).cdp
    )


@pytest.mark.parametrize("contrast", ["10%", "1", None, [[1], [1, 2]], {"a": 1}, True, [True], 1j, [0.1, "a"]])
def test_contrast_of_a_wrong_type_is_refused_in_one_sentence(contrast):
    with pytest.raises(
        labcdp.LabcdpError, match=r"^contrast is .*: give a number, or an array of numbers, as fractions$"
    ):
        labcdp.cdp([2], [1], contrast)
