import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.contrast import michelson_contrast, weber_contrast
from labcdp.errors import InputError


def test_michelson_contrast_is_difference_over_sum():
    assert michelson_contrast([3, 1, 2], [1, 3, 2]).tolist() == [0.5, -0.5, 0]
    assert michelson_contrast([[2.0], [3.0]], [1, 2]).shape == (2, 2)


@given(st.integers(1, 4095), st.integers(1, 4095))
def test_michelson_follows_from_weber_contrast(bright, dark):
    weber = float(weber_contrast(bright, dark))
    assert float(michelson_contrast(bright, dark)) == pytest.approx(weber / (weber + 2), abs=1e-15)


def test_values_below_0_count_as_0():
    assert michelson_contrast([5, 5, 0, -2], [0, -1, 4, 4]).tolist() == [1, 1, -1, -1]
    assert np.isnan(michelson_contrast([0, -1], [-3, 0])).all()


def test_what_is_no_number_is_refused():
    with pytest.raises(InputError, match="bright has type bool: give integers or floats"):
        michelson_contrast(True, 1)
