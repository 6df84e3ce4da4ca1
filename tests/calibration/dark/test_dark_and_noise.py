from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration.sensor.dark import fit_dark
from labcdp.calibration.sensor.noise import fit_noise
from labcdp.core.result import warning

EXPOSURES_S = (0.001, 0.01, 0.1)


def test_dark_line_through_exact_points(camera):
    dark, findings = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    assert findings == []
    assert dark.offset_dn == pytest.approx(64.0, abs=1e-9)
    assert dark.rate_dn_s == pytest.approx(40.0, abs=1e-7)
    assert dark.noise_dn == pytest.approx(1.5)
    assert dark.exposures_s == EXPOSURES_S


def test_frames_outside_the_temperatures_of_the_dark_frames_are_named(camera):
    dark, _ = fit_dark(warm_darks(camera, temperatures_c=(24.0, 25.0)))
    taken = [(0.01, 40.0), (0.1, 34.0), (0.1, 26.0), (0.1, None)]
    (found,) = dark.temperature_findings(taken)
    taken_at = {"exposure_s": 0.1, "temperature_c": 34.0, "lowest_c": 24.0, "highest_c": 25.0}
    assert found == warning("temperature-not-covered", **taken_at)
    assert dark.temperature_findings([(0.1, 26.9), (0.1, None), (1e-4, 40.0)]) == []


def test_what_a_line_cannot_be_is_named(camera):
    """An exposure that contradicts the others, and a dark signal that falls."""
    darks = [camera.dark(t, None) for t in (0.0005, 0.002, 0.008, 0.032)]
    for i, one in enumerate(darks):
        found = fit_dark([*darks[:i], replace(one, mean_dn=one.mean_dn + 20), *darks[i + 1 :]])[1][0]
        assert (found.code, found.values["exposure_s"]) == ("dark-contradicts", one.exposure_s)
    first, last = camera.dark(0.001, None), camera.dark(0.1, None)
    (found,) = fit_dark([replace(first, mean_dn=first.mean_dn + 40), last])[1]
    assert (found.code, found.values["rate_dn_s"]) == ("dark-falls", pytest.approx(364, abs=1))


def warm_darks(camera, rng=None, temperatures_c=(20.0, 35.0), doubling_c=7.0):
    """Dark frames at four exposures and several temperatures; 40 DN/s at 25 degC."""
    darks = []
    for temperature_c in temperatures_c:
        rate = 40.0 * 2 ** ((temperature_c - 25.0) / doubling_c)
        warm = replace(camera, dark_rate_dn_s=rate)
        darks += [replace(warm.dark(t, rng), temperature_c=temperature_c) for t in (0.001, 0.01, 0.1, 1.0)]
    return darks


def test_doubling_temperature_of_exact_darks(camera):
    dark, findings = fit_dark(warm_darks(camera))
    assert findings == []
    assert dark.doubling_temperature_c == pytest.approx(7.0, rel=1e-6)
    assert dark.temperature_c == pytest.approx(27.5)
    assert dark.mean_dn(0.5, 25.0) == pytest.approx(64 + 20.0)
    assert dark.mean_dn(0.5, 32.0) == pytest.approx(64 + 40.0)
    assert dark.mean_dn(0.5) == dark.mean_dn(0.5, 27.5)


def test_errors_of_the_dark_are_its_covariance(camera):
    dark, _ = fit_dark(warm_darks(camera))
    rows = dark.errors()
    assert rows.T @ rows == pytest.approx(np.array(dark.covariance), rel=1e-6, abs=1e-12)


def test_the_bend_near_saturation_is_left_out_and_repeated_frames_are_noticed(camera):
    dark, _ = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    seen = [camera.observe(f"P{v}", v, 0.01, None) for v in (1.0, 10.0, 100.0, 300.0)]
    bent = [*seen[:3], replace(seen[3], temporal_variance_dn2=5.0)]
    assert fit_noise(bent, dark)[0].k_dn_per_e == pytest.approx(0.25)
    noise, (found,) = fit_noise([replace(o, temporal_variance_dn2=0.0) for o in seen], dark)
    assert (noise.k_dn_per_e, found.code) == (0.0, "k-not-positive")
