"""A variable of a map along one axis, with its noise."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .axes import MapAxis, known_values

if TYPE_CHECKING:
    from xarray import Dataset

#: Share of saturated pixels from which the bright region counts as saturated.
_SATURATED_SHARE = 0.01

#: Points of a curve from which on its roughness is known so well, and moved so little by dips, that it is trusted more
#: than a smaller standard error, which takes all pixels of a region as independent; and from which on there is any.
_MANY_POINTS, _FEW_POINTS = 20, 5

#: Twice the standard deviation of a roughness, relative, times the root of the number of points: 1.17 for a median
#: absolute deviation (37 % of the efficiency of a standard deviation), 1.39 for second differences, which share points.
_ROUGHNESS_MARGIN = 2 * 1.17 * 1.39

#: Median absolute deviation of a normal distribution, in standard deviations.
_MAD_OF_NORMAL = 0.6744897501960817


@dataclass(frozen=True, eq=False)
class SectionCurve:
    """Usable points of a section of a map along an axis.

    Parameters
    ----------
    axis : MapAxis
        The axis.
    places, values, cdp : ndarray of float, shape (n,)
        Places on the axis, in rising order; a variable there, and CDP.
    noise : ndarray of float, shape (n,)
        Largest change of each value by noise; that of a difference is the root of the sum of the squares.
    """

    axis: MapAxis
    places: NDArray[np.float64]
    values: NDArray[np.float64]
    noise: NDArray[np.float64]
    cdp: NDArray[np.float64]

    @classmethod
    def of(cls, section: Dataset, axis: MapAxis, variable: str, margin: float) -> SectionCurve:
        """Take the points of a section at which a variable is known and the bright region is not saturated for good.

        Parameters
        ----------
        section : xarray.Dataset
            Part of a map over one axis.
        axis : MapAxis
            That axis.
        variable : str
            Name of the variable.
        margin : float
            Standard errors that noise may add or take.
        """
        values = known_values(variable, section[variable].values)
        counts = np.isfinite(values) & (values >= 0)
        if "saturated_share" in section:
            unsaturated = np.flatnonzero(~(section["saturated_share"].values > _SATURATED_SHARE))
            counts[unsaturated[-1] + 1 if unsaturated.size else 0 :] = False
        noise = margin * _standard_errors(section, variable, values, counts)
        return cls(axis, axis.values[counts], values[counts], noise, section["cdp"].values[counts])

    def lies_below(self, low: int, high: int, min_fall: float) -> bool:
        """Whether one point lies below another by more than a threshold and by more than noise explains."""
        noise = float(np.hypot(self.noise[low], self.noise[high]))
        return bool(
            self.values[low] < (1 - min_fall) * self.values[high] and self.values[low] < self.values[high] - noise
        )


def _standard_errors(
    section: Dataset, variable: str, values: NDArray[np.float64], counts: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Find standard errors of the points that count: the map's, or by the roughness if that is more; 0 if exact."""
    name = "standard_error" if variable == "cdp" else f"{variable}_standard_error"
    errors = np.zeros(counts.sum())
    stated = False
    if name in section:
        errors = section[name].values[counts].astype(np.float64)
        stated = bool(np.isfinite(errors).any())
        # Unknown values of a few points are assumed as bad as the worst.
        errors = np.where(np.isfinite(errors), errors, errors[np.isfinite(errors)].max() if stated else 0.0)
    if section.attrs.get("method") != "simulated":
        return errors
    if not stated:
        return _roughness(values[counts]) * (1 + _ROUGHNESS_MARGIN / sqrt(max(errors.size, 1)))
    return np.maximum(errors, _roughness(values[counts])) if errors.size >= _MANY_POINTS else errors


def _roughness(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Estimate standard errors of values around a smooth curve, by second differences, which few jumps do not move.

    The variance of mean over standard deviation of n normal values is (1 + SNR^2 / 2) / n (to first order in 1 / n);
    n is what the second differences of the logarithms, of 1, 4 and 1 times the variances of their points, tell.
    """
    unit = np.sqrt(1 + values**2 / 2)
    above = values > 0
    if above.sum() < _FEW_POINTS:
        return np.zeros_like(values)
    relative = (unit[above] / values[above]) ** 2
    bends = np.diff(np.log(values[above]), n=2) / np.sqrt(relative[:-2] + 4 * relative[1:-1] + relative[2:])
    return float(np.median(np.abs(bends - np.median(bends)))) / _MAD_OF_NORMAL * unit
