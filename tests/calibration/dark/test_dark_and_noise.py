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


def spoiled(camera, index, by_dn):
    """Dark frames at four exposures, one of them too bright."""
    darks = [camera.dark(t, None) for t in (0.0005, 0.002, 0.008, 0.032)]
    return [replace(d, mean_dn=d.mean_dn + by_dn) if i == index else d for i, d in enumerate(darks)]


@pytest.mark.parametrize(("index", "exposure"), [(0, 0.0005), (1, 0.002), (2, 0.008), (3, 0.032)])
def test_a_dark_exposure_that_contradicts_the_others_is_named(camera, index, exposure):
    findings = fit_dark(spoiled(camera, index, 20.0))[1]
    assert (findings[0].code, findings[0].values["exposure_s"]) == ("dark-contradicts", exposure)


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


def observations(camera, rng=None, luminances=(1.0, 10.0, 100.0, 230.0)):
    return [camera.observe(f"P{v}", v, 0.01, rng) for v in luminances]


def test_the_bend_above_70_percent_of_saturation_is_left_out(camera):
    dark, _ = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    seen = observations(camera, luminances=(10.0, 100.0, 300.0))
    bent = [*seen[:2], replace(seen[2], temporal_variance_dn2=5.0)]
    assert fit_noise(bent, dark)[0].k_dn_per_e == pytest.approx(0.25)


def test_repeated_frames_are_noticed(camera):
    dark, _ = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    noise, (found,) = fit_noise([replace(o, temporal_variance_dn2=0.0) for o in observations(camera)], dark)
    assert (noise.k_dn_per_e, found.code) == (0.0, "k-not-positive")


def test_a_dark_signal_that_falls_with_the_exposure_is_reported(camera):
    darks = [camera.dark(t, None) for t in (0.001, 0.1)]
    findings = fit_dark([replace(darks[0], mean_dn=darks[0].mean_dn + 40), darks[1]])[1]
    assert findings[0].code == "dark-falls"
    assert findings[0].values["rate_dn_s"] == pytest.approx(364, abs=1)
