"""The fit: exact data, checks of the model's assumptions, bad readings, gains, what is left out and refused."""

from dataclasses import replace
from datetime import timedelta
from math import sqrt

import numpy as np
import pytest

from labcdp.calibration import fit, patch_luminance
from labcdp.calibration.camera import EXPOSURE_TIME_REL
from labcdp.core.errors import LabcdpError
from labcdp.core.reading import CD_M2_PER_FL, MeterIdentity

from ..conftest import EXPOSURES_S, LUMINANCES, START, bench, codes, found, make_reading


def exact(value):
    """A reading without any error, to test the camera's side alone."""
    return make_reading(value, repeatability_rel=0.0, digits_half_width=0.0)


def noisy(rng):
    """Readings that scatter as the meter states."""
    return lambda value: make_reading(value * (1 + rng.normal(0, 0.002)))


def test_exact_data_give_the_exact_responsivity(camera, setup):
    calibration = fit(*bench(camera, exact), setup)
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=1e-9)
    assert calibration.responsivity.chi_squared == pytest.approx(0, abs=1e-9)
    # 36 observations, of which 5 patches saturate at 8 of their exposures, less one parameter.
    assert calibration.responsivity.degrees_of_freedom == 27
    assert calibration.range_net_dn == (pytest.approx(0.6), pytest.approx(3.54e3, rel=0.01))
    assert calibration.noise.k_dn_per_e == pytest.approx(0.25)
    assert calibration.range_cd_m2 == (pytest.approx(0.5), pytest.approx(2000))
    assert max(abs(row.residual_rel) for row in calibration.residuals) < 1e-9


@pytest.mark.parametrize(("offset_cd_m2", "code"), [(0.2, "intercept"), (-0.1, "dark-current-differs")])
def test_an_intercept_is_the_same_luminance_of_all_patches_and_no_scatter(camera, setup, offset_cd_m2, code):
    """A negative one is no glare, but a dark current that was higher in the dark frames."""
    observations = bench(camera, luminances=[v + offset_cd_m2 for v in LUMINANCES])[0]
    calibration = fit(observations, *bench(camera)[1:], setup)
    assert codes(calibration) & {"intercept", "dark-current-differs", "dark-differs"} == {code}
    fitted, longest_s = calibration.responsivity, EXPOSURES_S[-1]
    in_use = {"intercept": fitted.glare_cd_m2, "dark-current-differs": fitted.dark_rate_dn_s / 1200}[code]
    assert (in_use, fitted.scatter_rel) == pytest.approx((abs(offset_cd_m2), 0), rel=0.01, abs=1e-6)
    check = found(calibration, "glare" if code == "intercept" else "dark signal")
    expected = offset_cd_m2 if code == "intercept" else offset_cd_m2 * 1200 * longest_s
    assert (check.significant, check.value) == (True, pytest.approx(expected, rel=0.01))
    # Nothing tells the two apart.
    (several,) = [one for one in calibration.findings if one.code == "one-of"] or [None]
    assert (several is not None) == (code == "intercept")


def test_glare_that_the_patches_do_not_show_is_bounded(camera, setup):
    """Half of the intercept's standard uncertainty is not counted; twice is, but is not significant."""
    _, darks, readings = bench(camera, lambda v: make_reading(v, repeatability_rel=0.01, digits_half_width=0.05))
    u = found(fit(*bench(camera, exact)[:2], readings, setup), "glare").standard_uncertainty
    for share, counted in ((0.5, 0.0), (2.0, sqrt(3))):
        observations = bench(camera, exact, luminances=[v + share * u for v in LUMINANCES])[0]
        calibration = fit(observations, darks, readings, setup)
        assert calibration.responsivity.glare_cd_m2 == pytest.approx(counted * u, rel=0.05)
        (named,) = [one for one in calibration.findings if one.code == "intercept-not-excluded"]
        assert named.values["glare_cd_m2"] == pytest.approx((share + 1.96) * u, rel=0.05)


