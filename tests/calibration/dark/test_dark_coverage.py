"""Intervals cover where the dark frames say little: one exposure, another temperature."""

from dataclasses import replace
from math import log, sqrt

import numpy as np
import pytest

from labcdp.calibration import contrast_u, fit, patch_luminance

from ..conftest import SimulatedCamera, SimulatedMeter, codes

EXPOSURES_S = (0.001, 0.005, 0.03, 0.2)
LUMINANCES = np.geomspace(0.05, 500, 10)


def covered(rng, setup, light_c, measured_c, dark_s):
    """Whether the intervals of a luminance and of a contrast hold the truth, and whether a finding warns.

    The dark frames have 30 degC, and the dark current doubles every 6 to 10 degC.
    """
    k, doubling_c = 10 ** rng.uniform(-1.3, -0.3), rng.uniform(6, 10)
    camera = SimulatedCamera(rng.uniform(800, 1500), k, rng.uniform(0.8, 3.0), dark_rate_dn_s=rng.uniform(0, 60))
    meter = SimulatedMeter(0.02, 0.002, rng.uniform(-0.02, 0.02))

    def patch(name, luminance, temperature_c):
        warm = replace(camera, dark_rate_dn_s=camera.dark_rate_dn_s * 2 ** ((temperature_c - 30) / doubling_c))
        return [replace(warm.observe(name, luminance, t, rng), temperature_c=temperature_c) for t in EXPOSURES_S]

    observations = [o for i, v in enumerate(LUMINANCES) for o in patch(f"P{i}", v, light_c)]
    readings = {f"P{i}": [meter.read(v, rng, s) for s in range(3)] for i, v in enumerate(LUMINANCES)}
    calibration = fit(observations, [replace(camera.dark(t, rng), temperature_c=30.0) for t in dark_s], readings, setup)
    truths = np.exp(rng.uniform(log(0.2), log(200), 2))
    a, b = (patch_luminance(calibration, patch("new", v, measured_c)) for v in truths)
    low, high = a.interval_95_cd_m2
    difference = a.luminance_cd_m2 / b.luminance_cd_m2 - truths[0] / truths[1]
    inside = low <= truths[0] <= high, abs(difference) <= 1.96 * contrast_u(a, b)
    return *inside, "temperature-not-covered" in codes(a)


@pytest.mark.parametrize("n", [8, pytest.param(200, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("light_c", "measured_c", "dark_s", "warned"),
    [
        pytest.param(30.0, 40.0, EXPOSURES_S, True, id="measured at another temperature"),
        pytest.param(33.0, 33.0, EXPOSURES_S, True, id="calibrated at another temperature than the dark frames"),
        pytest.param(30.0, 30.0, (0.03,), False, id="dark frames at one exposure"),
    ],
)
def test_where_the_dark_signal_is_less_known_the_intervals_are_wider(setup, light_c, measured_c, dark_s, warned, n):
    rng = np.random.default_rng(20260201)
    shares = np.mean([covered(rng, setup, light_c, measured_c, dark_s) for _ in range(n)], axis=0)
    # What is known about any camera of silicon covers more than the truth of one.
    assert min(shares[:2]) > 0.95 - 3 * sqrt(0.95 * 0.05 / n)
    assert (shares[2] > 0) == warned
