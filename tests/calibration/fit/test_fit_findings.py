"""What the fit finds out: the response, bad readings, held-out patches, gains, tests, refusals."""

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

from labcdp.calibration import fit, patch_luminance
from labcdp.core.errors import CalibrationError
from labcdp.core.reading import CD_M2_PER_FL


def codes(one):
    """Codes of what was found."""
    return {finding.code for finding in one.findings}


EXPOSURES_S = (0.001, 0.008, 0.064)
LUMINANCES = tuple(float(v) for v in np.geomspace(0.5, 2000, 12))


def bench(camera, new_reading, rng=None, luminances=LUMINANCES, exposures_s=EXPOSURES_S):
    observations = [camera.observe(f"P{i}", v, t, rng) for i, v in enumerate(luminances) for t in exposures_s]
    readings = {
        f"P{i}": [new_reading(v * (1 + (rng.normal(0, 0.002) if rng else 0)))] for i, v in enumerate(luminances)
    }
    return observations, [camera.dark(t, rng) for t in exposures_s], readings


def found(calibration, name):
    return next(test for test in calibration.tests if test.name == name)


def test_a_bent_camera_is_straightened(bent_camera, new_reading, setup):
    rng, z = np.random.default_rng(2), []
    for _ in range(20):
        calibration = fit(*bench(bent_camera, new_reading, rng), setup)
        assert calibration.response.kind == "quadratic"
        top = calibration.response.net_dn[1]
        assert calibration.response.linear_dn[1] / top - 1 == pytest.approx(0.02 * top / 4000, rel=0.15)
        r = calibration.responsivity
        z.append((r.responsivity_dn_s_cd_m2 / 1200 - 1) / r.random_rel)
        seen = [bent_camera.observe("wall", 150.0, t, rng) for t in EXPOSURES_S]
        assert patch_luminance(calibration, seen).luminance_cd_m2 == pytest.approx(150.0, rel=0.005)
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 20))
    assert next(step.reason.code for step in calibration.ladder if step.chosen) == "model-better"


def test_a_kinked_camera_is_straightened(camera, new_reading, setup):
    """Above 2000 DN it gives only 85 % of what light adds: no quadratic."""

    def kinked(observation):
        net = observation.signal_dn - 64.0 - 40.0 * observation.exposure_s
        return replace(observation, signal_dn=observation.signal_dn - 0.15 * max(net - 2000.0, 0.0))

    luminances = tuple(np.geomspace(0.5, 2000, 14))
    observations, darks, readings = bench(
        camera, new_reading, luminances=luminances, exposures_s=(0.001, 0.004, 0.016, 0.064)
    )
    calibration = fit([kinked(o) for o in observations], darks, readings, setup)
    assert calibration.response.kind in ("cubic", "pchip")
    assert calibration.response.linear_dn[1] == pytest.approx(calibration.response.net_dn[1])
    bent = kinked(camera.observe("wall", 300.0, 0.008, None))
    linear = fit([kinked(o) for o in observations if o.exposure_s < 0.002], darks, readings, setup)
    assert abs(patch_luminance(calibration, [bent]).luminance_cd_m2 / 300 - 1) < 0.01
    assert linear.response.kind == "linear"


@pytest.mark.parametrize(
    ("factor", "index"), [(10.0, 0), (0.1, 11), (CD_M2_PER_FL, 5), (1 / CD_M2_PER_FL, 0), (1.1, 0), (1.1, 5), (1.1, 11)]
)
def test_a_bad_reading_is_named_and_left_out(camera, new_reading, setup, factor, index):
    observations, darks, readings = bench(camera, new_reading, np.random.default_rng(3))
    right = fit(observations, darks, readings, setup)
    wrong = readings | {f"P{index}": [new_reading(LUMINANCES[index] * factor)]}
    calibration = fit(observations, darks, wrong, setup)
    (row,) = [row for row in calibration.left_out if row.exposure_s is None]
    assert (row.patch, row.reading) == (f"P{index}", None)
    assert row.reason == "contradicts the other patches"
    assert [one.subject for one in calibration.findings if one.code.startswith("patch-contradicts")] == [row.patch]
    assert f"P{index}" not in [row.patch for row in calibration.residuals]
    error = calibration.responsivity.responsivity_dn_s_cd_m2 / right.responsivity.responsivity_dn_s_cd_m2 - 1
    assert abs(error) < 2 * right.responsivity.random_rel


