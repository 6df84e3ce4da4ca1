from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import observe_dark, observe_patches
from labcdp.calibration.sensor.dark import fit_dark
from labcdp.calibration.sensor.noise import fit_noise
from labcdp.core.roi import Roi

from ..conftest import make_frame

EXPOSURES_S = (0.001, 0.01, 0.1)


def test_frames_outside_the_temperatures_of_the_dark_frames_are_named(camera):
    dark, _ = fit_dark(warm_darks(camera, temperatures_c=(24.0, 25.0)))
    taken = [(0.01, 40.0), (0.1, 34.0), (0.1, 26.0), (0.1, None)]
    assert [one.values["temperature_c"] for one in dark.temperature_findings(taken)] == [34.0]
    assert dark.temperature_findings([(0.1, 26.9), (0.1, None), (1e-4, 40.0)]) == []


def test_what_a_line_cannot_be_is_named(camera):
    """An exposure that contradicts the others, and a dark signal that falls."""
    darks = [camera.dark(t, None) for t in (0.0005, 0.002, 0.008, 0.032)]
    for i, one in enumerate(darks):
        found = fit_dark([*darks[:i], replace(one, mean_dn=one.mean_dn + 20), *darks[i + 1 :]])[1][0]
        assert (found.code, found.values["exposure_s"]) == ("dark-contradicts", one.exposure_s)
    assert [one.code for one in fit_dark([replace(darks[0], mean_dn=104.0), darks[3]])[1]] == ["dark-falls"]


def warm_darks(camera, temperatures_c=(20.0, 35.0)):
    """Dark frames of 40 DN/s at 25 degC, and twice as much 7 degC above."""
    warm = {c: replace(camera, dark_rate_dn_s=40.0 * 2 ** ((c - 25.0) / 7.0)) for c in temperatures_c}
    return [replace(warm[c].dark(t, None), temperature_c=c) for c in warm for t in (0.001, 0.01, 0.1, 1.0)]


def test_doubling_temperature_of_exact_darks(camera):
    dark, findings = fit_dark(warm_darks(camera))
    assert findings == []
    assert dark.doubling_temperature_c == pytest.approx(7.0, rel=1e-6)
    assert dark.mean_dn(0.5, 25.0) == pytest.approx(64 + 20.0)
    assert dark.mean_dn(0.5, 32.0) == pytest.approx(64 + 40.0)
    assert dark.mean_dn(0.5) == dark.mean_dn(0.5, 27.5)
    assert dark.errors().T @ dark.errors() == pytest.approx(np.array(dark.covariance), rel=1e-6, abs=1e-12)


def test_the_bend_near_saturation_is_left_out_and_repeated_frames_are_noticed(camera):
    dark, findings = fit_dark([camera.dark(t, None) for t in EXPOSURES_S])
    assert (dark.offset_dn, dark.rate_dn_s, dark.noise_dn, *findings) == pytest.approx((64.0, 40.0, 1.5), abs=1e-7)
    seen = [camera.observe(f"P{v}", v, 0.01, None) for v in (1.0, 10.0, 100.0, 300.0)]
    bent = [*seen[:3], replace(seen[3], temporal_variance_dn2=5.0)]
    assert fit_noise(bent, dark)[0].k_dn_per_e == pytest.approx(0.25)
    noise, (found,) = fit_noise([replace(o, temporal_variance_dn2=0.0) for o in seen], dark)
    assert (noise.k_dn_per_e, found.code) == (0.0, "k-not-positive")


def test_flicker_and_drift_of_the_black_level_are_those_of_the_frames():
    rng = np.random.default_rng(1)

    def frames(light_dn):
        for i in range(100):
            noise_dn = rng.normal(0, np.sqrt(2 + 0.25 * light_dn), (48, 64))
            yield make_frame(64 + rng.normal(0, 0.5) + light_dn * (1 + rng.normal(0, 0.01)) + noise_dn, frame_id=i)

    dark, _ = fit_dark([observe_dark(frames(0.0))])
    noise, _ = fit_noise(observe_patches(frames(1000.0), [Roi.rectangle("P", 8, 8, 32, 32)]), dark)
    assert (dark.drift_dn, noise.flicker_rel, dark.drift_dof) == pytest.approx((0.5, 0.01, 99), rel=4 / (2 * 99) ** 0.5)
    assert noise.k_dn_per_e == pytest.approx(0.25, rel=0.02)
