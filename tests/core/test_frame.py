"""Frames say what is known of their black level."""

import pytest

from labcdp.core.frame import nominal_black_dn


@pytest.mark.parametrize(("bits", "measured_dn"), [(8, 3.6), (12, 63.9), (16, 1022.7)])
def test_nominal_black_level_is_near_that_of_dark_frames_of_a_register_of_64(bits, measured_dn):
    assert nominal_black_dn(None, 64, bits) == pytest.approx(measured_dn, abs=0.5 * 2 ** (bits - 12) + 0.5)


def test_stated_black_level_counts_and_an_unknown_one_is_zero():
    assert nominal_black_dn(512.0, None, 14) == 512
    assert nominal_black_dn(0.0, 64, 12) == 0
    assert nominal_black_dn(None, None, 12) == 0
