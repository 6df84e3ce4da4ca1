"""Effects beside the response: each is found with its size, and moves neither the responsivity nor another effect."""

from dataclasses import replace
from datetime import timedelta
from math import exp

import numpy as np
import pytest

from labcdp.calibration import fit, patch_luminance
from labcdp.calibration.fitting.candidates import CandidateModel, candidate_models
from labcdp.calibration.fitting.design import SharedError
from labcdp.calibration.fitting.effects import FALSE_ALARM, Effect, amplitude, assess
from labcdp.calibration.fitting.problem import solve
from labcdp.calibration.fitting.selection import select
from labcdp.calibration.frames.observations import PatchPart

from ..conftest import EXPOSURES_S, LUMINANCES, START, SimulatedCamera, bench, codes, found, make_reading
from .test_problem import design_of

#: What names an effect beside the response.
CAUSES = {"intercept", "dark-differs", "dark-current-differs", "exposures-offset", "exposure-deviates", "drift"} | {
    "readings-step", "vignetting-not-corrected", "surroundings", "patch-contradicts", "one-of",
}  # fmt: skip


def noisy(seed):
    rng = np.random.default_rng(seed)
    return rng, lambda v: make_reading(v * (1 + rng.normal(0, 0.002)))


def calibrated(setup, seed=1, seen=lambda o: o, camera=SimulatedCamera(), dark_camera=None):  # noqa: B008
    rng, read = noisy(seed)
    observations, darks, readings = bench(camera, read, rng)
    darks = darks if dark_camera is None else bench(dark_camera, rng=rng)[1]
    for k, (name, (one,)) in enumerate(readings.items()):
        # In an order that is not that of the luminances.
        readings[name] = [replace(one, timestamp=START + timedelta(minutes=5 * k % 12))]
    return fit([seen(o) for o in observations], darks, readings, setup)


def test_an_amplitude_is_that_of_weighted_least_squares_with_one_more_parameter():
    rng = np.random.default_rng(5)
    net, column, u = rng.uniform(10, 1000, 9), rng.normal(0, 1, 9), rng.uniform(1, 2, 9)
    readings = 0.3 * net + 0.7 * column + rng.normal(0, u)
    solution = solve(design_of(net, readings, np.full(9, 1e-12), u**2), CandidateModel("linear", (1000.0,)))
    found_one = amplitude(solution, column[None])
    # In luminances less readings.
    x = np.column_stack([net, -column]) / u[:, None]
    expected, left, *_ = np.linalg.lstsq(x, readings / u, rcond=None)
    assert found_one.value[0] == pytest.approx(expected[1], rel=1e-6)
    assert found_one.uncertainty[0] == pytest.approx(np.linalg.inv(x.T @ x)[1, 1] ** 0.5, rel=1e-6)
    assert found_one.drop == pytest.approx(solution.chi_squared - left[0], rel=1e-5)


def test_columns_that_the_response_explains_are_no_effect():
    net = np.geomspace(10, 1000, 8)
    solution = solve(design_of(net, 0.3 * net, np.ones(8), 1e-4 * net**2), CandidateModel("linear", (1000.0,)))
    assert assess(solution, Effect("drift", (SharedError("drift", 1.0),))).amplitude.n == 0


@pytest.mark.parametrize(("n", "most"), [(10, 2), pytest.param(30, 3, marks=pytest.mark.long)])
def test_what_is_not_there_is_found_as_seldom_as_chance_allows(setup, n, most):
    """Eight kinds of effects, each in 0.27 % of calibrations: more have a probability of 0.1 and 0.3 %."""
    named = sum(bool(codes(calibrated(setup, seed)) & CAUSES) for seed in range(n))
    assert named <= most
    assert 8 * FALSE_ALARM < 0.05


def shifted(dn=0.0, dn_per_s=0.0):
    return lambda o: replace(
        o,
        mean_dn=o.mean_dn + dn + dn_per_s * o.exposure_s,
        frame_means_dn=tuple(m + dn + dn_per_s * o.exposure_s for m in o.frame_means_dn),
    )


