"""Verification: the decision rule against its closed form, and what changed is named without blame."""

from dataclasses import replace
from datetime import date, timedelta
from math import hypot, sqrt

import numpy as np
import pytest
from scipy.stats import norm

from labcdp.calibration import fit, patch_luminance
from labcdp.calibration.setup import meter_scale
from labcdp.calibration.tolerance import own_tolerance_rel, useless_calibration_findings
from labcdp.calibration.verify.history import histories
from labcdp.calibration.verify.result import conformance_probability, decide
from labcdp.calibration.verify.verify import changes_since, verify
from labcdp.core.errors import CalibrationError
from labcdp.core.reading import MeterIdentity
from labcdp.core.vignetting import Cos4Vignetting, RadialVignetting
from labcdp.session import MeterCertificate

from .conftest import FEW_CD_M2, FEW_S, SimulatedCamera, SimulatedMeter, bench, codes, make_reading

AGAIN = (0.5, 15.0, 250.0)
CERTIFICATE = MeterCertificate(
    number="1", laboratory="PTB", date=date(2018, 1, 1), expanded_uncertainty_rel=0.008, degrees_of_freedom=20
)
CAMERA, METER = SimulatedCamera(), SimulatedMeter(true_scale_error_rel=0.008)


def measured(seed=4, camera=CAMERA, meter=METER, luminances=AGAIN):
    """Measure patches again, by a camera and a meter that may have changed."""
    rng = np.random.default_rng(seed)
    observations, darks, readings = bench(camera, lambda v: meter.read(v, rng), rng, luminances, FEW_S, 3)
    return {None: observations}, {None: darks}, readings, meter_scale(readings)


def calibrate(setup, seed=3):
    observations, darks, readings, _ = measured(seed, luminances=FEW_CD_M2)
    return fit(observations[None], darks[None], readings, setup)


@pytest.fixture(scope="module")
def calibration(setup):
    return calibrate(setup)


@pytest.mark.parametrize("true_rel", [0.0, 0.018, 0.02, 0.022, 0.03])
def test_probabilities_of_the_verdicts_are_those_of_jcgm_106(true_rel):
    u, tolerance, n = 0.003, 0.02, 20_000
    found = [decide(d, 1.96 * u, tolerance) for d in np.random.default_rng(1).normal(true_rel, u, n)]
    accept, reject = tolerance - 1.96 * u, tolerance + 1.96 * u
    conform = norm.cdf((accept - true_rel) / u) - norm.cdf((-accept - true_rel) / u)
    not_conform = norm.sf((reject - true_rel) / u) + norm.cdf((-reject - true_rel) / u)
    for verdict, p in (("conform", conform), ("not conform", not_conform)):
        assert found.count(verdict) / n == pytest.approx(p, abs=4 * sqrt(p * (1 - p) / n) + 1e-9)
    # A wrong decision has a probability of at most 2.5 %.
    assert (conform if true_rel > tolerance else not_conform) <= 0.0251


@pytest.mark.parametrize(("d", "u"), [(0.0, 0.01), (0.015, 0.01), (-0.05, 0.02)])
def test_conformance_probability_is_that_of_jcgm_106(d, u):
    """Closed form for the normal distribution (7.2); without an uncertainty, certain."""
    assert conformance_probability(d, u, 0.02) == pytest.approx(norm.cdf(0.02, d, u) - norm.cdf(-0.02, d, u))
    assert conformance_probability(d, 0.0, 0.02) == (abs(d) <= 0.02)


@pytest.mark.parametrize("n", [8, pytest.param(20, marks=pytest.mark.long)])
def test_deviations_scatter_as_stated_and_a_sound_camera_is_not_refused(setup, n):
    results = [verify(calibrate(setup, 100 + seed), *measured(500 + seed), 0.04) for seed in range(n)]
    assert all(r.verdict == "conform" for r in results)
    inside = np.array([abs(row.deviation_rel) <= row.expanded_rel for r in results for row in r.patches])
    # The patches of one calibration share its fit: n independent cases at least.
    assert inside.mean() >= 0.95 - 4 * sqrt(0.95 * 0.05 / n)


