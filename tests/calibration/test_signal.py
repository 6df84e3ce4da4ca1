from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import pytest

from labcdp.calibration import GainSetting
from labcdp.calibration.frames.nonuniformity import Nonuniformity, nonuniformity
from labcdp.calibration.sensor.dark import DarkModel
from labcdp.calibration.sensor.noise import TemporalNoise, light_flicker
from labcdp.calibration.signal import net_signals, with_prnu
from labcdp.core.dn import Response

#: Darkness and noise of the simulated camera, exactly known.
DARK = DarkModel(64.0, 40.0, ((0.0,) * 3,) * 3, 1.5, 0.0, (0.01,))
SETTINGS = (GainSetting(0.0, 1.0, 0.0, DARK, TemporalNoise(0.25, 1.5)),)


def test_rounding_does_not_average_down_and_flicker_and_drift_over_the_frames_only(camera):
    seen, dark = camera.observe("grey", 10.0, 0.01, None), replace(DARK, noise_dn=0.0, drift_dn=0.5)
    still = replace(SETTINGS[0], dark=dark, noise=TemporalNoise(0.0, 0.0))
    assert net_signals([replace(seen, temporal_variance_dn2=0.0)], [still]).noise_variance_dn2 == pytest.approx(1 / 12)
    signal = net_signals([seen], [replace(SETTINGS[0], dark=dark, noise=TemporalNoise(0.25, 1.5, flicker_rel=0.01))])
    assert signal.frames_variance_dn2 == pytest.approx((0.01 * 120 / 2) ** 2 + (0.5 / 2) ** 2)


def test_fixed_pattern_averages_over_pixels_and_slow_changes_do_not(camera):
    exact = camera.observe("grey", 10.0, 0.01, None)
    noise_of_mean_frame = exact.temporal_variance_dn2 / 4
    within, between = 9.0 + noise_of_mean_frame, 1009.0 + noise_of_mean_frame
    uneven = replace(exact, nonuniformity=Nonuniformity((within, 0.0, 0.0), (between, 0.0, 0.0), 15, 25.0))
    # By chance one patch may show less than the noise, 5 DN^2 here: on average they show 2 DN^2.
    even = replace(exact, nonuniformity=Nonuniformity((noise_of_mean_frame - 5.0, 0.0, 0.0), (0.0,) * 3, 15, 25.0))
    signal = net_signals([uneven], [with_prnu(SETTINGS[0], [uneven, even])])
    assert signal.pixels_rel == pytest.approx(sqrt(2) / sqrt(400) / 120)
    assert signal.slow_rel == pytest.approx(sqrt(1000 / 25) / 120)


def test_the_dark_part_of_a_fixed_pattern_is_an_offset(camera):
    """A pattern of 5 DN, of which 3 DN were there in the dark, at 0.01 s; 4 DN are left for the sensitivity."""
    dark = replace(DARK, nonuniformity_dn=0.2, exposures_s=(0.0, 0.02), patterns_dn=(2.0, 4.0))
    exact = camera.observe("grey", 10.0, 0.01, None)
    within = 25.0 + exact.temporal_variance_dn2 / 4
    patterned = replace(exact, nonuniformity=Nonuniformity((within, 0.0, 0.0), (within, 0.0, 0.0), 15, 25.0))
    signal = net_signals([patterned], [replace(SETTINGS[0], dark=dark)])
    assert signal.pixels_variance_rel == pytest.approx((4 / 120) ** 2)
    assert signal.dark_nonuniformity_dn == pytest.approx(hypot(0.2, 3 / sqrt(400)))


def test_vignetting_is_not_nonuniformity_behind_a_tone_curve(camera):
    """Uniform light through a lens that darkens by 20 %: h / V is even where DN / V is not."""
    knots = np.geomspace(20, 3000, 400)
    tone = Response("table", (0.0, *knots.tolist()), (0.0, *(20 * (knots / 20) ** 2.2).tolist()))
    v = np.linspace(1.0, 0.8, 400)
    net_dn = 1000 * v ** (1 / 2.2)
    seen = nonuniformity((net_dn + 64.4) / v, 1 / v, np.ones((400, 1), np.bool_))
    exact = replace(camera.observe("grey", 10.0, 0.01, None), nonuniformity=seen, temporal_variance_dn2=1e-6)
    even = replace(exact, mean_dn=float(np.mean((net_dn + 64.4) / v)), mean_inverse_v=float(np.mean(1 / v)))
    for curve, least, most in ((tone, 0.0, 0.002), (None, 0.02, 1.0)):
        setting = replace(SETTINGS[0], noise=TemporalNoise(0.0, 0.0, curve))
        assert least <= net_signals([even], [setting]).slow_rel < most


def test_a_light_that_flickers_at_one_exposure_only_has_a_flicker_for_each(camera):
    """At 10 ms all frames of all patches agree better than noise lets them, at 20 ms the light changes by 2 %."""
    changes = {0.01: np.zeros(4), 0.02: np.array([0.02, -0.02, 0.02, -0.02])}
    seen = []
    for exposure_s, change in changes.items():
        for o in (camera.observe(name, 10.0, exposure_s, None) for name in "abcdef"):
            means_dn = o.mean_dn + o.net_dn(DARK.mean_dn(exposure_s)) * change
            seen.append(replace(o, frame_means_dn=tuple(means_dn)))
    (short, steady, _), (long, flickering, _) = light_flicker(seen, DARK).by_exposure
    assert (short, long, steady) == (0.01, 0.02, 0.0)
    assert flickering == pytest.approx(0.02 * sqrt(4 / 3), rel=0.01)
