"""Points for quasi-Monte Carlo, and quantiles of Poisson distributions at them."""

from __future__ import annotations

from functools import lru_cache
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Logarithm to base 2 of the points. A CDP is then within 2e-4 of the exact one as a rule.
POWER = 15
#: Mean from which the quantile is taken from its expansion, which then errs in 1 of 10^4 points, by 1.
_LARGE = 40.0
#: Groups of equal means, of points whose means vary, and nodes that a quantile function is interpolated between.
_GROUPS, _NODES = 32, 2049


@lru_cache(maxsize=16)
def uniform_points(dimensions: int) -> FloatArray:
    """Sobol points, moved by a random digital shift, shape (dimensions, 2^15), each row of equal steps inside 0 to 1.

    Parameters
    ----------
    dimensions : int
        Number of random quantities.
    """
    from scipy.stats.qmc import Sobol

    points = Sobol(dimensions, scramble=False, bits=POWER).random_base2(POWER)
    shifts = np.random.default_rng(1).integers(2**POWER, size=dimensions)
    ranks = (points * 2**POWER).astype(np.intp) ^ shifts
    uniform: FloatArray = np.ascontiguousarray((ranks[ranks[:, 0].argsort()].T + 0.5) / 2**POWER)
    uniform.setflags(write=False)
    return uniform


@lru_cache(maxsize=16)
def normal_points(dimensions: int) -> FloatArray:
    """Return the quantiles of a standard normal distribution at `uniform_points`."""
    from scipy.special import ndtri

    normal: FloatArray = ndtri(uniform_points(dimensions))
    normal.setflags(write=False)
    return normal


@lru_cache(maxsize=16)
def gamma_quantile(order: float, dimensions: int, dimension: int) -> FloatArray:
    """Values of a gamma distribution of mean 1 and standard deviation order^(-1/2) at the points of one dimension.

    Parameters
    ----------
    order : float
        Shape parameter, above 0.
    dimensions, dimension : int
        Number of random quantities, and that of this one.
    """
    from scipy.special import gammaincinv, ndtr

    normal = normal_points(dimensions)[dimension]
    nodes = np.linspace(normal.min(), normal.max(), _NODES)
    logs = np.log(np.maximum(gammaincinv(order, ndtr(nodes)) / order, 1e-300))
    values: FloatArray = np.exp(np.interp(normal, nodes, logs))
    values.setflags(write=False)
    return values


def poisson_quantile(mean: FloatArray | float, dimensions: int, dimension: int) -> FloatArray:
    """Poisson counts at the points of one dimension.

    Parameters
    ----------
    mean : float or ndarray, shape (2^15,)
        Mean, of each point if it varies.
    dimensions, dimension : int
        Number of random quantities, and that of this one.

    Notes
    -----
    Of large means by M. B. Giles, Algorithm 955: approximation of the inverse Poisson cumulative distribution function,
    ACM Trans. Math. Softw. 42 (2016) 7, eq. 8. Means that vary are small enough there to be taken in groups.
    """
    means = np.asarray(mean, dtype=np.float64)
    normal, uniform = normal_points(dimensions)[dimension], uniform_points(dimensions)[dimension]
    if means.min() >= _LARGE:
        return _expanded(means, normal)
    if means.ndim == 0 or np.ptp(means) == 0:
        return _tabulated(float(means.flat[0]), uniform)
    counts = np.empty(means.size)
    for group in np.array_split(means.argsort(), _GROUPS):
        counts[group] = _tabulated(float(means[group].mean()), uniform[group])
    return counts


def _expanded(mean: FloatArray, normal: FloatArray) -> FloatArray:
    root = np.sqrt(mean)
    square = normal**2
    count = mean + root * normal + (2 + square) / 6
    count -= normal * (2 + square) / 72 / root
    count += (-8 / 405 + square * (7 / 810 + square / 270)) / mean
    return np.floor(count)


def _tabulated(mean: float, uniform: FloatArray) -> FloatArray:
    from scipy.special import pdtr

    reach = 7 * sqrt(mean) + 15
    counts = np.arange(max(int(mean - reach), 0), ceil(mean + reach) + 1, dtype=np.float64)
    below = pdtr(counts, mean)
    return counts[np.minimum(np.searchsorted(below, uniform), counts.size - 1)]
