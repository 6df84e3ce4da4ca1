from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import GainSetting
from labcdp.calibration.convert.conversion import to_luminance
from labcdp.calibration.fit_records import FitError
from labcdp.calibration.sensor.dark import DarkModel
from labcdp.calibration.sensor.dark_library import DarkLibrary
from labcdp.calibration.sensor.noise import TemporalNoise
from labcdp.core.dn import Response
from labcdp.core.errors import CalibrationError
from labcdp.core.vignetting import RadialVignetting

from ..conftest import make_frame

SHAPE = (48, 64)
R, K, S, OFFSET, RATE = 1200.0, 0.25, 1.5, 64.0, 40.0
FALL_OFF = RadialVignetting(-0.4, 0.05, 0.0, covariance=((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 0.0)))


def every_dn(exposure_s=0.008):
    """A frame with all DN, at all places."""
    dn = np.random.default_rng(1).permutation(np.arange(48 * 64)) * 4096 // (48 * 64)
    dn[:21] = [*range(60, 80), 4095]
    return make_frame(dn.reshape(SHAPE), exposure_s)


def brute_force(calibration, frame, v, pattern=0.0, h=lambda n: n, slope=lambda n: 1.0):
    """The definition, pixel by pixel."""
    net = frame.dn - OFFSET - RATE * frame.exposure_s
    scale = R * frame.exposure_s * v
    luminance = h(net - pattern) / scale
    error = slope(net) * np.sqrt(K * np.maximum(net, 0) + S**2) / scale
    low, high = calibration.range_cd_m2
    outside = (luminance + 3 * error < low) | (luminance - 3 * error > high)
    flags = 1 * (frame.dn >= 4095) + 2 * (luminance < 0) + 4 * outside
    return luminance, error / np.abs(luminance), flags


@pytest.mark.parametrize("vignetting", [None, FALL_OFF])
@pytest.mark.parametrize("range_cd_m2", [(2.0, 300.0), (50.0, 51.0)])
def test_luminance_noise_and_flags_are_those_of_the_definition(make_calibration, range_cd_m2, vignetting):
    """Vignetting is taken off before the range is judged."""
    calibration, frame = make_calibration(range_cd_m2=range_cd_m2, vignetting=vignetting), every_dn()
    seen = to_luminance(replace(calibration, noise=replace(calibration.noise, prnu_rel=0.03)), frame)
    v = 1.0 if vignetting is None else vignetting.relative_illuminance(SHAPE)
    luminance, random_rel, flags = brute_force(calibration, frame, v)
    np.testing.assert_allclose(seen.luminance_cd_m2, luminance, rtol=1e-6)
    np.testing.assert_allclose(seen.random_rel, np.hypot(random_rel, 0.03), rtol=1e-6)
    assert (seen.invalid == flags).all()


def test_a_quadratic_response_is_linearised_and_not_continued(make_calibration):
    response = Response("quadratic", (0.0, 4000.0), (0.0, 4800.0))
    calibration = make_calibration(response=response, range_net_dn=(5.0, 3000.0), range_cd_m2=(1e-6, 1e9))
    frame, bend = every_dn(), 0.2 / 4000
    seen = to_luminance(calibration, frame)

    def h(n):
        return np.where(n < 0, n, np.where(n > 4000, 4800 + 1.4 * (n - 4000), n * (1 + bend * n)))

    slope = lambda n: np.clip(1 + 2 * bend * n, 1, 1.4)  # noqa: E731
    luminance, random_rel, flags = brute_force(calibration, frame, 1.0, h=h, slope=slope)
    np.testing.assert_allclose([seen.luminance_cd_m2, seen.random_rel], [luminance, random_rel], rtol=1e-6)
    net = frame.dn - OFFSET - RATE * 0.008
    beyond = net - 3 * np.sqrt(K * np.maximum(net, 0) + S**2) > 3000
    assert (seen.invalid == flags | np.where(beyond, 4, 0)).all()


def test_dark_signal_nonuniformity_counts_by_the_slope_at_each_signal(make_calibration):
    dark = DarkModel(OFFSET, RATE, ((0.04, 0, 0), (0, 0, 0), (0, 0, 0)), S, 0.3, (0.001, 0.064))
    response = Response("quadratic", (0.0, 4000.0), (0.0, 4800.0))
    frame = make_frame(np.full(SHAPE, 2000), 0.008)
    slope = 1 + 2 * 0.2 / 4000 * (2000 - OFFSET - RATE * frame.exposure_s)
    for own, expected in ((Response(), 1.0), (response, slope)):
        seen = to_luminance(make_calibration(dark=dark, response=own, range_net_dn=(5.0, 3000.0)), frame)
        assert seen.slow_cd_m2 == pytest.approx(0.3 * expected / (R * frame.exposure_s), rel=1e-6)