@pytest.mark.parametrize(
    ("seen", "code", "check", "value"),
    [
        (shifted(dn=6.0), "dark-differs", "dark signal", 6.0),
        (shifted(dn_per_s=-300.0), "dark-current-differs", "dark signal", -300 * EXPOSURES_S[-1]),
    ],
)
def test_a_dark_signal_that_is_not_that_of_the_light_frames(setup, seen, code, check, value):
    calibration = calibrated(setup, seen=seen)
    assert codes(calibration) & CAUSES == {code}
    assert found(calibration, check).value == pytest.approx(value, rel=0.1)
    fitted = calibration.responsivity
    assert fitted.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=4 * fitted.random_rel)
    assert fitted.random_rel < 0.003
    # Nothing says that it stays: a dark patch is as uncertain, and the truth is within.
    patch = patch_luminance(calibration, [seen(SimulatedCamera().observe("X", 1.0, EXPOSURES_S[-1], None))])
    moved = abs(value) / (1200 * EXPOSURES_S[-1])
    half_width = patch.U_rel * patch.luminance_cd_m2
    assert abs(patch.luminance_cd_m2 - 1) < half_width == pytest.approx(1.96 * moved, rel=0.1)


def with_rim(share_by_patch):
    """Light of the surroundings in the rims of some regions; what is inside is as it was."""

    def seen(o):
        dark_dn = 64 + 40 * o.exposure_s
        net = o.mean_dn - dark_dn
        inside = PatchPart(o.mean_dn, 1.0, 0.56)
        return replace(o, mean_dn=dark_dn + net * (1 + share_by_patch.get(o.patch, 0.0)), inside=inside)

    return seen


def test_light_of_the_surroundings_in_the_regions_is_named_and_costs_no_certainty(setup):
    shares = {"P0": 0.5, "P1": 0.2, "P2": 0.08, "P3": 0.03, "P4": 0.01, "P10": -0.01, "P11": -0.02}
    sharp = calibrated(setup)
    calibration = calibrated(setup, seen=with_rim(shares))
    assert "surroundings" in codes(calibration)
    fitted = calibration.responsivity
    assert fitted.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=4 * fitted.random_rel)
    assert fitted.random_rel < 3 * sharp.responsivity.random_rel
    # In another session such a patch is uncertain by as much, and named; a clean one is neither.
    for share, named in ((0.05, True), (0.0, False)):
        patch = patch_luminance(sharp, [with_rim({"X": share})(SimulatedCamera().observe("X", 20.0, 0.064, None))])
        assert ("patch-rim" in codes(patch)) == named
        assert abs(patch.luminance_cd_m2 / 20 - 1) <= patch.U_rel
        assert (patch.random_rel > 0.03) == named


def kneed(knees):
    """A camera that gives less DN for more light above each knee (DN above dark)."""

    def seen(o):
        dark_dn = 64 + 40 * o.exposure_s
        linear, net = o.mean_dn - dark_dn, 0.0
        for (low, slope), high in zip([(0.0, 1.0), *knees], [*(k for k, _ in knees), np.inf], strict=True):
            taken = min(max(linear, 0.0), (high - low) / slope)
            net, linear = net + slope * taken, linear - taken
        return replace(o, mean_dn=dark_dn + net)

    return seen


def test_companding_that_nobody_states_is_found(setup):
    knees = ((300.0, 0.5), (900.0, 0.25))
    rng, read = noisy(3)
    camera = SimulatedCamera(state=replace(SimulatedCamera().state, saturation_dn=1e9))
    luminances = np.geomspace(0.5, 8000, 14)
    observations, darks, readings = bench(camera, read, rng, luminances, (0.001, 0.004, 0.016))
    calibration = fit([kneed(knees)(o) for o in observations], darks, readings, setup)
    assert calibration.response.kind == "knees"
    assert calibration.response.net_dn[1:3] == pytest.approx([300, 900], rel=0.03)
    for luminance in (3.0, 60.0, 700.0):
        patch = patch_luminance(calibration, [kneed(knees)(camera.observe("X", luminance, 0.004, None))])
        assert abs(patch.luminance_cd_m2 / luminance - 1) < max(patch.U_rel, 0.005)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("veil_cd_m2", [50.0, 200.0])
