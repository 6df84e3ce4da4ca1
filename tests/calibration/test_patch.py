from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import expanded_half_width, fit, patch_luminance
from labcdp.errors import CalibrationError
from labcdp.luminance import Cos4Vignetting

EXPOSURES_S = (0.001, 0.008, 0.064)


@pytest.fixture(scope="module")
def calibration(camera, new_reading, setup):
    luminances = np.geomspace(0.5, 2000, 12)
    observations = [camera.observe(f"P{i}", v, t, None) for i, v in enumerate(luminances) for t in EXPOSURES_S]
    readings = {f"P{i}": [new_reading(float(v))] for i, v in enumerate(luminances)}
    return fit(observations, [camera.dark(t, None) for t in EXPOSURES_S], readings, setup)


def seen(camera, luminance, rng=None):
    return [camera.observe("wall", luminance, t, rng) for t in EXPOSURES_S]


def test_exact_observations_give_the_exact_luminance(calibration, camera):
    patch = patch_luminance(calibration, seen(camera, 7.0))
    assert patch.luminance_cd_m2 == pytest.approx(7.0, rel=1e-9)
    assert (patch.patch, patch.exposures_s, patch.warnings) == ("wall", EXPOSURES_S, ())


def test_interval_joins_scale_fit_and_noise(calibration, camera):
    patch = patch_luminance(calibration, seen(camera, 7.0))
    fit_rel = calibration.responsivity.random_rel
    assert patch.fit_rel == fit_rel
    assert patch.common_rel == pytest.approx(np.hypot(0.02 / np.sqrt(3), fit_rel))
    width = expanded_half_width(0.02, np.hypot(patch.random_rel, fit_rel))
    assert patch.interval_95_cd_m2 == pytest.approx((7 * (1 - width), 7 * (1 + width)))


def test_random_part_holds_noise_dark_and_pixels(calibration, camera):
    exact = camera.observe("wall", 7.0, 0.008, None)
    within = 9.0 + exact.temporal_variance_dn2 / exact.n_frames
    rough = replace(exact, unevenness=replace(exact.unevenness, within=(within, 0.0, 0.0)))
    net_dn = 7.0 * 1200 * 0.008
    noise = (0.25 * net_dn + 1.5**2) / 1600
    vague = replace(calibration, dark=replace(calibration.dark, offset_variance_dn2=0.04, covariance_dn2_s=0.0))
    variance = noise + vague.dark.variance_dn2(0.008) + 9.0 / 400
    assert variance > 0.04
    assert patch_luminance(vague, [rough]).random_rel == pytest.approx(np.sqrt(variance) / net_dn, rel=1e-6)


def test_noise_scatters_as_stated(calibration, camera):
    n, rng = 1000, np.random.default_rng(1)
    patches = [patch_luminance(calibration, seen(camera, 1.0, rng)) for _ in range(n)]
    stated = np.mean([p.random_rel for p in patches])
    by_dark = np.sqrt(calibration.dark.variance_dn2(0.064)) / (1200 * 0.064)
    scatter = np.std([p.luminance_cd_m2 for p in patches])
    # The dark is the same in all draws, so its part of the stated uncertainty does not show as scatter.
    assert scatter == pytest.approx(stated, rel=4 / np.sqrt(2 * n) + (by_dark / stated) ** 2)


def test_combining_exposures_is_better_than_any_alone(calibration, camera):
    observations = seen(camera, 7.0)
    together = patch_luminance(calibration, observations).random_rel
    assert all(together < patch_luminance(calibration, [o]).random_rel for o in observations)


def test_saturated_exposure_is_left_out_and_named(calibration, camera):
    patch = patch_luminance(calibration, seen(camera, 300.0))
    assert patch.luminance_cd_m2 == pytest.approx(300.0)
    assert patch.exposures_s == (0.001, 0.008)
    assert patch.warnings == ("patch 'wall' is saturated at 0.064 s: left out there",)


@pytest.mark.parametrize("luminance", [0.3, 2500.0])
def test_luminance_outside_the_range_is_reported(calibration, camera, luminance):
    patch = patch_luminance(calibration, seen(camera, luminance))
    assert "cd/m^2, the calibrated range is 0.5 to 2000 cd/m^2" in patch.warnings[-1]


def test_saturated_throughout(calibration, camera):
    with pytest.raises(
        CalibrationError, match=r"no exposure gives the luminance of a patch: patch 'wall' is saturated at 0\.001 s"
    ):
        patch_luminance(calibration, seen(camera, 9000.0))


def test_black_throughout(calibration, camera):
    with pytest.raises(CalibrationError, match="patch 'wall' is not brighter than the dark"):
        patch_luminance(calibration, seen(camera, 0.0))


def test_several_patches(calibration, camera):
    mixed = [camera.observe(name, 5.0, 0.008, None) for name in ("a", "b")]
    with pytest.raises(CalibrationError, match=r"observations are of patches \['a', 'b'\]: give those of one patch"):
        patch_luminance(calibration, mixed)


def test_no_observation(calibration):
    with pytest.raises(CalibrationError, match=r"observations are of patches \[\]"):
        patch_luminance(calibration, [])


def test_another_gain(calibration, camera):
    other = replace(camera, state=replace(camera.state, gain_db=12.0))
    with pytest.raises(
        CalibrationError, match=r"gain of the calibration is 0 dB, but patch 'wall' at 0\.001 s has 12 dB"
    ):
        patch_luminance(calibration, seen(other, 5.0))


def test_another_vignetting(calibration, camera):
    observations = [replace(o, vignetting=Cos4Vignetting(0.006, 3.45e-6)) for o in seen(camera, 5.0)]
    with pytest.raises(CalibrationError, match="the calibration has None: observe it with the calibration's"):
        patch_luminance(calibration, observations)