def test_a_wrong_dark_is_distinguished_from_glare(camera, setup):
    observations, _, readings = bench(camera)
    calibration = fit(observations, bench(replace(camera, dark_offset_dn=54.0))[1], readings, setup)
    (named,) = [one for one in calibration.findings if one.code == "dark-differs"]
    assert named.values["difference_dn"] == pytest.approx(10, abs=0.5)
    assert "intercept" not in codes(calibration)


def test_dark_error_is_shared_by_the_patches(camera, setup):
    """Twelve patches do not average the error of one dark down."""
    observations, darks, readings = bench(camera, exact, luminances=(1.0, 1.5, 2.5) * 4, exposures_s=(0.01,))
    # One frame of few pixels.
    vague = [replace(darks[0], n_pixels=225, frame_means_dn=(darks[0].mean_dn,))]
    calibration = fit(observations, vague, readings, setup)
    # As if all patches were one with their weighted mean: generalised least squares, error over the signal.
    signal = 1200 * 0.01 * np.array([1.0, 1.5, 2.5] * 4)
    covariance = np.diag([camera.pixel_variance_dn2(v, 0.01) / 1600 for v in (1.0, 1.5, 2.5) * 4]) + 0.01
    covariance += EXPOSURE_TIME_REL**2 * np.outer(signal, signal)
    expected = 1 / np.sqrt(signal @ np.linalg.solve(covariance, signal))
    assert calibration.responsivity.random_rel == pytest.approx(expected, rel=1e-6)


def test_a_wrong_exposure_time_is_reported(camera, setup):
    observations, darks, readings = bench(camera, exact)
    late = [
        replace(o, mean_dn=64.04 + (o.mean_dn - 64.04) * 1.05) if o.exposure_s == 0.001 else o for o in observations
    ]
    calibration = fit(late, darks, readings, setup)
    reciprocity = found(calibration, "exposure reciprocity")
    assert (reciprocity.significant, reciprocity.value) == (True, pytest.approx(0.05, rel=0.05))
    assert reciprocity.finding in calibration.findings
    # Whichever exposure is right, the truth is within the stated uncertainty.
    r = calibration.responsivity
    assert r.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=0.05 + 2 * r.random_rel)


@pytest.mark.parametrize(
    ("name", "factor", "value", "code", "least_rel", "plane"),
    [
        ("drift", lambda k: 1 + 0.05 * k / 12, -0.05, "drift", 0.0, None),
        ("meter step", lambda k: 1 + 0.03 * (k > 5), 0.03, "readings-step", 0.0145 / sqrt(3), None),
        ("meter step", lambda k: 1 + 0.0039 * (k > 5), 0.0039, "readings-step", 0.0018 / sqrt(3), None),
        ("meter step", lambda k: 1 + 0.0039 * (k > 5), 0.0039, "readings-step", 0.0018 / sqrt(3), "R"),
    ],
)
def test_readings_that_change_with_time_are_found(camera, setup, name, factor, value, code, least_rel, plane):
    """Patches are read every 5 minutes in an order that is not that of their luminances; either side may be right."""
    *seen, readings = bench(camera, exact)
    observations, darks = ([replace(o, state=replace(o.state, plane=plane)) for o in group] for group in seen)
    for i, (one,) in enumerate(readings.values()):
        k = 5 * i % 12
        readings[f"P{i}"] = [replace(one, value=one.value * factor(k), timestamp=START + timedelta(hours=k / 12))]
    calibration = fit(observations, darks, readings, setup)
    test = found(calibration, name)
    assert (test.significant, test.value) == (True, pytest.approx(value, rel=0.05))
    assert {"drift", "readings-step"} & codes(calibration) == {code}
    assert calibration.responsivity.random_rel >= least_rel
    # An unexplained event makes no limit of a data sheet smaller.
    assert calibration.meter_scale.half_width_rel == 0.02


def all_with(ones, **changes):
    return [replace(one, **changes) for one in ones]


