"""Deviation of the response from a straight line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .result import Quantity
from .series import SeriesPoint

#: Share of saturation between which linearity is judged (EMVA 1288 Release 4.0 Linear).
LINEARITY_SHARES = (0.05, 0.95)


@dataclass(frozen=True, eq=False)
class Linearity:
    """Deviations from a line.

    Parameters
    ----------
    intercept_dn, slope_dn : float
        The line: intercept, and slope over photons or seconds.
    stimulus, net_dn : ndarray of float, shape (n,)
        The points judged: photons or seconds, and signal above dark signal.
    deviation_rel : ndarray of float, shape (n,)
        Signal over line, minus 1.
    uncertainty_rel : ndarray of float, shape (n,)
        Standard uncertainty of the deviations by noise, black level and lamp.
    """

    intercept_dn: float
    slope_dn: float
    stimulus: NDArray[np.float64]
    net_dn: NDArray[np.float64]
    deviation_rel: NDArray[np.float64]
    uncertainty_rel: NDArray[np.float64]

    def errors(self) -> tuple[Quantity, Quantity, Quantity]:
        """Lowest and highest deviation (LE_min and LE_max of Release 3.1), and LE, the mean of the absolute ones."""
        uncertainty = float(np.sqrt(np.sum(self.uncertainty_rel**2)) / self.uncertainty_rel.size)
        mean = Quantity(float(np.abs(self.deviation_rel).mean()), uncertainty, "1", "mean of the absolute deviations")
        return self._at(int(np.argmin(self.deviation_rel))), self._at(int(np.argmax(self.deviation_rel))), mean

    def _at(self, index: int) -> Quantity:
        return Quantity(
            float(self.deviation_rel[index]),
            float(self.uncertainty_rel[index]),
            "1",
            f"at {self.net_dn[index]:.4g} DN above the dark signal; u by noise, black level and lamp",
        )


def in_range(points: Sequence[SeriesPoint], saturation_net_dn: float) -> list[SeriesPoint]:
    """Points from 5 to 95 % of saturation."""
    low, high = (share * saturation_net_dn for share in LINEARITY_SHARES)
    return [point for point in points if low <= point.net_dn <= high]


def linearity(points: Sequence[SeriesPoint], saturation_net_dn: float) -> Linearity | None:
    """Judge the linearity of a series (EMVA 1288 Release 4.0 Linear).

    The line y = a + b x over the photons, or over the exposure where they are not known, minimises the relative
    deviations, sum(((y - a - b x) / y)^2), from 5 to 95 % of saturation. The deviations are (y - line) / line.

    Parameters
    ----------
    points : sequence of SeriesPoint
        In rising order.
    saturation_net_dn : float
        Signal above dark signal at saturation.

    Returns
    -------
    Linearity or None
        None with fewer than three points.
    """
    chosen = in_range(points, saturation_net_dn)
    if len(chosen) < 3:
        return None
    x = np.array([point.stimulus for point in chosen])
    if np.unique(x).size < 2:
        return None
    y = np.array([point.net_dn for point in chosen])
    scale = x.max()
    design = np.column_stack([1 / y, x / scale / y])
    intercept, slope = np.linalg.lstsq(design, np.ones_like(y))[0]
    fitted = intercept + slope * x / scale
    noise = np.array([point.net_uncertainty_dn for point in chosen]) / y
    # The fit follows each point by its leverage h: the noise of the deviation is reduced accordingly.
    projection = design @ np.linalg.pinv(design)
    left = np.eye(y.size) - projection
    uncertainty = np.sqrt((left**2) @ noise**2)
    return Linearity(float(intercept), float(slope / scale), x, y, y / fitted - 1, uncertainty)
