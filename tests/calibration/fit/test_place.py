"""Errors that go with the place of a patch: the flat field's own, and a fall-off that is not taken off."""

import logging
from dataclasses import replace
from math import log, sqrt

import numpy as np
import pytest

from labcdp.calibration import contrast_uncertainty, fit, patch_luminance
from labcdp.calibration.frames.nonuniformity import smooth_patterns
from labcdp.core.vignetting import Cos4Vignetting, FlatField, RadialVignetting

from ..conftest import EXPOSURES_S, SimulatedMeter, codes, found

SHAPE = (48, 64)
UNEVEN_REL = 0.01
EVEN_FIELD = FlatField(np.ones(SHAPE, np.float32), 0.0, UNEVEN_REL, 16)
PLACES = [(x, y) for y in (8, 24, 40) for x in (8, 24, 40, 56)]
_Y, _X = np.mgrid[: SHAPE[0], : SHAPE[1]]
PIXELS = np.column_stack([_X.ravel(), _Y.ravel()]) + 0.5


@pytest.fixture(autouse=True)
def _quiet(caplog):
    caplog.set_level(logging.CRITICAL)


def seen_at(camera, name, luminance, place, true_v, rng, vignetting=None):
    """Observations of a patch at a place where the camera gets the part `true_v` of the light."""
    return [
        replace(camera.observe(name, luminance * true_v, t, rng), centre_px=place, vignetting=vignetting)
        for t in EXPOSURES_S
    ]


def bench(camera, meter, rng, true_v, vignetting=None, *, drift_per_h=0.0, luminances=None):
    """Patches at random places; one reading every 5 minutes, of a light that drifts."""
    luminances = np.geomspace(0.5, 1000, len(PLACES)) if luminances is None else luminances
    order = rng.permutation(len(PLACES))[: len(luminances)]
    observations, readings = [], {}
    for number, (luminance, k) in enumerate(zip(luminances[rng.permutation(len(luminances))], order, strict=True)):
        observations += seen_at(camera, f"P{number}", luminance, PLACES[k], true_v[k], rng, vignetting)
        lit = luminance * (1 + drift_per_h * 300 * number / 3600)
        readings[f"P{number}"] = [meter.read(lit, rng, 600 + 300 * number + i) for i in range(3)]
    return observations, [camera.dark(t, rng) for t in EXPOSURES_S], readings


def covered(camera, calibration, rng, true_v, vignetting=None):
    """Whether the intervals of a luminance and of a contrast hold the truth."""
    truth = np.exp(rng.uniform(log(1.0), log(800), 3))
    places = rng.choice(len(PLACES), 3, replace=False)
    one, bright, dark = (
        patch_luminance(calibration, seen_at(camera, "new", v, PLACES[k], true_v[k], rng, vignetting))
        for v, k in zip(truth, places, strict=True)
    )
    low, high = one.interval_95_cd_m2
    off = bright.luminance_cd_m2 / dark.luminance_cd_m2 - truth[1] / truth[2]
    return low <= truth[0] <= high, abs(off) <= 1.96 * contrast_uncertainty(bright, dark)


def readings_left_out(calibration):
    return [row.patch for row in calibration.left_out if row.exposure_s is None]


def test_smooth_patterns_have_mean_0_and_rms_1_over_the_image():
    patterns = smooth_patterns(SHAPE, PIXELS)
    # Sums over pixels for integrals: right to one over the square of their number along a side.
    assert patterns.mean(axis=0) == pytest.approx(0, abs=2e-3)
    assert patterns.T @ patterns / len(PIXELS) == pytest.approx(np.eye(3), abs=3e-3)


@pytest.mark.parametrize(
    "vignetting",
    [Cos4Vignetting(1.0, 1e-6, None, 0.01), RadialVignetting(-0.2, 0, 0, None, ((1e-4, 0, 0), (0, 0, 0), (0, 0, 0)))],
)
def test_an_error_of_the_vignetting_moves_fit_and_patches_together(camera, setup, vignetting):
    """It is what a fit in the wrong light and then the same patches give, and cancels between near ones."""
    places = {"edge": (4, 4), "near": (5, 4), "middle": (32, 24)}

    def light(place):
        return 1 + vignetting.common_errors_at(SHAPE, place)[0]

    def seen(calibration, of_light):
        return {
            name: patch_luminance(calibration, seen_at(camera, "new", 300.0, place, of_light(place), None, vignetting))
            for name, place in places.items()
        }

    def fitted(true_v):
        luminances, rng, meter = np.array([5.0, 300.0] * 3), np.random.default_rng(2), SimulatedMeter(0.02, 0.02)
        return fit(*bench(camera, meter, rng, true_v, vignetting, luminances=luminances), setup)

    right = seen(fitted(np.ones(12)), lambda _: 1.0)
    wrong = seen(fitted(np.array([light(place) for place in PLACES])), light)
    stated = [[e for e in right[name].common if e.source in ("vignetting", "flat field")] for name in places]
    moved = {name: wrong[name].luminance_cd_m2 / right[name].luminance_cd_m2 - 1 for name in places}
    assert [-float(error.relative) for (error,) in stated] == pytest.approx(list(moved.values()), abs=2e-4)
    assert abs(moved["middle"]) > 1e-3
    near, far = (contrast_uncertainty(right["edge"], right[other]) for other in ("near", "middle"))
    assert near < 0.1 * far