def test_a_veil_far_above_the_darkest_patch_is_glare_and_moves_no_responsivity(setup, veil_cd_m2, seed):
    rng, read = noisy(seed)
    observations, darks, _ = bench(SimulatedCamera(), rng=rng, luminances=[v + veil_cd_m2 for v in LUMINANCES])
    calibration = fit(observations, darks, bench(SimulatedCamera(), read)[2], setup)
    assert codes(calibration) & CAUSES <= {"intercept", "one-of"}
    assert found(calibration, "glare").value == pytest.approx(veil_cd_m2, rel=0.01)
    assert calibration.responsivity.responsivity_dn_s_cd_m2 == pytest.approx(1200, rel=0.005)


def test_of_two_equal_explanations_both_are_named():
    """At one exposure an offset of the DN and a veil are the same."""
    net = np.geomspace(20, 2000, 9)
    readings = 0.1 * (net - 10)
    design = design_of(net, readings, np.ones(9), (1e-3 * readings) ** 2)
    design = replace(design, exposure=np.zeros(9, int), exposures_s=np.ones(1))
    (one,) = select(design, candidate_models(design, 64.0)).effects
    assert {one.effect.kind, *(rival.effect.kind for rival in one.rivals)} == {"glare", "dark signal"}
    assert exp(max(rival.log_p for rival in one.rivals)) < FALSE_ALARM


def test_a_bad_patch_has_little_weight_and_does_not_leave_the_fit(setup):
    rng, read = noisy(7)
    observations, darks, readings = bench(SimulatedCamera(), read, rng)
    readings["P6"] = [make_reading(1.3 * LUMINANCES[6])]
    calibration = fit(observations, darks, readings, setup)
    assert codes(calibration) & CAUSES == {"patch-contradicts"}
    row = next(row for row in calibration.residuals if row.patch == "P6")
    assert row.residual_rel == pytest.approx(1 / 1.3 - 1, abs=0.01)
    assert calibration.responsivity.scatter_rel < 0.003


def drifting(setup, seed):
    """A calibration whose readings fall by 1 % in an hour, and of which causes it says that they may be."""
    rng, _ = noisy(seed)
    observations, darks, readings = bench(SimulatedCamera(), rng=rng)
    for k, (name, (one,)) in enumerate(readings.items()):
        minutes = 5 * (5 * k % 12)
        value = one.value * (1 - 0.01 * minutes / 60) * (1 + rng.normal(0, 0.002))
        readings[name] = [replace(one, value=value, timestamp=START + timedelta(minutes=minutes))]
    findings = fit(observations, darks, readings, setup).findings
    return {code for one in findings for code in one.values.get("codes", [one.code])} & CAUSES


@pytest.mark.parametrize("n", [8, pytest.param(24, marks=pytest.mark.long)])
def test_a_cause_beside_which_another_one_is_not_significant_is_named_with_it(setup, n):
    named = [drifting(setup, seed) for seed in range(n)]
    assert sum(map(bool, named)) > n / 3
    assert all("drift" in one for one in named if one)


def test_light_that_reaches_the_middle_of_a_region_counts_as_far_as_it_is_seen(setup):
    """A halo of which the rim has 2 % and the middle third 6 % less than the mean of the region."""
    sharp = calibrated(setup)
    o = with_rim({"X": 0.02})(SimulatedCamera().observe("X", 20.0, 0.064, None))
    net = o.mean_dn - 64 - 40 * o.exposure_s
    middle = PatchPart(o.mean_dn - 0.06 * net, 1.0, 0.11)
    patch = patch_luminance(sharp, [replace(o, middle=middle)])
    assert patch.rim_rel == pytest.approx(0.06, abs=0.002)
    assert patch.U_rel > 1.96 * 0.06