@pytest.mark.parametrize(
    ("n_readings", "n"), [(2, 20), *(pytest.param(several, 80, marks=pytest.mark.long) for several in (2, 3))]
)
def test_intervals_hold_for_few_patches_that_scatter_and_few_noisy_readings(setup, n_readings, n):
    """Four patches calibrated, which scatter by 1 %; the verification's readings by 1 % instead of the stated 0.2 %."""
    held = {"deviation": [], "mean": [], "guard": []}
    for seed in range(n):
        rng = np.random.default_rng([n_readings, seed])

        def session(luminances, count, noise_rel, rng=rng):
            observations, darks, _ = bench(CAMERA, make_reading, rng, luminances, FEW_S)
            true = np.array(luminances) * (1 + 0.01 * rng.normal(size=len(luminances)))
            seen = true[:, None] * (1 + noise_rel * rng.normal(size=(true.size, count)))
            meter = SimulatedMeter(repeatability_rel=0.002)
            read = [[replace(meter.read(v, None, s), value=v) for s, v in enumerate(row)] for row in seen.tolist()]
            return observations, darks, {f"P{i}": row for i, row in enumerate(read)}, true

        observations, darks, readings, _ = session((2.0, 9.0, 43.0, 200.0), 3, 0.002)
        calibration = fit(observations, darks, readings, setup)
        again = (3.0, 6.0, 12.0, 25.0, 50.0, 100.0)
        observations, darks, readings, true = session(again, n_readings, 0.01)
        result = verify(calibration, {None: observations}, {None: darks}, readings, meter_scale(readings))
        own = calibration.at_their_temperature()
        for row, seen_cd_m2, read_cd_m2 in zip(result.patches, again, true, strict=True):
            # What a camera without noise and a meter without noise would find.
            seen = [CAMERA.observe(row.patch, seen_cd_m2, t, None) for t in FEW_S]
            found = patch_luminance(own, seen).luminance_cd_m2 / read_cd_m2 - 1
            held["deviation"].append(abs(row.deviation_rel) <= row.expanded_rel)
            held["guard"].append(abs(row.deviation_rel - found) <= row.guard_rel)
        held["mean"].append(abs(result.mean_rel) <= result.mean_expanded_rel)
    for inside in held.values():
        assert abs(np.mean(inside) - 0.95) <= 3 * sqrt(0.95 * 0.05 / n)


@pytest.mark.parametrize(("change", "verdict"), [(0.005, "conform"), (0.03, "undecided"), (0.06, "not conform")])
def test_a_common_change_is_decided_by_the_tolerance(calibration, camera, change, verdict):
    changed = replace(camera, responsivity_dn_s_cd_m2=1200 * (1 + change))
    result = verify(calibration, *measured(camera=changed), 0.03)
    assert result.verdict == verdict
    assert result.mean_rel == pytest.approx(change, abs=2 * result.mean_expanded_rel)
    assert codes(result) & {"deviation-common", "deviation-single"} == {"deviation-common"}
    (plane,) = result.planes
    assert plane.drift.responsivity_dn_s_cd_m2 == pytest.approx((1 + change) * 1200 / 1.008, rel=0.01)


@pytest.mark.parametrize(
    ("patch", "change", "verdict"), [("P0", {"repeatability_rel": 0.9}, "undecided"), ("P1", {}, "not conform")]
)
def test_a_patch_that_changed_alone_is_named(calibration, patch, change, verdict):
    """Also one that lost a fifth where the uncertainty is 100 %, which neither conforms nor not."""
    observations, darks, readings, meter = measured()
    readings[patch] = [replace(r, value=1.25 * r.value, **change) for r in readings[patch]]
    result = verify(calibration, observations, darks, readings, meter)
    (changed,) = [row for row in result.patches if row.patch == patch]
    assert (result.verdict, changed.verdict) == (verdict, verdict)
    assert changed.deviation_rel == pytest.approx(-0.2, abs=0.02)
    assert result.findings[0].values["patches"] == [patch]


def test_the_drift_of_the_meter_since_the_calibration_counts(setup):
    """A year at 2 % a year, as limits of a rectangular distribution."""
    certificate = CERTIFICATE.model_copy(update={"drift_rel_per_year": 0.02})
    observations, darks, readings, _ = measured(3, luminances=FEW_CD_M2)
    calibration = fit(observations[None], darks[None], readings, replace(setup, certificate=certificate))
    observations, darks, readings, _ = measured()
    later = {
        name: [replace(r, timestamp=r.timestamp + timedelta(days=365)) for r in group]
        for name, group in readings.items()
    }
    now, year = (
        verify(calibration, observations, darks, of, meter_scale(of, certificate)) for of in (readings, later)
    )  # fmt: skip
    assert "verified-with-same-meter" in codes(now)
    assert "verified-with-same-meter-that-drifts" in codes(year)
    drift = 0.02 * 365 / 365.2425 / sqrt(3)
    for a, b in zip(now.patches, year.patches, strict=True):
        assert b.standard_uncertainty_rel == pytest.approx(hypot(a.standard_uncertainty_rel, drift), rel=1e-9)


