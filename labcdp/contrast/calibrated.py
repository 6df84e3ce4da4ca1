"""CDP between two regions with what the calibration's errors, shared by their pixels, add to its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, isnan, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .detection import cdp
from .distribution import numeric_array
from .interval import ContrastDefinition, Epsilon
from .result import CdpResult
from .uncertainty import confidence_interval

#: Relative errors of the pixels of two regions for one standard uncertainty of what they share.
RegionErrors = tuple[ArrayLike, ArrayLike]


@dataclass(frozen=True)
class CalibratedCdp:
    """CDP of calibrated luminances.

    Parameters
    ----------
    result : CdpResult
        CDP, and what the finite number of pixels leaves uncertain.
    calibration_standard_uncertainty : float
        Standard uncertainty of the CDP by the calibration.
    confidence_interval : (float, float)
        95 % interval by both; (nan, nan) where the pixels do not suffice for a standard error.
    """

    result: CdpResult
    calibration_standard_uncertainty: float
    confidence_interval: tuple[float, float]

    @property
    def standard_uncertainty(self) -> float:
        """Combined standard uncertainty, by pixels and calibration."""
        return hypot(self.result.standard_error, self.calibration_standard_uncertainty)


def cdp_with_common_errors(
    a: ArrayLike,
    b: ArrayLike,
    contrast: float,
    epsilon: Epsilon = 0.5,
    errors: Sequence[RegionErrors] = (),
    *,
    definition: ContrastDefinition = "weber",
) -> CalibratedCdp:
    """Contrast detection probability between two regions of calibrated luminances, with the calibration's part.

    Parameters
    ----------
    a, b : array_like of float of any shape
        Luminances of the two regions.
    contrast, epsilon, definition
        As for `labcdp.contrast.cdp`.
    errors : sequence of (array_like, array_like)
        Independent errors. Each is given by the signed relative error it makes in `a` and in `b` for one standard
        uncertainty: numbers, or arrays of the regions' shapes.

    Returns
    -------
    CalibratedCdp

    Raises
    ------
    InputError
        As `labcdp.contrast.cdp`, and if an error is not finite, or not a number nor of its region's shape.

    Notes
    -----
    The contrast of a pair is a ratio, so an error that both regions share alike cancels, and of the others
    the difference counts. Each error is added and subtracted once, and the mean square of the two changes of the CDP
    is its variance: for small errors the law of propagation (JCGM 100:2008, 5.1.2), and not zero where the CDP has its
    maximum. Numbers are joined to one error by their root sum of squares, since their effect on a ratio is alike.
    """
    first, second = numeric_array(a, "a").astype(float), numeric_array(b, "b").astype(float)
    base = cdp(first, second, contrast, epsilon, definition=definition)
    variance = 0.0
    for in_a, in_b in _joined([(_checked(x, first, "a"), _checked(y, second, "b")) for x, y in errors]):
        changes = [
            cdp(first * (1 + s * in_a), second * (1 + s * in_b), contrast, epsilon, definition=definition).cdp
            - base.cdp
            for s in (1, -1)
        ]
        variance += float(np.mean(np.square(changes)))
    interval = (nan, nan)
    if not isnan(base.standard_error):
        interval = confidence_interval(base.cdp, base.standard_error**2 + variance, min(first.size, second.size))
    return CalibratedCdp(base, sqrt(variance), interval)


def _checked(error: ArrayLike, region: NDArray[Any], name: str) -> NDArray[np.float64]:
    values = np.asarray(error, dtype=float)
    if values.shape not in ((), region.shape) or not np.isfinite(values).all():
        raise InputError(
            f"an error of {name} has the shape {values.shape}, or is not finite: give a finite number, or one for each "
            f"pixel, of shape {region.shape}"
        )
    return values


def _joined(
    errors: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Errors of each pixel as they are, and those of whole regions as one of `a` alone; none that cancels."""
    numbers = [float((1 + x) / (1 + y) - 1) for x, y in errors if x.ndim == y.ndim == 0]
    arrays = [(x, y) for x, y in errors if x.ndim or y.ndim]
    together = hypot(*numbers) if numbers else 0.0
    return arrays + ([(np.array(together), np.array(0.0))] if together > 0 else [])