@pytest.mark.parametrize("n", [20, pytest.param(200, marks=pytest.mark.long)])
def test_coverage_with_a_flat_field_of_a_non_uniform_source(camera, setup, n):
    """The source is uneven as stated: by a slope of any direction, and by patches of its own."""
    rng = np.random.default_rng(3)
    inside, lost, alarms = [], 0, 0
    for _ in range(n):
        meter = SimulatedMeter(true_scale_error_rel=rng.uniform(-0.02, 0.02))
        pattern = smooth_patterns(SHAPE, PLACES)[:, 1:] @ rng.normal(0, sqrt(1 / 4), 2)
        true_v = 1 + UNEVEN_REL * (pattern + rng.normal(0, sqrt(1 / 2), len(PLACES)))
        calibration = fit(*bench(camera, meter, rng, true_v, EVEN_FIELD), setup)
        lost += bool(readings_left_out(calibration))
        alarms += any(found(calibration, name).significant for name in ("drift", "vignetting", "scatter"))
        inside.append(covered(camera, calibration, rng, true_v, EVEN_FIELD))
    assert min(np.mean(inside, axis=0)) >= 0.95 - 3 * sqrt(0.95 * 0.05 / n)
    # One in a hundred each.
    assert max(lost, alarms) <= 0.01 * n + 4 * sqrt(0.01 * n)


@pytest.mark.parametrize(
    ("fall", "n_patches", "vignetting"),
    [(0.1, 12, None), (0.25, 6, None), (0.25, 12, Cos4Vignetting(1.0, 1e-6, None, 0.05))],
)
def test_vignetting_that_is_not_taken_off_is_named_and_counts(camera, setup, fall, n_patches, vignetting):
    rng, n = np.random.default_rng(4), 6
    half_diagonal = np.hypot(*SHAPE) / 2
    true_v = np.array([1 - fall * np.hypot(x - 32, y - 24) ** 2 / half_diagonal**2 for x, y in PLACES])
    inside, lost, named = [], 0, 0
    for _ in range(n):
        meter = SimulatedMeter(true_scale_error_rel=rng.uniform(-0.02, 0.02))
        luminances = np.geomspace(1, 800, n_patches)
        calibration = fit(*bench(camera, meter, rng, true_v, vignetting, luminances=luminances), setup)
        lost += bool(readings_left_out(calibration))
        # Six patches, of which one or two lie apart, cannot always tell a place from chance.
        expected = ("vignetting-not-corrected", "vignetting-not-cos4", "patches-scatter")[: 3 if n_patches == 6 else 2]
        named += not codes(calibration).isdisjoint(expected)
        assert calibration.responsivity.scatter_rel > 0.2 * np.std(true_v)
        inside.append(covered(camera, calibration, rng, true_v, vignetting))
    assert min(np.mean(inside, axis=0)) >= 0.95 - 3 * sqrt(0.95 * 0.05 / n)
    assert (lost, named) == (0, n)


@pytest.mark.parametrize("drift_per_h", [0.02, -0.05])
def test_a_drift_is_named_and_no_good_reading_lost(camera, setup, drift_per_h):
    rng = np.random.default_rng(7)
    for _ in range(4):
        calibration = fit(*bench(camera, SimulatedMeter(), rng, np.ones(12), drift_per_h=drift_per_h), setup)
        test = found(calibration, "drift")
        assert test.significant
        # Camera over meter falls as the light of the readings rises.
        assert test.value == pytest.approx(-drift_per_h, abs=4 * test.standard_uncertainty + 0.1 * abs(drift_per_h))
        assert not found(calibration, "vignetting").significant
        assert readings_left_out(calibration) == []


@pytest.mark.parametrize("bad", [0, 5])
def test_a_bad_reading_is_not_taken_for_a_drift_or_vignetting(camera, setup, bad):
    observations, darks, readings = bench(camera, SimulatedMeter(), np.random.default_rng(8), np.ones(12))
    readings[f"P{bad}"] = [replace(one, value=1.05 * one.value) for one in readings[f"P{bad}"]]
    calibration = fit(observations, darks, readings, setup)
    assert readings_left_out(calibration) == [f"P{bad}"]
    assert not any(found(calibration, name).significant for name in ("drift", "vignetting"))


@pytest.mark.parametrize("n", [20, pytest.param(200, marks=pytest.mark.long)])
def test_sound_patches_that_scatter_are_kept(camera, setup, n):
    """8 patches, 4 exposures and 1 % of scatter of the patches: one in a hundred calibrations may lose one."""
    rng, lost = np.random.default_rng(11), 0
    for _ in range(n):
        true_v = 1 + 0.01 * rng.normal(size=len(PLACES))
        data = bench(camera, SimulatedMeter(), rng, true_v, luminances=np.geomspace(1, 800, 8))
        lost += bool(readings_left_out(fit(*data, setup)))
    assert lost <= 0.01 * n + 3 * sqrt(0.01 * n)