def test_a_dark_level_that_has_moved(calibration, camera):
    result = verify(calibration, *measured(camera=replace(camera, dark_offset_dn=70.0)))
    assert result.verdict == "not conform"
    assert [one.difference_dn for one in result.darks] == pytest.approx([6] * 3, abs=0.1)
    # 6 DN of the 60 DN of the lowest calibrated luminance at the longest exposure.
    assert [one.effect_rel for one in result.darks] == pytest.approx([0.1] * 3, rel=0.05)
    # Bright patches alone do not show it, the dark frames do.
    bright = verify(calibration, *measured(camera=replace(camera, dark_offset_dn=90.0), luminances=[250.0]))
    assert bright.patches[0].verdict == "conform"
    assert (bright.verdict, bright.findings[0].code) == ("not conform", "verification-not-conform-dark")


def test_nothing_changed_conforms_and_another_meter_or_certificate_brings_its_own_scale(calibration):
    other = SimulatedMeter(scale_half_width_rel=0.03, identity=MeterIdentity("LS-100", "1"))
    mine, theirs = verify(calibration, *measured()), verify(calibration, *measured(meter=other))
    again = verify(calibration, *measured()[:3], replace(mine.meter, certificate=CERTIFICATE))
    assert (mine.verdict, abs(mine.mean_rel) < mine.mean_expanded_rel < 0.01) == ("conform", True)
    # Before or after a step of 1 %, which is that of the same meter, its scale is half of the step from their mean.
    step = verify(replace(calibration, meter_scale=replace(mine.calibration_meter, step_rel=0.01)), *measured())
    for result, limits, own in ((theirs, 0.02, 0.03 / sqrt(3)), (again, 0.02, 0.004), (step, 0.005, 0.0)):
        assert result.same_meter == (result is step)
        for row, before in zip(result.patches, mine.patches, strict=True):
            expected = hypot(before.standard_uncertainty_rel, limits / sqrt(3), own)
            assert row.standard_uncertainty_rel == pytest.approx(expected, rel=0.01)
    assert "verified-with-other-meter" in codes(theirs)
    assert "meter-recalibrated" in codes(again)


def test_an_adjusted_meter_is_not_a_change_of_the_camera(calibration):
    """A meter adjusted by 1.5 %, within both accuracies: not "not conform", and in a history not "changed"."""
    adjusted = SimulatedMeter(true_scale_error_rel=-0.007, identity=MeterIdentity("LS-110", "73323007", "2018-02-01"))
    result = verify(calibration, *measured(meter=adjusted))
    assert (result.verdict, "meter-recalibrated" in codes(result)) == ("undecided", True)
    (one,) = histories({"c": calibration}, {"v": result})
    change, expanded = one.change_rel
    assert 0.01 < change < expanded


def test_assumed_vignetting_is_part_of_the_tolerance_and_not_of_the_deviation(calibration):
    """5 % in the corners: a patch there has as good a deviation as one on the axis, and a wider tolerance."""
    vignetting, (height, width) = Cos4Vignetting(1.0, 1e-6, None, 0.05), calibration.state.image_shape
    observations, *others = measured()
    own = replace(calibration, vignetting=vignetting)
    results = []
    for centre_px in ((width / 2, height / 2), (0.0, 0.0)):
        seen = {None: [replace(o, vignetting=vignetting, centre_px=centre_px) for o in observations[None]]}
        results.append(verify(own, seen, *others).patches)
    for on_axis, in_corner in zip(*results, strict=True):
        assert in_corner.expanded_rel == pytest.approx(on_axis.expanded_rel)
        assert on_axis.tolerance_rel == own_tolerance_rel(own)
        assert in_corner.tolerance_rel == pytest.approx(own_tolerance_rel(own, 0.05))
        assert in_corner.tolerance_rel > 0.09
    # So are a flat field's errors, alike at all places.
    flat = replace(own, vignetting=RadialVignetting(0.0, 0.0, 0.0, slow_rel=0.01))
    seen = {None: [replace(o, vignetting=flat.vignetting) for o in observations[None]]}
    for with_flat, without in zip(verify(flat, seen, *others).patches, results[0], strict=True):
        assert with_flat.expanded_rel == pytest.approx(without.expanded_rel)
        assert with_flat.tolerance_rel == pytest.approx(own_tolerance_rel(own, 0.01))


def test_what_cannot_be_compared_is_refused(calibration, camera):
    observations, darks, readings, meter = measured()
    other = replace(camera, state=replace(camera.state, black_level_dn=32.0))
    for changed, message in (
        (({None: []}, darks, readings, meter), "there is no patch to verify the calibration with"),
        ((observations, darks, {"P0": readings["P0"]}, meter), "patch 'P1' has no meter reading"),
        (measured(camera=other), r"black level of the calibration is 64, but .* has 32"),
    ):
        with pytest.raises(CalibrationError, match=message):
            verify(calibration, *changed)


