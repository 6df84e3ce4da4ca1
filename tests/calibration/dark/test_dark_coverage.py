"""Intervals cover where the dark frames say little: one exposure, another temperature, pixels that differ."""

import logging
from dataclasses import replace
from math import log, sqrt

import numpy as np
import pytest

from labcdp.calibration import contrast_uncertainty, fit, patch_luminance
from labcdp.calibration.frames.nonuniformity import Nonuniformity

from ..conftest import SimulatedCamera, SimulatedMeter

#: Calibrations.
N = [20, pytest.param(200, marks=pytest.mark.long)]
EXPOSURES_S = (0.001, 0.005, 0.03, 0.2)
LUMINANCES = np.geomspace(0.05, 500, 10)
REFERENCE_C = 30.0
SIZE = (400, 4)


@pytest.fixture(autouse=True)
def _quiet(caplog):
    caplog.set_level(logging.CRITICAL)


class Bench:
    """A camera whose dark current doubles every 6 to 10 degC, and whose pixels differ in dark signal."""

    def __init__(self, rng, dsnu_dn=0.0):
        self.rng, self.dsnu_dn = rng, dsnu_dn
        self.camera = SimulatedCamera(
            responsivity_dn_s_cd_m2=rng.uniform(800, 1500),
            k_dn_per_e=10 ** rng.uniform(-1.3, -0.3),
            dark_noise_dn=rng.uniform(0.8, 3.0),
            dark_rate_dn_s=rng.uniform(0, 60),
        )
        self.doubling_c = rng.uniform(6, 10)
        self.meter = SimulatedMeter(0.02, 0.002, rng.uniform(-0.02, 0.02))

    def at(self, temperature_c):
        growth = 2 ** ((temperature_c - REFERENCE_C) / self.doubling_c)
        return replace(self.camera, dark_rate_dn_s=self.camera.dark_rate_dn_s * growth)

    def patch(self, name, luminance, temperature_c):
        """The same pixels at all exposures."""
        offset_dn = self.rng.normal(0, self.dsnu_dn / sqrt(SIZE[0]))
        seen = [self.at(temperature_c).observe(name, luminance, t, self.rng, SIZE) for t in EXPOSURES_S]
        return [self.with_pattern(o, offset_dn, temperature_c) for o in seen]

    def with_pattern(self, o, offset_dn, temperature_c):
        dof = o.n_pixels - 16
        within = (self.dsnu_dn**2 + o.temporal_variance_dn2 / o.n_frames) * self.rng.chisquare(dof) / dof
        uneven = Nonuniformity((within, 0.0, 0.0), (within, 0.0, 0.0), 15, 25.0)
        return replace(o, signal_dn=o.signal_dn + offset_dn, nonuniformity=uneven, temperature_c=temperature_c)

    def dark(self, t):
        seen = self.camera.dark(t, self.rng)
        return replace(seen, temperature_c=REFERENCE_C, pattern_dn=self.dsnu_dn)

    def calibrate(self, setup, light_c=REFERENCE_C, dark_s=EXPOSURES_S):
        observations = [o for i, v in enumerate(LUMINANCES) for o in self.patch(f"P{i}", v, light_c)]
        readings = {f"P{i}": [self.meter.read(v, self.rng, s) for s in range(3)] for i, v in enumerate(LUMINANCES)}
        return fit(observations, [self.dark(t) for t in dark_s], readings, setup)


def covered(bench, calibration, temperature_c):
    """Whether the intervals of a luminance and of a contrast hold the truth, and the findings."""
    truths = np.exp(bench.rng.uniform(log(0.2), log(200), 2))
    a, b = (patch_luminance(calibration, bench.patch("new", v, temperature_c)) for v in truths)
    low, high = a.interval_95_cd_m2
    difference = a.luminance_cd_m2 / b.luminance_cd_m2 - truths[0] / truths[1]
    return low <= truths[0] <= high, abs(difference) <= 1.96 * contrast_uncertainty(a, b), a.findings


@pytest.mark.parametrize("n", N)
@pytest.mark.parametrize(
    ("light_c", "measured_c", "dark_s", "warned"),
    [
        pytest.param(30.0, 40.0, EXPOSURES_S, True, id="measured at another temperature"),
        pytest.param(33.0, 33.0, EXPOSURES_S, True, id="calibrated at another temperature than the dark frames"),
        pytest.param(30.0, 30.0, (0.03,), False, id="dark frames at one exposure"),
    ],
)
def test_where_the_dark_signal_is_less_known_the_intervals_are_wider(setup, light_c, measured_c, dark_s, warned, n):
    rng, seen = np.random.default_rng(20260201), []
    for _ in range(n):
        bench = Bench(rng)
        seen.append(covered(bench, bench.calibrate(setup, light_c, dark_s), measured_c))
    # What is known about any camera of silicon covers more than the truth of one.
    least = 0.95 - 3 * sqrt(0.95 * 0.05 / n)
    assert np.mean([luminance for luminance, _, _ in seen]) > least
    assert np.mean([contrast for _, contrast, _ in seen]) > least
    assert any(one.code == "temperature-not-covered" for _, _, findings in seen for one in findings) == warned


@pytest.mark.parametrize("n", N)
def test_pixels_of_non_uniform_dark_signal_are_no_scatter_of_the_patches(setup, n):
    rng, alarms, inside = np.random.default_rng(20260202), 0, []
    for _ in range(n):
        bench = Bench(rng, dsnu_dn=2.0)
        calibration = bench.calibrate(setup)
        alarms += any(test.significant for test in calibration.tests if test.name == "scatter")
        inside.append(covered(bench, calibration, REFERENCE_C)[0])
    assert alarms <= 0.01 * n + 4 * sqrt(0.01 * n)
    assert np.mean(inside) == pytest.approx(0.95, abs=3 * sqrt(0.95 * 0.05 / n))
