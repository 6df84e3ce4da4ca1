import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.metrics import michelson_contrast, weber_contrast


def test_michelson_contrast_is_difference_over_sum():
    assert michelson_contrast([3, 1, 2], [1, 3, 2]).tolist() == [0.5, -0.5, 0]
    assert michelson_contrast([[2.0], [3.0]], [1, 2]).shape == (2, 2)


@given(st.integers(1, 4095), st.integers(1, 4095))
def test_michelson_follows_from_weber_contrast(bright, dark):
    weber = float(weber_contrast(bright, dark))
    assert float(michelson_contrast(bright, dark)) == pytest.approx(weber / (weber + 2), abs=1e-15)
