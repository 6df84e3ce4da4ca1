"""Merges of exposures and the tone curve, against closed forms and sums over all outcomes."""

from dataclasses import replace
from itertools import pairwise
from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import poisson

from labcdp.chain.hdr import CaptureLadder, Hdr, merge_dn
from labcdp.chain.isp import ToneCurve
from labcdp.chain.signal import Capture
from labcdp.core.errors import InputError

EXPOSURES_S = (16e-3, 4e-3, 1e-3)


def capture(dn, exposure_s, **changes):
    fields = {"black_level_dn": 64.0, "saturation_dn": 4095.0, "k_dn_per_e": 0.5, "dark_noise_dn": 3.0} | changes
    return Capture(
        dn=np.array([dn]), exposure_s=exposure_s, dark_dn=64.0 + 200 * exposure_s, dn_per_lx=5e4 * exposure_s, **fields
    )


def bracket(*dn):
    """Captures of the three exposures, given by their DN above black level, longest first."""
    return [capture(np.add(one, 64.0), time) for one, time in zip(dn, EXPOSURES_S, strict=True)]


def test_normal_takes_the_longest_exposure_within_its_threshold():
    # Thresholds of three exposures in 20 bit: 101.59 and 10321.27.
    captures = bracket([101, 102, 4000, 4031], [25, 26, 2580, 2581], [6, 7, 640, 646])
    merged = Hdr("normal").merge(captures)
    np.testing.assert_array_equal(merged.dn, [[101, 4 * 26, 4 * 2580, 16 * 646]])


@pytest.mark.parametrize("method", ["normal", "linear", "weighted"])
def test_a_merge_has_the_scale_of_the_longest_exposure(method):
    captures = bracket([1600, 0, 4031], [400, 0, 4031], [100, 0, 4031])
    merged = Hdr(method).merge(captures[::-1])
    np.testing.assert_allclose(merged.dn, [[1600, 0, 16 * 4031]], rtol=1e-12)
    assert (merged.exposure_s, merged.black_level_dn, merged.dark_dn) == (16e-3, 0.0, pytest.approx(3.2))
    assert (merged.dn_per_lx, merged.saturation_dn) == (800.0, 16 * 4031)
    np.testing.assert_array_equal(merged.saturated, [[False, False, True]])


@pytest.mark.parametrize("method", ["normal", "linear", "weighted"])
def test_noise_in_dark_signal(method):
    count = 200_000
    rng = np.random.default_rng(1)
    captures = [replace(one, dn=rng.normal(64, 3, (1, count))) for one in bracket([0], [0], [0])]
    merged = Hdr(method).merge(captures)
    # "normal" rounds down; that adds a twelfth.
    variance = merged.dark_noise_dn**2 + (1 / 12 if method == "normal" else 0)
    assert merged.dn.std() == pytest.approx(sqrt(variance), rel=5 / sqrt(2 * count))


def ladder(ratio, count=3):
    return CaptureLadder.of_exposures(tuple(ratio**-i for i in range(count)), saturation_dn=1000.0, k_dn_per_e=1.0)


