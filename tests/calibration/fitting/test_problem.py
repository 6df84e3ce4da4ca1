"""Fits with errors in both variables, against published figures, brute force and repeated draws."""

from dataclasses import fields, replace
from datetime import UTC, datetime

import numpy as np
import pytest
from scipy.optimize import least_squares

from labcdp.calibration.fitting.candidates import CandidateModel
from labcdp.calibration.fitting.design import Design, SharedError
from labcdp.calibration.fitting.problem import solve
from labcdp.calibration.fitting.scatter import residual_scatter, scatter_around_mean
from labcdp.calibration.readings import PatchReading
from labcdp.calibration.signal import NetSignals

START = datetime(2018, 3, 1, 12, tzinfo=UTC)
# Pearson's points with York's weights, the standard test of such fits: D. York, Can. J. Phys. 44 (1966) 1079; the
# solution to these digits in D. York et al., Am. J. Phys. 72 (2004) 367.
PEARSON_X = np.array([0.0, 0.9, 1.8, 2.6, 3.3, 4.4, 5.2, 6.1, 6.5, 7.4])
PEARSON_Y = np.array([5.9, 5.4, 4.4, 4.6, 3.5, 3.7, 2.8, 2.8, 2.4, 1.5])
YORK_X_WEIGHT = np.array([1000, 1000, 500, 800, 200, 80, 60, 20, 1.8, 1.0])
YORK_Y_WEIGHT = np.array([1.0, 1.8, 4.0, 8.0, 20, 20, 70, 70, 100, 500])


def design_of(net, readings, net_variance, reading_variance, patch=None, scale_per_s=1.0, **changes):
    """One exposure of 1 s; each observation its own patch unless told."""
    n, n_patches = len(net), len(readings)
    values = {one.name: np.zeros(n, int) for one in fields(NetSignals)}
    values |= {"net_dn": np.asarray(net), "scale_per_s": scale_per_s * np.ones(n), "noise_variance_dn2": net_variance}
    by_meter = [(f"P{i}", *one) for i, one in enumerate(zip(readings, np.sqrt(reading_variance), strict=True))]
    values = {
        "patch_readings": tuple(PatchReading(*one, 1, START) for one in by_meter),
        "patch": np.arange(n) if patch is None else patch,
        "exposure": np.arange(n),  # each its own, so that exposure errors are independent and tiny
        "exposures_s": np.ones(n),
        "signals": NetSignals(**values),
        "shared": (),
        "own_rel": np.zeros(n_patches),
        "position_patterns": np.zeros((n_patches, 3)),
        "rim_rel": np.zeros(n_patches),
        "delay_h": np.zeros(n),
    }
    return Design(**(values | changes))


class _FreeLine(CandidateModel):
    """y = b1 x + b2: a line that need not go through zero, to compare with York's."""

    @property
    def n_parameters(self):
        return 2

    def start(self, slope):
        return np.array([-0.5, 5.0])

    def rises(self, parameters):
        return True

    def curve(self, parameters, net_dn):
        value, slope = super().curve(parameters[:1], net_dn)
        return value + parameters[1], slope

    def jacobian(self, parameters, net_dn):
        return np.column_stack([super().jacobian(parameters[:1], net_dn), np.ones_like(net_dn)])


def test_york_and_pearson():
    # The start divides by the signal, so the first point is moved from 0 by less than the digits compared.
    design = design_of(np.maximum(PEARSON_X, 1e-12), PEARSON_Y, 1 / YORK_X_WEIGHT, 1 / YORK_Y_WEIGHT)
    solution = solve(design, _FreeLine("linear", (8.0,)))
    assert solution.parameters == pytest.approx([-0.480533407, 5.47991022], abs=2e-7)
    assert solution.chi_squared / solution.degrees_of_freedom == pytest.approx(1.4833, abs=5e-5)


