"""Verification: valid where nothing changed, not valid where something did, and what did is named."""

import json
from dataclasses import replace
from datetime import timedelta
from math import hypot, sqrt

import numpy as np
import pytest
from scipy.stats import norm

from labcdp.calibration import fit
from labcdp.calibration.history import histories
from labcdp.calibration.verification import z_limits
from labcdp.calibration.verification_file import load_verification, save_verification
from labcdp.calibration.verify import verify
from labcdp.errors import CalibrationError, InputError
from labcdp.reading import MeterIdentity

LUMINANCES = (0.5, 1.0, 2.5, 6.0, 15.0, 40.0, 100.0, 250.0)
EXPOSURES = (0.002, 0.01, 0.1)
AGAIN = {"P0": 0.5, "P4": 15.0, "P7": 250.0}


def at_second(reading, second):
    """Tell readings of one value from a reading that is there twice."""
    return replace(reading, timestamp=reading.timestamp + timedelta(seconds=second))


@pytest.fixture(scope="module")
def calibrated(camera, meter_class, setup):
    def calibrate(seed):
        rng, meter = np.random.default_rng(seed), meter_class(true_scale_error_rel=0.008)
        return fit(
            [camera.observe(f"P{i}", v, t, rng) for i, v in enumerate(LUMINANCES) for t in EXPOSURES],
            [camera.dark(t, rng) for t in EXPOSURES],
            {f"P{i}": [at_second(meter.read(v, rng), second) for second in range(3)] for i, v in enumerate(LUMINANCES)},
            setup,
        )

    return calibrate


@pytest.fixture(scope="module")
def calibration(calibrated):
    return calibrated(3)


@pytest.fixture(scope="module")
def measured(camera, meter_class):
    """Measure patches again, by a camera and a meter that may have changed."""

    def measure(seed=4, camera=camera, meter=None, patches=AGAIN, exposures=EXPOSURES):
        rng = np.random.default_rng(seed)
        meter = meter or meter_class(true_scale_error_rel=0.008)
        return (
            [camera.observe(name, v, t, rng) for name, v in patches.items() for t in exposures],
            [camera.dark(t, rng) for t in exposures],
            {name: [at_second(meter.read(v, rng), second) for second in range(3)] for name, v in patches.items()},
        )

    return measure


def test_nothing_changed(calibration, measured):
    result = verify(calibration, *measured())
    assert result.verdict == "valid"
    assert [row.patch for row in result.patches] == list(AGAIN)
    assert abs(result.drift_rel) < result.drift_half_width_95_rel < 0.01
    assert "is still valid: camera and meter agree on 3 patches" in result.findings[0]
    assert result.same_meter
    assert any("so its scale error cancels" in text for text in result.findings)
    assert "the dark level is where it was" in result.findings


def test_false_alarms_are_as_rare_as_stated(calibrated, measured):
    n = 60
    results = [verify(calibrated(100 + seed), *measured(500 + seed)) for seed in range(n)]
    assert [r.verdict for r in results].count("not valid") <= 2
    # z, chi^2 and darkness warn by chance with at most the probability of two standard deviations each.
    chance = 3 * 2 * norm.sf(2.0)
    doubtful = [r.verdict for r in results].count("doubtful")
    assert doubtful <= n * chance + 4 * sqrt(n * chance * (1 - chance))
    z = np.array([row.z for r in results for row in r.patches])
    # The standard uncertainties hold the truth: z has a standard deviation of about 1, never far above.
    assert np.std(z) < 1 + 4 / sqrt(2 * z.size / 3)


def test_a_camera_that_has_drifted(calibration, measured, camera):
    result = verify(calibration, *measured(camera=replace(camera, responsivity_dn_s_cd_m2=1200 * 1.05)))
    assert result.verdict == "not valid"
    assert result.drift_rel == pytest.approx(0.05, abs=2 * result.drift_half_width_95_rel)
    assert "the camera has drifted by +5" in result.findings[0]
    assert result.findings[0].endswith("calibrate again")
    (plane,) = result.planes
    assert (plane.plane, result.balance) == (None, None)
    assert plane.drift.relative == result.drift_rel
    assert plane.drift.responsivity_dn_s_cd_m2 == pytest.approx(1.05 * 1200 / 1.008, rel=0.01)


def test_a_dark_level_that_has_moved(calibration, measured, camera):
    result = verify(calibration, *measured(camera=replace(camera, dark_offset_dn=70.0)))
    assert result.verdict == "not valid"
    assert "because the dark level has moved; with the new dark frames camera and meter agree" in result.findings[0]
    assert any("the dark level has moved by +6 DN" in text for text in result.findings)
    darkest = result.patches[0]
    assert darkest.difference_rel > 5 * abs(darkest.with_new_dark_rel)
    for row in result.darks:
        assert row.difference_dn == pytest.approx(6.0, abs=0.2)