def test_another_gain_has_its_own_dark_noise_and_factor(make_calibration):
    dark = DarkModel(70.0, 80.0, ((0.04, 0, 0), (0, 0, 0), (0, 0, 0)), 3.0, 0.0, (0.001, 0.064))
    calibration = make_calibration(gains=(GainSetting(6.0, 2.0, 0.001, dark, TemporalNoise(0.5, 3.0)),))
    seen = to_luminance(calibration, make_frame(np.full(SHAPE, 1000), 0.008, gain_db=6.0))
    net = 1000 - 70 - 80 * 0.008
    assert seen.luminance_cd_m2 == pytest.approx(net / (2 * R * 0.008), rel=1e-6)
    assert seen.random_rel == pytest.approx(np.sqrt(0.5 * net + 9) / net, rel=1e-6)
    with pytest.raises(CalibrationError, match=r"gain of the calibration is 0 dB or 6 dB, but frame 0 has 12 dB"):
        to_luminance(calibration, make_frame(np.full(SHAPE, 1000), 0.008, gain_db=12.0))


def test_a_warmer_frame_has_more_dark_signal_and_its_error(make_calibration):
    covariance = ((0.04, 0, 0), (0, 0, 0), (0, 0, (1 / 22.5) ** 2))
    dark = DarkModel(64.0, 4000.0, covariance, 1.5, 0.0, (0.001, 0.064), (23.0, 23.0), 23.0)
    calibration = make_calibration(
        dark=dark, fit_errors=(FitError("dark and temperature", (1.0, 4095.0), (0.0, 0.0), (), (0, 0, 1 / 22.5), 0.0),)
    )
    for temperature_c in (24.0, 30.5):
        seen = to_luminance(calibration, make_frame(np.full(SHAPE, 1000), 0.008, temperature_c=temperature_c))
        growth = 2 ** ((temperature_c - 23) / 7.5)
        net = 1000 - 64 - 4000 * 0.008 * growth
        assert seen.luminance_cd_m2 == pytest.approx(net / (R * 0.008), rel=1e-6)
        by_growth_dn = 4000 * 0.008 * growth * np.log(2) * (temperature_c - 23) / 22.5
        assert seen.common[3].relative == pytest.approx(-by_growth_dn / net, rel=1e-5)


def test_common_errors_are_those_of_the_calibration_and_of_the_vignetting(make_calibration):
    frame = every_dn()
    plain, curved = (to_luminance(make_calibration(vignetting=v), frame) for v in (None, FALL_OFF))
    sources = [e.source for e in plain.common]
    assert sources == ["meter scale", "exposure time", "unknown temperature", "fit", "dark and temperature"]
    assert [e.source for e in curved.common] == [*sources, "flat field", "flat field"]
    net = frame.dn - OFFSET - RATE * 0.008
    np.testing.assert_allclose(plain.common[4].relative, -0.2 / net, rtol=1e-5)
    for seen in (plain, curved):
        total = np.sqrt(sum(np.square(e.relative, dtype=float) for e in seen.common))
        np.testing.assert_allclose(seen.common_rel, np.broadcast_to(total, SHAPE), rtol=1e-5)
    # An error of V makes the opposite error of L.
    for error, pattern in zip(curved.common[5:], FALL_OFF.common_patterns(SHAPE), strict=True):
        np.testing.assert_allclose(error.relative, -pattern, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("vignetting", [None, FALL_OFF])
def test_the_dark_pattern_is_taken_off(make_calibration, vignetting):
    pattern = np.random.default_rng(2).normal(0, 3, SHAPE)
    pattern -= pattern.mean()
    shapes = ((1e-4, 0.0), (0.0, 0.0)), ((float(pattern.var()), 0.0), (0.0, 0.0))
    library = DarkLibrary(pattern, np.zeros(SHAPE), *shapes, None, None, 64)
    calibration = make_calibration(dark_library=library, vignetting=vignetting)
    frame = every_dn()
    v = 1.0 if vignetting is None else vignetting.relative_illuminance(SHAPE)
    luminance, _, flags = brute_force(calibration, frame, v, pattern.astype(np.float32))
    seen = to_luminance(calibration, frame)
    np.testing.assert_allclose(seen.luminance_cd_m2, luminance, rtol=1e-5, atol=1e-5)
    assert np.count_nonzero(seen.invalid != flags) <= 2  # pixels on an edge, in float32
    net = frame.dn - OFFSET - RATE * 0.008
    bright = net > 500
    expected = np.sqrt(K * np.maximum(net, 0) + S**2 + 0.01**2) / (net - pattern)
    np.testing.assert_allclose(seen.random_rel[bright], expected[bright], rtol=1e-4)
