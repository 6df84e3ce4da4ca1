from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.metrics import contrast_quantile

region = st.lists(st.one_of(st.integers(-2, 8), st.integers(90, 130)), min_size=1, max_size=10)


@given(region, region, st.integers(0, 20))
def test_it_is_the_smallest_contrast_the_share_reaches(all_contrasts, a, b, twentieths):
    assume(max(a + b) > 0)
    flat = [value for row in all_contrasts(a, b) for value in row]
    ordered = sorted((max(value, -1) for value in flat if value == value), key=float)
    place = -((-twentieths * len(flat)) // 20) - (len(flat) - len(ordered))
    found = contrast_quantile(a, b, float(Fraction(twentieths, 20)))
    if place <= 0 and len(ordered) < len(flat):
        assert np.isnan(found)
    else:
        assert found == pytest.approx(float(ordered[max(place, 1) - 1]), rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("probability", [-0.1, 1.1, float("nan")])
def test_unusable_probabilities_are_refused(probability):
    with pytest.raises(InputError, match=f"probability is {probability}: give a number from 0 to 1"):
        contrast_quantile([2], [1], probability)
