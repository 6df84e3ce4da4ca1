from dataclasses import replace
from math import hypot, sqrt

import pytest

from labcdp.calibration import GainSetting
from labcdp.calibration.dark.signal import DarkModel
from labcdp.calibration.frames.nonuniformity import Nonuniformity
from labcdp.calibration.noise import TemporalNoise
from labcdp.calibration.signal import net_signal

#: Darkness and noise of the simulated camera, exactly known.
DARK = DarkModel(64.0, 40.0, ((0.0,) * 3,) * 3, 1.5, 0.0, (0.01,))
SETTINGS = (GainSetting(0.0, 1.0, 0.0, DARK, TemporalNoise(0.25, 1.5)),)


def test_rounding_does_not_average_down(camera):
    still = replace(camera.observe("grey", 10.0, 0.01, None), temporal_variance_dn2=0.0)
    settings = [replace(SETTINGS[0], dark=replace(DARK, noise_dn=0.0), noise=TemporalNoise(0.0, 0.0))]
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
    uneven = replace(exact, nonuniformity=Nonuniformity((within, 0.0, 0.0), (between, 0.0, 0.0), 15, 25.0))
    signal = net_signal(uneven, SETTINGS)
    assert signal.pixels_rel == pytest.approx(3 / sqrt(400) / 120)
    assert signal.slow_rel == pytest.approx(sqrt(1000 / 25) / 120)


def test_the_dark_part_of_a_fixed_pattern_is_an_offset(camera):
    """A pattern of 5 DN, of which 3 DN were there in the dark, at 0.01 s; 4 DN are left for the sensitivity."""
    dark = replace(DARK, nonuniformity_dn=0.2, exposures_s=(0.0, 0.02), patterns_dn=(2.0, 4.0))
    exact = camera.observe("grey", 10.0, 0.01, None)
    within = 25.0 + exact.temporal_variance_dn2 / 4
    patterned = replace(exact, nonuniformity=Nonuniformity((within, 0.0, 0.0), (within, 0.0, 0.0), 15, 25.0))
    signal = net_signal(patterned, [replace(SETTINGS[0], dark=dark)])
    assert signal.pixels_rel == pytest.approx(4 / sqrt(400) / 120)
    assert signal.dark_nonuniformity_dn == pytest.approx(hypot(0.2, 3 / sqrt(400)))