#: What is found when observations, dark frames and readings are changed so.
LEFT_OUT = {
    "saturated": lambda o, d, r: (o, d, r),
    "clipped at 0 DN": lambda o, d, r: ([replace(o[0], black_share=0.5), *o[1:]], d, r),
    "not above the dark signal": lambda o, d, r: (all_with(o[:3], mean_dn=64.0) + o[3:], d, r),
    "patch-not-usable": lambda o, d, r: (o[:-3] + all_with(o[-3:], saturated_share=0.5), d, r),
    "patch-reads-zero": lambda o, d, r: (o, d, r | {"P0": [exact(0.0)]}),
    "dark-extrapolated": lambda o, d, r: (o, d[:2], r),
    "temperature-not-covered": lambda o, d, r: (all_with(o, temperature_c=30.0), all_with(d, temperature_c=25.0), r),
}


@pytest.mark.parametrize("code", LEFT_OUT)
def test_what_is_left_out_or_could_be_better_is_named_and_makes_no_wrong_number(camera, setup, code):
    calibration = fit(*LEFT_OUT[code](*bench(camera, exact)), setup)
    assert code in codes(calibration) | {row.reason for row in calibration.left_out}
    # One finding for all exposures of a bracket, and all patches.
    assert [f.code for f in calibration.findings].count("exposures-left-out") == 1
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=1e-4)


REFUSED = {
    "patch 'P4' has no meter reading": lambda o, d, r: (o, d, {name: r[name] for name in r if name != "P4"}),
    "readings of patch 'P99', but no frames": lambda o, d, r: (o, d, r | {"P99": [make_reading(1.0)]}),
    "is a held peak": lambda o, d, r: (o, d, r | {"P1": [make_reading(50.0, peak=True)]}),
    "with one meter": lambda o, d, r: (o, d, r | {"P1": [make_reading(1.0, meter=MeterIdentity("LS-100", "1"))]}),
    "set of dark frames": lambda o, d, r: (o, all_with(d, state=replace(d[0].state, gain_db=6.0)), r),
    "0 of 12 patches are usable": lambda o, d, r: (o, all_with(d, mean_dn=5000.0), r),
    "sees less light from the first": lambda o, d, r: (o, d, r | {"P4": r["P7"], "P7": r["P4"]}),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_does_not_belong_together_is_refused(camera, setup, message):
    with pytest.raises(LabcdpError, match=message):
        fit(*REFUSED[message](*bench(camera, exact)), setup)


def test_a_kinked_camera_is_straightened(camera, setup):
    """Above 2000 DN it gives only 85 % of what light adds: no quadratic."""

    def kinked(observation):
        net = observation.mean_dn - 64.0 - 40.0 * observation.exposure_s
        return replace(observation, mean_dn=observation.mean_dn - 0.15 * max(net - 2000.0, 0.0))

    exposures_s = (0.001, 0.004, 0.016, 0.064)
    observations, *others = bench(camera, luminances=np.geomspace(0.5, 2000, 14), exposures_s=exposures_s)
    calibration = fit([kinked(o) for o in observations], *others, setup)
    assert calibration.response.kind == "knees"
    assert calibration.response.net_dn[1] == pytest.approx(2000, rel=1e-3)
    seen = [kinked(camera.observe("wall", 300.0, 0.008, None))]
    assert patch_luminance(calibration, seen).luminance_cd_m2 == pytest.approx(300, rel=0.01)


@pytest.mark.parametrize(
    ("factor", "index", "why"),
    [(10.0, 0, "-decimal-point"), (0.1, 11, "-decimal-point"), (1 / CD_M2_PER_FL, 5, "-unit"), (1.1, 11, "")],
)
def test_a_bad_reading_is_named_and_moves_nothing(camera, setup, factor, index, why):
    observations, darks, readings = bench(camera, noisy(np.random.default_rng(3)), np.random.default_rng(4))
    right = fit(observations, darks, readings, setup)
    wrong = readings | {f"P{index}": [make_reading(LUMINANCES[index] * factor)]}
    calibration = fit(observations, darks, wrong, setup)
    assert [one.subject for one in calibration.findings if one.code == f"patch-contradicts{why}"] == [f"P{index}"]
    error = calibration.responsivity.responsivity_dn_s_cd_m2 / right.responsivity.responsivity_dn_s_cd_m2 - 1
    assert abs(error) < 2 * right.responsivity.random_rel
    assert calibration.responsivity.random_rel < 1.5 * right.responsivity.random_rel
    # It stays in the tables, for the user to decide, and makes no range.
    assert [row.patch for row in calibration.residuals] == [row.patch for row in right.residuals]
    assert calibration.range_cd_m2 == pytest.approx(right.range_cd_m2, rel=0.01)


@pytest.mark.parametrize("factors", [(1.2, 1.2), (0.8, 1.2), (1.05, 0.95), (1.03, 1.2)])
@pytest.mark.parametrize("patches", [(3, 9), (6, 7)])
def test_two_bad_readings_of_twelve_do_not_hide_each_other(camera, setup, factors, patches):
    rng = np.random.default_rng([*patches, *(int(100 * f) for f in factors)])
    observations, darks, readings = bench(camera, noisy(rng), rng)
    wrong = {f"P{k}": [make_reading(LUMINANCES[k] * f)] for k, f in zip(patches, factors, strict=True)}
    calibration = fit(observations, darks, readings | wrong, setup)
    named = {one.subject: one.values["ratio"] for one in calibration.findings if "contradicts" in one.code}
    assert named == {f"P{k}": pytest.approx(f, abs=0.01) for k, f in zip(patches, factors, strict=True)}
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=0.004)
    assert calibration.responsivity.scatter_rel < 0.003
    assert not calibration.left_out or all(one.reading is None for one in calibration.left_out)


