from dataclasses import replace
from math import hypot, sqrt

import pytest

from labcdp.calibration import GainSetting
from labcdp.calibration.dark import DarkModel
from labcdp.calibration.noise import TemporalNoise
from labcdp.calibration.signal import net_signal, usable
from labcdp.calibration.unevenness import Unevenness
from labcdp.errors import CalibrationError

#: Darkness and noise of the simulated camera, exactly known.
DARK = DarkModel(64.0, 40.0, ((0.0,) * 3,) * 3, 1.5, 0.0, (0.01,))
SETTINGS = (GainSetting(0.0, 1.0, 0.0, DARK, TemporalNoise(0.25, 1.5)),)


def test_signal_above_dark(camera):
    signal = net_signal(camera.observe("grey", 10.0, 0.01, None), SETTINGS)
    assert (signal.net_dn, signal.scale_per_s) == (pytest.approx(120), pytest.approx(100))
    assert signal.noise_variance_dn2 == pytest.approx((0.25 * 120 + 1.5**2) / 1600)
    assert (signal.pixels_rel, signal.slow_rel, signal.dark_variance_dn2) == (0.0, 0.0, 0.0)


def test_rounding_does_not_average_down(camera):
    still = replace(camera.observe("grey", 10.0, 0.01, None), temporal_variance_dn2=0.0)
    settings = [replace(SETTINGS[0], noise=TemporalNoise(0.0, 0.0))]
    assert net_signal(still, settings).noise_variance_dn2 == pytest.approx(1 / 12)


def test_the_dark_of_the_frames_temperature_is_taken_off(camera):
    warm = replace(DARK, temperature_c=20.0, doubling_temperature_c=8.0)
    observation = replace(camera.observe("grey", 10.0, 0.01, None), temperature_c=28.0)
    signal = net_signal(observation, [replace(SETTINGS[0], dark=warm)])
    assert signal.net_dn == pytest.approx(120 - 0.4)


def test_fixed_pattern_averages_over_pixels_and_slow_changes_do_not(camera):
    exact = camera.observe("grey", 10.0, 0.01, None)
    noise_of_mean_frame = exact.temporal_variance_dn2 / 4
    within, between = 9.0 + noise_of_mean_frame, 1009.0 + noise_of_mean_frame
    uneven = replace(exact, unevenness=Unevenness((within, 0.0, 0.0), (between, 0.0, 0.0), 15, 25.0))
    signal = net_signal(uneven, SETTINGS)
    assert signal.pixels_rel == pytest.approx(3 / sqrt(400) / 120)
    assert signal.slow_rel == pytest.approx(sqrt(1000 / 25) / 120)


def test_the_dark_part_of_a_fixed_pattern_is_an_offset(camera):
    """A pattern of 5 DN, of which 3 DN were there in darkness, at 0.01 s; 4 DN are left for the sensitivity."""
    dark = replace(DARK, nonuniformity_dn=0.2, exposures_s=(0.0, 0.02), patterns_dn=(2.0, 4.0))
    exact = camera.observe("grey", 10.0, 0.01, None)
    within = 25.0 + exact.temporal_variance_dn2 / 4
    patterned = replace(exact, unevenness=Unevenness((within, 0.0, 0.0), (within, 0.0, 0.0), 15, 25.0))
    signal = net_signal(patterned, [replace(SETTINGS[0], dark=dark)])
    assert signal.pixels_rel == pytest.approx(4 / sqrt(400) / 120)
    assert signal.dark_nonuniformity_dn == pytest.approx(hypot(0.2, 3 / sqrt(400)))


def test_what_counts_as_brighter_than_the_dark(camera):
    still = [replace(SETTINGS[0], noise=TemporalNoise(0.0, 1.5))]
    three_standard_uncertainties_dn = 3 * 1.5 / sqrt(1600)
    for factor, kept in ((0.99, 0), (1.01, 1)):
        luminance_cd_m2 = factor * three_standard_uncertainties_dn / (1200 * 0.01)
        assert len(usable([camera.observe("grey", luminance_cd_m2, 0.01, None)], still)[0]) == kept


def test_reasons_are_given_once_with_all_exposures(camera):
    observations = [camera.observe("lamp", 1e4, t, None) for t in (0.01, 0.04)]
    kept, left_out, warnings = usable(observations, SETTINGS)
    assert kept == []
    assert [(row.patch, row.exposure_s, row.reason) for row in left_out] == [
        ("lamp", 0.01, "is saturated"),
        ("lamp", 0.04, "is saturated"),
    ]
    assert warnings == ["patch 'lamp' is saturated at 0.01 s, 0.04 s: left out there"]


def test_a_stray_hot_pixel_does_not_cost_the_patch(camera):
    hot = replace(camera.observe("grey", 10.0, 0.01, None), saturated_share=0.0009)
    assert usable([hot], SETTINGS) == ([hot], [], [])


def test_another_gain(camera):
    other = replace(camera.observe("grey", 10.0, 0.01, None), state=replace(camera.state, gain_db=6.0))
    with pytest.raises(CalibrationError, match=r"is for a gain of 0 dB, not 6 dB: calibrate this gain too"):
        net_signal(other, SETTINGS)