def test_a_wandering_black_level_is_no_fault(calibration, measured, camera):
    result = verify(calibration, *measured(camera=replace(camera, dark_offset_dn=64.2), patches={"P7": 250.0}))
    assert result.verdict == "valid"


def test_a_patch_that_changed_alone(calibration, measured):
    observations, darks, readings = measured()
    readings["P4"] = [replace(reading, value=reading.value * 1.1) for reading in readings["P4"]]
    result = verify(calibration, observations, darks, readings)
    assert result.verdict == "not valid"
    assert min(result.patches, key=lambda row: row.z).patch == "P4"


def test_another_meter_brings_its_own_scale(calibration, measured, meter_class):
    other = meter_class(scale_half_width_rel=0.03, identity=MeterIdentity("LS-100", "1"))
    mine, theirs = verify(calibration, *measured()), verify(calibration, *measured(meter=other))
    assert not theirs.same_meter
    assert any("so the scale errors of both count" in text for text in theirs.findings)
    for row, before in zip(theirs.patches, mine.patches, strict=True):
        expected = hypot(before.standard_uncertainty_rel, 0.02 / sqrt(3), 0.03 / sqrt(3))
        assert row.standard_uncertainty_rel == pytest.approx(expected, rel=0.01)


def test_a_meter_that_was_adjusted_is_another(calibration, measured, meter_class):
    adjusted = meter_class(identity=MeterIdentity("LS-110", "73323007", "2026-01-01"))
    assert not verify(calibration, *measured(meter=adjusted)).same_meter


def test_limits_keep_the_probability_of_a_false_alarm():
    assert z_limits(1) == pytest.approx((2.0, 3.0))
    for n in (2, 3, 10):
        warn, fail = z_limits(n)
        assert n * norm.sf(warn) == pytest.approx(norm.sf(2.0))
        assert n * norm.sf(fail) == pytest.approx(norm.sf(3.0))
    with pytest.raises(InputError, match="n is 0: give at least 1 comparison"):
        z_limits(0)


def test_refusals(calibration, measured, camera):
    observations, darks, readings = measured()
    with pytest.raises(CalibrationError, match="there is no patch to verify the calibration with"):
        verify(calibration, [], darks, readings)
    with pytest.raises(CalibrationError, match="patch 'P4' has no meter reading"):
        verify(calibration, observations, darks, {k: v for k, v in readings.items() if k != "P4"})
    dark = {**readings, "P0": [replace(reading, value=0.0) for reading in readings["P0"]]}
    with pytest.raises(CalibrationError, match=r"patch 'P0' reads 0 cd/m\^2, below the meter's range"):
        verify(calibration, observations, darks, dark)
    other = replace(camera, state=replace(camera.state, black_level_dn=32.0))
    with pytest.raises(CalibrationError, match=r"black level of the calibration is 64 DN, but .* has 32 DN"):
        verify(calibration, *measured(camera=other))


def test_files(calibration, measured, tmp_path):
    result, path = verify(calibration, *measured()), tmp_path / "verification.json"
    save_verification(result, path)
    assert load_verification(path) == result
    document = json.loads(path.read_text())
    for changed, words in (
        ({"format": "x"}, "is not a verification: its key format"),
        ({"version": 1}, "has version 1, this labcdp reads version 2"),
        ({"verification": {}}, "key verdict: Field required"),
    ):
        path.write_text(json.dumps(document | changed))
        with pytest.raises(InputError, match=words):
            load_verification(path)
    path.write_text("{")
    with pytest.raises(InputError, match="is not valid JSON"):
        load_verification(path)
    with pytest.raises(InputError, match="cannot be read"):
        load_verification(tmp_path / "none.json")


def test_history_sorts_by_camera_and_time(calibration, measured, camera):
    later = replace(
        calibration,
        provenance=replace(calibration.provenance, measured=calibration.provenance.measured.replace(year=2019)),
        responsivity=replace(calibration.responsivity, responsivity_dn_s_cd_m2=1230.0),
    )
    other = replace(calibration, lens=replace(calibration.lens, f_number=4.0))
    result = verify(calibration, *measured())
    found = histories({"later": later, "first": calibration, "other": other}, {"v": result})
    assert [[point.source for point in one.points] for one in found] == [["first", "v", "later"], ["other"]]
    assert found[1].change_rel is None
    change, half_width = found[0].change_rel
    assert change == pytest.approx(1230.0 / calibration.responsivity.responsivity_dn_s_cd_m2 - 1)
    # One meter: its scale cancels.
    assert half_width == pytest.approx(1.96 * sqrt(2) * calibration.responsivity.random_rel, rel=1e-3)
    assert found[0].points[1].verdict == "valid"
    assert found[0].points[1].k_dn_per_e is None