@pytest.mark.parametrize("factors", [(1.2, 0.8), (1.05, 1.05)])
def test_two_bad_readings_of_four_patches_are_named(camera, setup, factors):
    """Three readings of each: half of the patches have one that is wrong."""
    rng = np.random.default_rng(5)
    observations, darks, readings = bench(camera, noisy(rng), rng, LUMINANCES[1::3], n_readings=3)
    for patch, factor, number in (("P1", factors[0], 1), ("P3", factors[1], 2)):
        value = readings[patch][number].value * factor
        readings[patch][number] = replace(readings[patch][number], value=value)
    found = fit(observations, darks, readings, setup).findings
    named = {(one.subject, one.values["number"]) for one in found if one.code == "reading-contradicts"}
    assert named == {("P1", 2), ("P3", 3)}


def test_two_readings_that_contradict_each_other_have_little_weight(camera, setup):
    observations, darks, readings = bench(camera)
    (one,) = readings["P5"]
    readings["P5"] = [make_reading(10 * LUMINANCES[5]), replace(one, timestamp=one.timestamp.replace(second=5))]
    calibration = fit(observations, darks, readings, setup)
    assert ("readings-scatter", "P5") in [(one.code, one.subject) for one in calibration.findings]
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=1e-3)


def test_held_out_patches_are_not_shown_to_the_fit(camera, setup):
    observations, darks, readings = bench(camera, exact)
    wrong = readings | {"P4": [make_reading(LUMINANCES[4] * 1.02)]}
    calibration = fit(observations, darks, wrong, setup, held_out=["P4", "P9"])
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=1e-6)
    assert calibration.held_out[0].residual_rel == pytest.approx(1 / 1.02 - 1, rel=1e-3)
    assert calibration.held_out[1].residual_rel == pytest.approx(0, abs=1e-6)


def at_gain(camera, gain_db, factor):
    scaled = {"responsivity_dn_s_cd_m2": 1200 * factor, "dark_offset_dn": 64 * factor, "k_dn_per_e": 0.25 * factor}
    return replace(camera, state=replace(camera.state, gain_db=gain_db), **scaled)


def test_gains_are_fitted_together(camera, setup):
    rng, factor, z = np.random.default_rng(8), 10 ** (6 / 20), []
    for _ in range(12):
        observations, darks, readings = bench(camera, noisy(rng), rng)
        more = bench(at_gain(camera, 6.0, factor), rng=rng)
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


def test_a_gain_that_is_not_what_it_says_is_reported(camera, setup):
    observations, darks, readings = bench(camera, exact)
    more = bench(at_gain(camera, 6.0, 1.9))
    calibration = fit([*observations, *more[0]], [*darks, *more[1]], readings, setup)
    assert calibration.gains[0].factor == pytest.approx(1.9, rel=1e-6)
    assert "gain-deviates" in codes(calibration)