def test_a_wrong_unit_is_called_so(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    calibration = fit(observations, darks, readings | {"P5": [new_reading(LUMINANCES[5] / CD_M2_PER_FL)]}, setup)
    (named,) = [one for one in calibration.findings if one.code == "patch-contradicts-unit"]
    assert named.values["ratio"] == pytest.approx(1 / CD_M2_PER_FL, rel=0.01)


@pytest.mark.parametrize("bend", [1e-9, 0.5])
@pytest.mark.parametrize("factor", [10, 0.8])
def test_of_two_readings_the_camera_says_which_is_wrong(bent_camera, new_reading, setup, bend, factor):
    """Of a camera with a curved response too: no straight line fits the other patches."""
    observations, darks, readings = bench(replace(bent_camera, bend=bend), new_reading)
    later = new_reading(LUMINANCES[5]).timestamp + timedelta(seconds=5)
    readings["P5"] = [new_reading(LUMINANCES[5] * factor), new_reading(LUMINANCES[5], timestamp=later)]
    calibration = fit(observations, darks, readings, setup)
    (row,) = [row for row in calibration.left_out if row.exposure_s is None]
    assert (row.patch, row.reading) == ("P5", 1)
    assert calibration.residuals[5].n_readings == 1
    assert calibration.residuals[5].reading_cd_m2 == pytest.approx(LUMINANCES[5])


def test_held_out_patches_are_not_shown_to_the_fit(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    wrong = readings | {"P4": [new_reading(LUMINANCES[4] * 1.02)]}
    calibration = fit(observations, darks, wrong, setup, held_out=["P4", "P9"])
    assert [row.patch for row in calibration.held_out] == ["P4", "P9"]
    assert "P4" not in [row.patch for row in calibration.residuals]
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=1e-6)
    assert calibration.held_out[0].residual_rel == pytest.approx(1 / 1.02 - 1, rel=1e-3)
    assert calibration.held_out[0].leave_one_out_rel == calibration.held_out[0].residual_rel
    assert calibration.held_out[1].residual_rel == pytest.approx(0, abs=1e-6)


def at_gain(camera, gain_db, true_factor):
    return replace(
        camera,
        responsivity_dn_s_cd_m2=1200 * true_factor,
        dark_offset_dn=64 * true_factor,
        k_dn_per_e=0.25 * true_factor,
        state=replace(camera.state, gain_db=gain_db),
    )


def test_gains_are_fitted_together(camera, new_reading, setup):
    rng, factor, z = np.random.default_rng(8), 10 ** (6 / 20), []
    for _ in range(12):
        observations, darks, readings = bench(camera, new_reading, rng)
        more = bench(at_gain(camera, 6.0, factor), new_reading, rng)
        calibration = fit([*observations, *more[0]], [*darks, *more[1]], readings, setup)
        (gain,) = calibration.gains
        z.append((gain.factor / factor - 1) / gain.factor_random_rel)
        assert not found(calibration, "gain").significant
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 12))
    # Both cameras look at the same patches, so the meter's errors drop out of the factor.
    assert gain.factor_random_rel < 0.5 * calibration.responsivity.random_rel
    assert gain.dark.offset_dn == pytest.approx(64 * factor, abs=0.1)
    assert gain.noise.k_dn_per_e == pytest.approx(0.25 * factor, rel=0.05)
    wall = [at_gain(camera, 6.0, factor).observe("wall", 7.0, 0.008, None)]
    assert patch_luminance(calibration, wall).luminance_cd_m2 == pytest.approx(7.0, rel=0.003)


def test_a_gain_that_is_not_what_it_says_is_reported(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    more = bench(at_gain(camera, 6.0, 1.9), new_reading)
    calibration = fit([*observations, *more[0]], [*darks, *more[1]], readings, setup)
    assert calibration.gains[0].factor == pytest.approx(1.9, rel=1e-6)
    assert found(calibration, "gain").significant
    (named,) = [one for one in calibration.findings if one.code == "gain-deviates"]
    assert named.values["deviation_rel"] == pytest.approx(-0.0477, abs=1e-4)


def test_a_drift_over_the_readings_is_found(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    start = readings["P0"][0].timestamp
    order = np.random.default_rng(9).permutation(12)
    for when, i in enumerate(order):
        light = LUMINANCES[i] * (1 - 0.05 * when / 11)  # the lamp loses 5 % within 22 minutes
        readings[f"P{i}"] = [new_reading(light, timestamp=start + timedelta(minutes=2 * when))]
    calibration = fit(observations, darks, readings, setup)
    drift = found(calibration, "drift")
    assert drift.significant
    assert drift.unit == "1/h"
    assert drift.value == pytest.approx(0.05 * 60 / 22, rel=0.1)


def test_frames_much_warmer_than_the_darks_are_reported(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading)
    cold = [replace(d, temperature_c=25.0) for d in darks]
    calibration = fit([replace(o, temperature_c=40.0) for o in observations], cold, readings, setup)
    (named,) = [one for one in calibration.findings if one.code == "temperature-not-covered"]
    assert named.values["temperature_c"] == 40.0
    assert named.values["lowest_c"] == named.values["highest_c"] == 25.0


def test_swapped_patches_are_refused_by_name(camera, new_reading, setup):
    observations, darks, readings = bench(camera, new_reading, luminances=LUMINANCES[:4])
    readings["P1"], readings["P2"] = readings["P2"], readings["P1"]
    with pytest.raises(
        CalibrationError, match=r"patch 'P1' reads .* and patch 'P2' .*, but the camera sees less light from the first"
    ):
        fit(observations, darks, readings, setup)


def test_a_narrow_range_is_reported(camera, new_reading, setup):
    calibration = fit(*bench(camera, new_reading, luminances=(10.0, 12.0, 15.0) * 2), setup)
    assert "narrow-luminance-range" in codes(calibration)
    assert calibration.responsivity.intercept_dn_s is None