def test_history_sorts_by_camera_and_time(calibration, camera):
    later = replace(
        calibration,
        provenance=replace(calibration.provenance, measured=calibration.provenance.measured.replace(year=2019)),
        responsivity=replace(calibration.responsivity, responsivity_dn_s_cd_m2=1230.0),
    )
    other = replace(calibration, lens=replace(calibration.lens, f_number=4.0))
    result = verify(calibration, *measured())
    found = histories({"later": later, "first": calibration, "other": other}, {"v": result})
    assert [[point.source for point in one.points] for one in found] == [["first", "v", "later"], ["other"]]
    change, half_width = found[0].change_rel
    assert change == pytest.approx(1230.0 / calibration.responsivity.responsivity_dn_s_cd_m2 - 1)
    # One meter: its scale cancels.
    assert half_width == pytest.approx(1.96 * sqrt(2) * calibration.responsivity.random_rel, rel=1e-3)


def test_a_calibration_of_no_use_says_so(calibration):
    assert useless_calibration_findings(calibration) == []
    bad = replace(calibration, responsivity=replace(calibration.responsivity, random_rel=0.15, dof=None))
    (found,) = useless_calibration_findings(bad)
    assert (found.code, found.severity) == ("calibration-of-no-use", "warning")
    assert found.values["expanded_rel"] == pytest.approx(own_tolerance_rel(bad))
    assert found.values["expanded_rel"] > 1.96 * 0.15
    # What counts by the luminance, in the middle of the range.
    low, high = calibration.range_cd_m2
    glare_cd_m2 = 0.2 * (low * high) ** 0.5
    veiled = replace(calibration, responsivity=replace(calibration.responsivity, glare_cd_m2=glare_cd_m2))
    (found,) = useless_calibration_findings(veiled)
    assert found.values["expanded_rel"] == pytest.approx(1.96 * 0.2, rel=0.05)


@pytest.mark.parametrize(("days", "warmer_k"), [(0, 0.0), (3, 0.0), (0, 10.0), (3, -10.0)])
def test_another_day_and_another_temperature_of_the_camera_count(setup, days, warmer_k):
    calibration = calibrate(replace(setup, lens=replace(setup.lens, stability_rel=0.01)))
    calibration = replace(calibration, light_temperature_c=30.0)
    observations = [one for one in measured()[0][None] if one.patch == "P1"]
    recorded = calibration.provenance.measured + timedelta(days=days)
    before, after = (
        patch_luminance(one, observations).u_rel
        for one in (calibration, calibration.for_use([None, recorded], [None, 30.0 + warmer_k]))
    )
    # Limits of 0.1 % by kelvin.
    assert after == pytest.approx(hypot(before, 0.01 if days else 0.0, 0.01 / sqrt(3) if warmer_k else 0.0))


def changed(calibration, seed, responsivity_dn_s_cd_m2=1200.0, light=()):
    """A calibration after patches measured again with another responsivity or light, and what that says."""
    camera = SimulatedCamera(responsivity_dn_s_cd_m2=responsivity_dn_s_cd_m2)
    observations, _, readings, meter = measured(seed, camera)
    readings |= {
        name: [replace(one, value=one.value * by) for one in readings[name]] for name, by in dict(light).items()
    }
    names = dict.fromkeys(one.patch for one in observations[None])
    seen = [patch_luminance(calibration, [o for o in observations[None] if o.patch == name]) for name in names]
    after, deviating, findings = changes_since(calibration, observations, seen, readings, meter)
    return after, deviating, [(one.code, one.subject) for one in findings]


def test_a_change_of_the_responsivity_is_named_and_counts(calibration):
    after, deviating, named = changed(calibration, 4, 1200 * 1.02)
    assert (deviating, named) == ({}, [("responsivity-changed", "")])
    assert after.stability_rel == pytest.approx(0.02, abs=0.004)


def test_a_patch_that_contradicts_the_meter_alone_is_named_and_counts(calibration):
    after, deviating, named = changed(calibration, 4, light={"P1": 0.97}.items())
    assert named == [("patch-contradicts-meter", "P1")]
    assert deviating == {"P1": pytest.approx(1 / 0.97 - 1, abs=0.006)}
    assert after == calibration


@pytest.mark.parametrize(("n", "most"), [(12, 2), pytest.param(40, 3, marks=pytest.mark.long)])
def test_no_change_is_named_by_chance(setup, n, most):
    """In 0.3 to 1 % of sessions: more than 2 of 12, or 3 of 40, happen in less than 1 of 1000."""
    named = [changed(calibrate(setup, 300 + seed), 700 + seed)[2] for seed in range(n)]
    assert sum(map(bool, named)) <= most