def moments(method, electrons):
    """Mean and standard deviation of the merge of two exposures of ratio 4 for shot noise alone, by all outcomes."""
    reach = 8 * sqrt(electrons) + 20
    counts = [
        np.arange(max(mean - reach, 0) // 1, mean + reach).reshape(shape)
        for mean, shape in ((electrons, (-1, 1)), (electrons / 4, (1, -1)))
    ]
    share = poisson.pmf(counts[0], electrons) * poisson.pmf(counts[1], electrons / 4)
    merged = merge_dn(method, 20, counts, ladder(4, 2))
    mean = float((share * merged).sum())
    return mean, sqrt(float((share * (merged - mean) ** 2).sum()))


@pytest.mark.parametrize("method", ["normal", "linear", "weighted"])
def test_values_below_a_whole_black_level_do_not_wrap_around(method):
    captures = [
        capture(np.array([62, 65], np.uint16), exposure_s, black_level_dn=black_level_dn)
        for black_level_dn in (64, 64.0)
        for exposure_s in EXPOSURES_S
    ]
    whole, real = (Hdr(method, bits=16).merge(pair).dn for pair in (captures[:3], captures[3:]))
    assert np.array_equal(whole, real)
    assert whole.max() < 100


def test_fading_has_no_bias_and_no_step_in_snr():
    for electrons in (5.0, 400.0, 520.0, 700.0, 850.0, 980.0, 1050.0):
        assert moments("weighted", electrons)[0] == pytest.approx(electrons, rel=1e-9)
    brighter = np.linspace(400, 1200, 81)

    def steepest(method):
        snr = [mean / deviation for mean, deviation in (moments(method, one) for one in brighter)]
        return min(after / before - 1 for before, after in pairwise(snr))

    # The SNR halves between 600 and 1000 electrons; evenly that is 1.7 % for each 10 electrons.
    assert steepest("weighted") > -0.03
    assert steepest("normal") < -0.1


@pytest.mark.parametrize(
    "captures",
    [
        [],
        [capture([1], 1e-3), capture([1], 1e-3)],
        [capture([1], 1e-3), capture([1, 2], 2e-3)],
        [capture([1], 1e-3), capture([1], 2e-3, k_dn_per_e=1.0)],
        [capture([1], 1e-3, saturation_dn=64.0)],
    ],
)
def test_captures_that_cannot_be_merged_are_refused(captures):
    with pytest.raises(InputError, match=r"exposure|shapes|differs between the captures|saturation is at 0 DN"):
        Hdr("linear").merge(captures)


def test_normal_leaves_a_clipped_exposure_below_its_threshold_rounds_down_and_ends_at_its_bits():
    captures = bracket([4031, 4030], [1000, 1000], [250, 250])
    # 48 bit in three exposures: the first threshold is 65536.
    np.testing.assert_array_equal(Hdr("normal", bits=48).merge(captures).dn, [[4000, 4030]])
    longest, shortest = capture([4095, 63, 4095], 10e-3), capture([164, 64, 4000], 3e-3)
    merged = Hdr("normal", bits=13).merge([longest, shortest])
    np.testing.assert_array_equal(merged.dn, [[333, -1, 8191]])


def test_linear_is_the_mean_of_what_is_not_clipped():
    captures = bracket([160, 4031, 4031, 4031], [36, 1100, 4031, 4031], [13, 260, 1200, 4031])
    expected = [(160 + 4 * 36 + 16 * 13) / 3, (4 * 1100 + 16 * 260) / 2, 16 * 1200, 16 * 4031]
    merged = Hdr("linear").merge(captures)
    np.testing.assert_allclose(merged.dn, [expected], rtol=1e-14)
    np.testing.assert_array_equal(merged.saturated, [[False, False, False, True]])


def test_codes_of_the_thesis_curve():
    # log2(1 + DN) * 256 / 20; 31 is 2^5 - 1, which lies exactly on 64.
    np.testing.assert_array_equal(
        ToneCurve().encode([0, 1, 2, 30, 31, 1023, 2**20 - 2, 2**20 - 1]), [0, 12, 20, 63, 64, 128, 255, 255]
    )
    # Values outside the range have the end codes.
    np.testing.assert_array_equal(ToneCurve(12, 8).encode([-5, -0.5, 4095, 4096, 1e9]), [0, 0, 255, 255, 255])


@given(st.integers(1, 30), st.integers(1, 12))
def test_every_code_is_decoded(isp_bits, bits):
    curve = ToneCurve(isp_bits, bits)
    codes = np.arange(2**bits)
    np.testing.assert_array_equal(curve.encode(curve.decode(codes)), codes)


@pytest.mark.parametrize(("isp_bits", "bits"), [(12, 8), (16, 10), (10, 4)])
def test_decoding_has_no_bias_within_a_code(isp_bits, bits):
    curve = ToneCurve(isp_bits, bits)
    dn = np.arange(2.0**curve.isp_bits)
    codes = curve.encode(dn)
    count = np.bincount(codes, minlength=2**curve.bits)
    mean = np.bincount(codes, dn, minlength=2**curve.bits)[count > 0] / count[count > 0]
    np.testing.assert_allclose(curve.decode(np.flatnonzero(count)), mean, rtol=1e-12)