def points(seed, n=8):
    rng = np.random.default_rng(seed)
    truth = np.geomspace(1, 100, n)
    net_std, reading_std = 0.03 * truth + 0.05, 0.05 * truth
    return truth + rng.normal(0, net_std), 3 * truth + 3 * rng.normal(0, reading_std), net_std**2, 9 * reading_std**2


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("kind", ["linear", "quadratic"])
def test_it_is_the_least_distance_over_all_true_points(seed, kind):
    net, readings, net_variance, reading_variance = points(seed)
    top = float(net.max())

    def distances(p):
        truth = p[2:]
        curve = p[0] * truth + (p[1] * truth**2 / top if kind == "quadratic" else 0)
        return np.concatenate([(net - truth) / np.sqrt(net_variance), (readings - curve) / np.sqrt(reading_variance)])

    best = least_squares(distances, [3.0, 0.0, *net], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    solution = solve(design_of(net, readings, net_variance, reading_variance), CandidateModel(kind, (top,)))
    # Effective variances take the curve as straight over an error: exact for a line, close for a weak bend.
    tolerance = 1e-5 if kind == "linear" else 2e-2
    assert solution.parameters[0] == pytest.approx(best.x[0], rel=tolerance)
    assert solution.chi_squared == pytest.approx(2 * best.cost, rel=tolerance)


def test_parameters_scatter_as_stated_and_have_no_bias():
    """A patch's reading is shared by its exposures, a dark error by all observations."""
    n, rng = 300, np.random.default_rng(7)
    luminance, scale = np.repeat(np.geomspace(1, 50, 6), 3), np.tile([1.0, 0.25, 0.05], 6)
    patch = np.repeat(np.arange(6), 3)
    net_true = luminance / (0.01 * scale)
    noise, reading, dark = 0.3 + 0.002 * net_true, 0.01 * np.geomspace(1, 50, 6), np.full(18, 0.5)
    draws, chi_squared = [], []
    for _ in range(n):
        net = net_true + rng.normal(0, noise) - dark * rng.normal()
        shown = np.geomspace(1, 50, 6) + rng.normal(0, reading)
        error = SharedError("dark and temperature", np.zeros(18), dark, (0.5, 0.0, 0.0), 0.0)
        design = design_of(net, shown, noise**2, reading**2, patch, scale_per_s=scale, shared=(error,))
        solution = solve(design, CandidateModel("linear", (float(net_true.max()),)))
        draws.append((solution.parameters[0], np.sqrt((solution.gain @ solution.covariance @ solution.gain.T)[0, 0])))
        chi_squared.append(solution.chi_squared)
    slopes, stated = np.array(draws).T
    assert slopes.mean() == pytest.approx(0.01, abs=4 * stated.mean() / np.sqrt(n))
    assert slopes.std() == pytest.approx(stated.mean(), rel=4 / np.sqrt(2 * n))
    assert np.mean(chi_squared) == pytest.approx(17, abs=4 * np.sqrt(2 * 17 / n))


def test_scatter_that_is_all_there_is_is_the_standard_deviation():
    values = np.random.default_rng(3).normal(1, 0.01, 9)
    assert scatter_around_mean(values, np.full(9, 1e-18)).size == pytest.approx(values.std(ddof=1), rel=1e-9)


def test_columns_that_the_patches_do_not_show_change_no_scatter():
    """As of light that changes across the one row in which all patches lie, or a column that is another one again."""
    rng, luminance = np.random.default_rng(5), np.geomspace(1, 50, 9)
    seen = 100 * luminance * (1 + 0.02 * rng.normal(size=9))
    design = design_of(seen, luminance, np.full(9, 0.1), (0.002 * luminance) ** 2)
    solution = solve(design, CandidateModel("linear", (float(seen.max()),)))
    plain = residual_scatter(solution)
    assert plain == pytest.approx(0.02, rel=4 / np.sqrt(2 * 8))
    for column in (np.zeros((9, 1)), 1e-6 * solution.jacobian, -3e5 * solution.jacobian):
        wider = replace(solution, jacobian=np.hstack([solution.jacobian, column]))
        assert residual_scatter(wider) == pytest.approx(plain, rel=1e-9)
