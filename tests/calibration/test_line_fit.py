import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares, minimize_scalar

from labcdp.calibration.line_fit import fit_line
from labcdp.errors import CalibrationError

# Pearson's points with York's weights, the standard test of such fits: D. York, Can. J. Phys. 44 (1966) 1079; the
# solution to these digits in D. York et al., Am. J. Phys. 72 (2004) 367.
PEARSON_X = np.array([0.0, 0.9, 1.8, 2.6, 3.3, 4.4, 5.2, 6.1, 6.5, 7.4])
PEARSON_Y = np.array([5.9, 5.4, 4.4, 4.6, 3.5, 3.7, 2.8, 2.8, 2.4, 1.5])
YORK_X_WEIGHT = np.array([1000, 1000, 500, 800, 200, 80, 60, 20, 1.8, 1.0])
YORK_Y_WEIGHT = np.array([1.0, 1.8, 4.0, 8.0, 20, 20, 70, 70, 100, 500])


def points(seed, n=8):
    rng = np.random.default_rng(seed)
    truth = np.geomspace(1, 100, n)
    x_std, y_std = 0.05 * truth, 0.03 * truth + 0.2
    return truth + rng.normal(0, x_std), 3 * truth + rng.normal(0, y_std), x_std**2, np.diag(y_std**2)


def test_york_and_pearson():
    line = fit_line(PEARSON_X, PEARSON_Y, 1 / YORK_X_WEIGHT, np.diag(1 / YORK_Y_WEIGHT), free_intercept=True)
    assert line.slope == pytest.approx(-0.480533407, abs=5e-10)
    assert line.intercept == pytest.approx(5.47991022, abs=5e-9)
    assert np.sqrt(line.slope_variance) == pytest.approx(0.0579850090, abs=5e-9)
    assert np.sqrt(line.intercept_variance) == pytest.approx(0.294970735, abs=5e-8)
    assert line.chi_squared / line.degrees_of_freedom == pytest.approx(1.4833, abs=5e-5)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("free_intercept", [False, True])
def test_it_is_the_least_distance_over_all_true_points(seed, free_intercept):
    x, y, x_variance, y_covariance = points(seed)
    y_variance = np.diag(y_covariance)

    def distances(p):
        intercept = p[1] if free_intercept else 0.0
        truth = p[2:]
        return np.concatenate([(x - truth) / np.sqrt(x_variance), (y - p[0] * truth - intercept) / np.sqrt(y_variance)])

    best = least_squares(distances, [2.5, 0.0, *x], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    line = fit_line(x, y, x_variance, y_covariance, free_intercept=free_intercept)
    assert line.slope == pytest.approx(best.x[0], rel=1e-6)
    assert line.chi_squared == pytest.approx(2 * best.cost, rel=1e-6)
    if free_intercept:
        assert line.intercept == pytest.approx(best.x[1], abs=1e-5)


def test_correlated_errors_minimise_the_effective_chi_squared():
    x, y, x_variance, y_covariance = points(11)
    shared = np.linspace(0.5, 2.0, x.size)
    y_covariance = y_covariance + np.outer(shared, shared)

    def chi_squared(slope):
        residual = y - slope * x
        return residual @ np.linalg.solve(y_covariance + slope**2 * np.diag(x_variance), residual)

    best = minimize_scalar(chi_squared, bracket=(2.0, 3.0, 4.0), tol=1e-12)
    line = fit_line(x, y, x_variance, y_covariance, free_intercept=False)
    assert line.slope == pytest.approx(best.x, rel=1e-6)
    assert line.chi_squared == pytest.approx(best.fun, rel=1e-9)


def test_without_errors_in_x_it_is_weighted_least_squares():
    x, y, _, y_covariance = points(12)
    weight = 1 / np.diag(y_covariance)
    line = fit_line(x, y, np.zeros_like(x), y_covariance, free_intercept=False)
    assert line.slope == pytest.approx(np.sum(weight * x * y) / np.sum(weight * x * x))
    assert line.slope_variance == pytest.approx(1 / np.sum(weight * x * x))
    assert line.degrees_of_freedom == x.size - 1


def test_slope_scatters_as_stated_and_has_no_bias():
    n = 2000
    lines = [fit_line(*points(seed), free_intercept=False) for seed in range(n)]
    slopes = np.array([line.slope for line in lines])
    stated = np.sqrt(np.mean([line.slope_variance for line in lines]))
    assert slopes.mean() == pytest.approx(3.0, abs=4 * stated / np.sqrt(n) + 3 * (stated / 3) ** 2)
    assert slopes.std() == pytest.approx(stated, rel=4 / np.sqrt(2 * n))
    chi_squared = np.mean([line.chi_squared for line in lines])
    assert chi_squared == pytest.approx(7, abs=4 * np.sqrt(2 * 7 / n))


@given(seed=st.integers(0, 10_000), x_unit=st.floats(1e-3, 1e3), y_unit=st.floats(1e-3, 1e3))
def test_units_do_not_matter(seed, x_unit, y_unit):
    x, y, x_variance, y_covariance = points(seed)
    line = fit_line(x, y, x_variance, y_covariance, free_intercept=True)
    other = fit_line(x * x_unit, y * y_unit, x_variance * x_unit**2, y_covariance * y_unit**2, free_intercept=True)
    assert other.slope * x_unit / y_unit == pytest.approx(line.slope, rel=1e-6)
    assert other.intercept / y_unit == pytest.approx(line.intercept, rel=1e-5, abs=1e-6)
    assert other.chi_squared == pytest.approx(line.chi_squared, rel=1e-6)


def test_points_that_are_no_line_do_not_run_for_ever():
    x, y = np.array([0.88, 0.09, 0.71, 0.79, 0.8]), np.array([0.32, 0.8, 0.23, 0.36, 0.42])
    x_variance = np.array([0.146, 0.003, 0.042, 0.001, 0.95])
    y_covariance = np.diag([2.556, 0.004, 0.653, 1.925, 8.459])
    with pytest.raises(CalibrationError, match="the fit did not settle in 200 rounds: check that readings and frames"):
        fit_line(x, y, x_variance, y_covariance, free_intercept=False)
