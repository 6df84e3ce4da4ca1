"""A camera whose temperature nobody stated, up to 10 K warmer or colder than the dark frames."""

from dataclasses import replace
from math import log, sinh, sqrt

import numpy as np
import pytest

from labcdp.calibration import contrast_U, fit, patch_luminance
from labcdp.calibration.budget import budget
from labcdp.calibration.camera import common_errors

from ..conftest import FEW_CD_M2, FEW_S, bench, codes, row

DOUBLING_K = 7.5


@pytest.fixture(scope="module")
def calibration(camera, setup):
    """Dark frames at 30 degC, 40 DN/s there."""
    observations, darks, readings = bench(camera, luminances=FEW_CD_M2, exposures_s=FEW_S)
    here = [replace(one, temperature_c=30.0) for one in observations]
    return fit(here, [replace(one, temperature_c=30.0) for one in darks], readings, setup)


def of_temperature(calibration, net_dn, exposure_s, temperature_c):
    errors = common_errors(calibration, net_dn, exposure_s, temperature_c=temperature_c)
    return len(errors), [e.relative for e in errors if e.source == "unknown temperature"]


def test_it_counts_where_one_of_the_two_temperatures_is_unknown(calibration):
    n, (unknown,) = of_temperature(calibration, 60.0, 0.1, None)
    # 95 % of temperatures within 10 K of 30 degC make less dark current than 39 degC do.
    assert unknown == pytest.approx(-40 * 0.1 * (2 ** (9 / DOUBLING_K) - 1) / 1.959964 / 60.0, rel=1e-3)
    # By its moments: the root mean square of what 2^(x / T_d) differs from 1, x evenly within 10 K, is hardly smaller.
    b = 10 * log(2) / DOUBLING_K
    rms = sqrt(1 + sinh(2 * b) / (2 * b) - 2 * sinh(b) / b)
    assert -unknown * 60 / 4 == pytest.approx(rms, rel=0.1)
    assert of_temperature(calibration, 60.0, 0.1, 35.0) == (n, [0.0])
    unstated = replace(calibration, dark=replace(calibration.dark, temperatures_c=(), temperature_c=None))
    assert of_temperature(unstated, 60.0, 0.1, 35.0) == (n, [pytest.approx(unknown, rel=1e-6)])
    assert of_temperature(unstated.at_their_temperature(), 60.0, 0.1, None) == (n, [0.0])


def test_the_budget_has_it_where_the_dark_frames_have_no_temperature(calibration):
    found = row(budget(calibration, 0.5, 0.1).rows, "unknown temperature")
    assert (found.u_rel, found.basis.code) == (0.0, "budget-unknown-temperature-none")
    unstated = replace(calibration, dark=replace(calibration.dark, temperatures_c=(), temperature_c=None))
    found = row(budget(unstated, 0.5, 0.1).rows, "unknown temperature")
    assert found.u_rel == pytest.approx(4 / 60 * (2 ** (9 / DOUBLING_K) - 1) / 1.959964, rel=1e-3)
    assert (found.evaluation, found.common, found.basis.code) == ("B", True, "budget-unknown-temperature")


def test_a_finding_says_so_where_it_matters(calibration, camera):
    dim, short = (camera.observe("wall", 5.0, t, None) for t in (0.1, 0.001))
    (found,) = (f for f in patch_luminance(calibration, [dim]).findings if f.code == "temperature-not-stated")
    assert found.values["growth"] == pytest.approx([2 ** (-10 / DOUBLING_K), 2 ** (10 / DOUBLING_K)])
    for harmless in (short, replace(dim, temperature_c=30.0)):
        assert "temperature-not-stated" not in codes(patch_luminance(calibration, [harmless]))


def test_intervals_hold_for_a_camera_that_is_warmer_or_colder(calibration, camera):
    """Pictures without a temperature: contrasts, in which the scale of the meter cancels."""
    rng, n, exposure_s, inside = np.random.default_rng(37), 1000, 0.1, 0
    for warmer_k in rng.uniform(-10, 10, n):
        there = replace(camera, dark_rate_dn_s=40 * 2 ** (warmer_k / DOUBLING_K))
        bright, dim = (patch_luminance(calibration, [there.observe("wall", v, exposure_s, rng)]) for v in (20.0, 1.0))
        error = bright.luminance_cd_m2 / dim.luminance_cd_m2 - 20.0
        inside += abs(error) <= contrast_U(bright, dim)
    assert abs(inside / n - 0.95) <= 3 * sqrt(0.95 * 0.05 / n)
