import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.chain.isp import ToneCurve


def test_codes_of_the_thesis_curve() -> None:
    # log2(1 + DN) * 256 / 20; 31 is 2^5 - 1, which lies exactly on 64.
    np.testing.assert_array_equal(
        ToneCurve().encode([0, 1, 2, 30, 31, 1023, 2**20 - 2, 2**20 - 1]), [0, 12, 20, 63, 64, 128, 255, 255]
    )


def test_values_outside_the_range_have_the_end_codes() -> None:
    np.testing.assert_array_equal(ToneCurve(12, 8).encode([-5, -0.5, 4095, 4096, 1e9]), [0, 0, 255, 255, 255])


@given(st.integers(1, 30), st.integers(1, 12))
def test_every_code_is_decoded(isp_bits: int, bits: int) -> None:
    curve = ToneCurve(isp_bits, bits)
    codes = np.arange(2**bits)
    np.testing.assert_array_equal(curve.encode(curve.decode(codes)), codes)


@pytest.mark.parametrize("curve", [ToneCurve(12, 8), ToneCurve(16, 10), ToneCurve(10, 4)])
def test_decoding_has_no_bias_within_a_code(curve: ToneCurve) -> None:
    dn = np.arange(2.0**curve.isp_bits)
    codes = curve.encode(dn)
    count = np.bincount(codes, minlength=2**curve.bits)
    mean = np.bincount(codes, dn, minlength=2**curve.bits)[count > 0] / count[count > 0]
    np.testing.assert_allclose(curve.decode(np.flatnonzero(count)), mean, rtol=1e-12)
