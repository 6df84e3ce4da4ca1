"""Stated 95 % intervals cover the true luminance in 95 % of simulated calibrations."""

import logging
from math import log, sqrt

import numpy as np
import pytest

from labcdp.calibration import fit, patch_luminance

#: Calibrations. One patch is drawn for each, as the scale error ties all its patches together; the calibrations are
#: the independent units.
N = [40, pytest.param(400, marks=pytest.mark.long)]
EXPOSURES_S = (0.001, 0.008, 0.064)
LUMINANCES = np.geomspace(0.5, 2000, 12)


@pytest.fixture(autouse=True)
def _quiet(caplog):
    caplog.set_level(logging.CRITICAL)


def one_calibration(rng, camera_class, meter_class, setup, case):
    """Calibrate a random camera; true luminance and calibrated luminance of a new patch."""
    half_width, repeatability_rel, size = case
    camera = camera_class(
        responsivity_dn_s_cd_m2=rng.uniform(800, 1500),
        k_dn_per_e=10 ** rng.uniform(-1.3, -0.3),
        dark_noise_dn=rng.uniform(0.6, 3.0),
    )
    meter = meter_class(half_width, repeatability_rel, rng.uniform(-half_width, half_width))
    observations = [camera.observe(f"P{i}", v, t, rng, (100, 4)) for i, v in enumerate(LUMINANCES) for t in EXPOSURES_S]
    darks = [camera.dark(t, rng) for t in EXPOSURES_S]
    readings = {f"P{i}": [meter.read(v, rng, second) for second in range(3)] for i, v in enumerate(LUMINANCES)}
    calibration = fit(observations, darks, readings, setup)
    truth = np.exp(rng.uniform(log(LUMINANCES[0]), log(LUMINANCES[-1])))
    return truth, patch_luminance(calibration, [camera.observe("new", truth, t, rng, size) for t in EXPOSURES_S])


@pytest.mark.parametrize("n", N)
@pytest.mark.parametrize(
    "case",
    [
        pytest.param((0.02, 0.002, (400, 4)), id="the meter's scale dominates"),
        pytest.param((0.0, 0.002, (16, 2)), id="the meter has no bias, random errors only"),
        pytest.param((0.02, 0.03, (16, 2)), id="scale and random errors alike", marks=pytest.mark.long),
    ],
)
def test_coverage(camera_class, meter_class, setup, case, n):
    rng = np.random.default_rng(20260101)
    inside, by_random_part = [], []
    for _ in range(n):
        truth, patch = one_calibration(rng, camera_class, meter_class, setup, case)
        low, high = patch.interval_95_cd_m2
        inside.append(low <= truth <= high)
        by_random_part.append(
            abs(truth / patch.luminance_cd_m2 - 1) <= 1.96 * np.hypot(patch.random_rel, patch.fit_rel)
        )
    if case[0] > 5 * case[1]:
        # The meter's scale is what the interval is made of.
        assert np.mean(by_random_part) < 0.6
    assert np.mean(inside) == pytest.approx(0.95, abs=3 * sqrt(0.95 * 0.05 / n))
