"""Weights that make luminance of the luminances by the colours of a Bayer sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROUNDS = 30
#: Colourfulness below which colour is no reason for scatter.
_COLOURED = 0.05


@dataclass(frozen=True, eq=False)
class ColourData:
    """Patches as the colours see them, each relative to the meter's reading.

    Parameters
    ----------
    relative : ndarray of float, shape (n patches, k colours)
        Luminance by the colour alone, over the reading.
    own_rel : ndarray of float, shape (n, k)
        Relative standard uncertainty of these that differs from colour to colour: noise, pixels, darkness.
    shared_rel : ndarray of float, shape (n,)
        Relative standard uncertainty of patch and reading, the same for all colours: meter, unevenness, scatter.
    """

    relative: Array
    own_rel: Array
    shared_rel: Array

    @property
    def colourfulness(self) -> Array:
        """Standard deviation of the colours' luminances over their mean, shape (n,); 0 in the calibration's light."""
        return colourfulness(self.relative)

    def without(self, patch: int) -> ColourData:
        """Return all patches but one."""
        rest = np.arange(len(self.relative)) != patch
        return ColourData(self.relative[rest], self.own_rel[rest], self.shared_rel[rest])

    def variance(self, weights: Array, spectral: float) -> Array:
        """Variance of the combination over the reading, shape (n,)."""
        own = (self.relative * self.own_rel) ** 2 @ weights**2
        variance: Array = own + self.shared_rel**2 + (spectral * self.colourfulness) ** 2
        return variance


@dataclass(frozen=True, eq=False)
class Prior:
    """Weights to take where the patches leave a choice.

    Parameters
    ----------
    weights : ndarray of float, shape (k,)
        They sum to 1.
    width : float
        Standard deviation of the differences between the right weights and these.
    """

    weights: Array
    width: float

    @property
    def root(self) -> Array:
        """Square root of the prior's information, shape (k, k); it says nothing of the sum of the weights."""
        k = self.weights.size
        return (np.eye(k) - np.ones((k, k)) / k) / self.width


@dataclass(frozen=True, eq=False)
class Combination:
    """Weights, and how well they are known.

    Parameters
    ----------
    weights : ndarray of float, shape (k,)
        Of the colours' luminances; about 1 in sum.
    covariance : ndarray of float, shape (k, k)
        Of the weights.
    spectral : float
        Relative standard deviation, per unit of colourfulness, of what no weights can make fit: the colours are no
        combination of V(lambda).
    deviation, uncertainty : ndarray of float, shape (n,)
        Of the combination over the reading, less one, and its standard uncertainty.
    """

    weights: Array
    covariance: Array
    spectral: float
    deviation: Array
    uncertainty: Array

    @property
    def chi_squared(self) -> float:
        """Sum of the squared standardised deviations."""
        return float(np.sum((self.deviation / self.uncertainty) ** 2))

    @property
    def undetermined(self) -> float:
        """Largest standard uncertainty of a change of the weights that leaves their sum."""
        k = self.weights.size
        projection = np.eye(k) - np.ones((k, k)) / k
        return float(np.sqrt(max(np.linalg.eigvalsh(projection @ self.covariance @ projection)[-1], 0.0)))


def colourfulness(luminances: Array) -> Array:
    """Return standard deviation over mean of the colours' luminances along the last axis."""
    result: Array = np.std(luminances, axis=-1) / np.maximum(np.abs(np.mean(luminances, axis=-1)), 1e-30)
    return result


def combine(data: ColourData, prior: Prior) -> Combination:
    """Fit the weights, with what colour alone makes the patches scatter.

    The scatter is the smallest with which chi^2 of the coloured patches is at most their degrees of freedom (R. C.
    Paule and J. Mandel, J. Res. Natl. Bur. Stand. 87 (1982) 377). Grey ones, which no colour makes scatter, determine
    the sum of the weights.
    """
    coloured = data.colourfulness >= _COLOURED
    of_colour = _parameters(data, prior) - int(not coloured.all())
    freedom = max(int(coloured.sum()) - of_colour, 1)

    def chi_squared(found: Combination) -> float:
        return float(np.sum((found.deviation / found.uncertainty)[coloured] ** 2))

    found = _solve(data, prior, 0.0)
    if chi_squared(found) <= freedom:
        return found
    low, high = 0.0, 1.0
    for _ in range(_ROUNDS):
        middle = (low + high) / 2
        found = _solve(data, prior, middle)
        low, high = (middle, high) if chi_squared(found) > freedom else (low, middle)
    return found


def leave_one_out(data: ColourData, prior: Prior, spectral: float) -> Array:
    """Deviation of each patch from weights that were fitted without it, shape (n,)."""
    return np.array(
        [data.relative[i] @ _solve(data.without(i), prior, spectral).weights - 1 for i in range(len(data.relative))]
    )


def single(data: ColourData, colour: int) -> Combination:
    """One colour alone, scaled to the readings."""
    only = ColourData(data.relative[:, [colour]], data.own_rel[:, [colour]], data.shared_rel)
    found = _solve(only, Prior(np.ones(1), 1.0), 0.0)
    weights, covariance = np.zeros(data.relative.shape[1]), np.zeros((data.relative.shape[1],) * 2)
    weights[colour], covariance[colour, colour] = found.weights[0], found.covariance[0, 0]
    return Combination(weights, covariance, 0.0, found.deviation, found.uncertainty)


def single_leave_one_out(data: ColourData, colour: int) -> Array:
    """Deviation of each patch from a scale of one colour that was fitted without it, shape (n,)."""
    scales = [single(data.without(i), colour).weights[colour] for i in range(len(data.relative))]
    deviation: Array = data.relative[:, colour] * np.array(scales) - 1
    return deviation


def _solve(data: ColourData, prior: Prior, spectral: float) -> Combination:
    """Minimise chi^2 with the variances of the combination itself: errors in both, and the prior."""
    from scipy.optimize import least_squares

    root = prior.root

    def residuals(weights: Array) -> Array:
        deviation = data.relative @ weights - 1
        standardised = deviation / np.sqrt(data.variance(weights, spectral))
        return np.concatenate([standardised, root @ (weights - prior.weights)])

    found = least_squares(residuals, prior.weights, method="lm", xtol=1e-12, ftol=1e-12)
    weights: Array = found.x
    uncertainty = np.sqrt(data.variance(weights, spectral))
    design = np.vstack([data.relative / uncertainty[:, None], root])
    covariance = np.linalg.pinv(design.T @ design)
    return Combination(weights, covariance, spectral, data.relative @ weights - 1, uncertainty)


def _parameters(data: ColourData, prior: Prior) -> float:
    """Weights the patches determine: the trace of the data's part in the fit."""
    uncertainty = np.sqrt(data.variance(prior.weights, 0.0))
    information = (data.relative / uncertainty[:, None]).T @ (data.relative / uncertainty[:, None])
    return float(np.trace(np.linalg.pinv(information + prior.root.T @ prior.root) @ information))
