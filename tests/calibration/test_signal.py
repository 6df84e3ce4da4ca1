from dataclasses import replace
from math import sqrt

import pytest

from labcdp.calibration.dark import DarkModel
from labcdp.calibration.noise import TemporalNoise
from labcdp.calibration.signal import combine, usable
from labcdp.calibration.unevenness import Unevenness

#: Darkness and noise of the simulated camera, exactly known.
DARK = DarkModel(64.0, 40.0, 0.0, 0.0, 0.0, 1.5, 0.0, (0.01,))
NOISE = TemporalNoise(0.25, 1.5)


def test_one_exposure(camera):
    signal = combine([camera.observe("grey", 10.0, 0.01, None)], DARK, NOISE)
    assert signal.rate_dn_s == pytest.approx(12_000)
    assert signal.variance_dn2_s2 == pytest.approx((0.25 * 120 + 1.5**2) / 1600 / 0.01**2)
    assert signal.dark_sensitivity == (pytest.approx(-100), pytest.approx(-1))
    assert (signal.fixed_pattern_rel, signal.nonuniformity_rel) == (0.0, 0.0)
    assert (signal.chi_squared, signal.degrees_of_freedom) == (pytest.approx(0, abs=1e-12), 0)


def test_exposures_are_weighted_by_inverse_variance(camera):
    observations = [camera.observe("grey", 10.0, t, None) for t in (0.01, 0.04)]
    alone = [combine([o], DARK, NOISE).variance_dn2_s2 for o in observations]
    assert combine(observations, DARK, NOISE).variance_dn2_s2 == pytest.approx(1 / (1 / alone[0] + 1 / alone[1]))


def test_rounding_does_not_average_down(camera):
    still = replace(camera.observe("grey", 10.0, 0.01, None), temporal_variance_dn2=0.0)
    signal = combine([still], DARK, TemporalNoise(0.0, 0.0))
    assert signal.variance_dn2_s2 == pytest.approx(1 / 12 / 0.01**2)


def test_an_uneven_dark_does_not_average_over_exposures(camera):
    uneven = replace(DARK, nonuniformity_dn=3.0)
    noise = TemporalNoise(0.0, 1e-6)
    observations = [camera.observe("grey", 10.0, 0.01, None)] * 4
    assert combine(observations, uneven, noise).variance_dn2_s2 == pytest.approx((3 / 0.01) ** 2, rel=1e-6)


def test_fixed_pattern_averages_over_pixels_and_slow_changes_do_not(camera):
    exact = camera.observe("grey", 10.0, 0.01, None)
    noise_of_mean_frame = exact.temporal_variance_dn2 / 4
    within, between = 9.0 + noise_of_mean_frame, 1009.0 + noise_of_mean_frame
    uneven = replace(exact, unevenness=Unevenness((within, 0.0, 0.0), (between, 0.0, 0.0), 15, 25.0))
    signal = combine([uneven], DARK, NOISE)
    assert signal.fixed_pattern_rel == pytest.approx(3 / sqrt(400) / 120)
    assert signal.nonuniformity_rel == pytest.approx(sqrt(1000 / 25) / 120)


def test_what_counts_as_brighter_than_the_dark(camera):
    still = TemporalNoise(0.0, 1.5)
    three_standard_uncertainties_dn = 3 * 1.5 / sqrt(1600)
    for factor, kept in ((0.99, 0), (1.01, 1)):
        luminance_cd_m2 = factor * three_standard_uncertainties_dn / (1200 * 0.01)
        assert len(usable([camera.observe("grey", luminance_cd_m2, 0.01, None)], DARK, still)[0]) == kept


def test_reasons_are_given_once_with_all_exposures(camera):
    observations = [camera.observe("lamp", 1e4, t, None) for t in (0.01, 0.04)]
    kept, warnings = usable(observations, DARK, NOISE)
    assert kept == []
    assert warnings == ["patch 'lamp' is saturated at 0.01 s, 0.04 s: left out there"]


def test_a_stray_hot_pixel_does_not_cost_the_patch(camera):
    hot = replace(camera.observe("grey", 10.0, 0.01, None), saturated_share=0.0009)
    assert usable([hot], DARK, NOISE) == ([hot], [])
