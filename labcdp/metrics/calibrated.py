"""CDP between two regions, with the uncertainty contribution of common calibration errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, isnan, nan, sqrt
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from .detection import cdp_range
from .distribution import numeric_array
from .interval import ContrastDefinition, Epsilon
from .result import CdpResult, DetectionResult
from .uncertainty import confidence_interval

_Result = TypeVar("_Result", bound=DetectionResult)
#: Relative errors of the pixels of two regions for one standard uncertainty of a common error.
RegionErrors = tuple[ArrayLike, ArrayLike]
#: Validated errors, of shape () or that of the pixels.
PairError = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True)
class CalibratedCdp(Generic[_Result]):
    """CDP of calibrated luminances.

    Parameters
    ----------
    result : CdpResult or NeighbourCdp
        CDP with its uncertainty by the finite number of pixels.
    calibration_standard_uncertainty : float
        Standard uncertainty of the CDP by the calibration.
    confidence_interval : (float, float)
        95 % interval by both; (nan, nan) where there are too few pixels for a standard error.
    """

    result: _Result
    calibration_standard_uncertainty: float
    confidence_interval: tuple[float, float]

    @classmethod
    def of(cls, result: _Result, variance: float, n_pixels: float) -> Self:
        """Add the variance by the calibration to a result of so many independent pixels."""
        interval = (nan, nan)
        if not isnan(result.standard_error):
            interval = confidence_interval(result.cdp, result.standard_error**2 + variance, n_pixels)
        return cls(result, sqrt(variance), interval)

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
) -> CalibratedCdp[CdpResult]:
    """Contrast detection probability between two regions of calibrated luminances, with calibration errors.

    Parameters
    ----------
    a, b : array_like of float of any shape
        Luminances of the two regions.
    contrast, epsilon, definition
        As for `labcdp.metrics.cdp`.
    errors : sequence of (array_like, array_like)
        Mutually independent errors, each common to both regions, as the signed relative errors in `a` and in `b` for
        one standard uncertainty: numbers, or arrays of the regions' shapes.

    Returns
    -------
    CalibratedCdp

    Raises
    ------
    InputError
        As `labcdp.metrics.cdp`, and if an error is not finite, or not a number nor of its region's shape.

    Notes
    -----
    The contrast of a pair is a ratio, so an equal relative error of both regions cancels, and only differences count.
    Each error is added and subtracted once, and the mean square of the two changes of the CDP is its variance: for
    small errors the law of propagation (JCGM 100:2008, 5.1.2), and non-zero also at a maximum of the CDP. Numbers are
    combined to one error by their root sum of squares, since they affect a ratio in the same way.
    """
    first, second = numeric_array(a, "a").astype(float), numeric_array(b, "b").astype(float)
    (base,) = cdp_range(first, second, (contrast,), epsilon, definition=definition)
    variance = 0.0
    for in_a, in_b in joined_errors([(_checked(x, first, "a"), _checked(y, second, "b")) for x, y in errors]):
        changes = [
            one.cdp - base.cdp
            for s in (1, -1)
            for one in cdp_range(
                first * (1 + s * in_a), second * (1 + s * in_b), (contrast,), epsilon, definition=definition
            )
        ]
        variance += float(np.mean(np.square(changes)))
    return CalibratedCdp.of(base, variance, min(first.size, second.size))


def _checked(error: ArrayLike, region: NDArray[Any], name: str) -> NDArray[np.float64]:
    values = np.asarray(error, dtype=float)
    if values.shape not in ((), region.shape) or not np.isfinite(values).all():
        raise InputError(
            f"an error of {name} has the shape {values.shape}, or is not finite: give a finite number, or one for each "
            f"pixel, of shape {region.shape}"
        )
    return values


def joined_errors(errors: Sequence[PairError]) -> list[PairError]:
    """Errors per pixel unchanged; those of whole regions combined to one of the first: only their ratio matters."""
    numbers = [float((1 + x) / (1 + y) - 1) for x, y in errors if x.ndim == y.ndim == 0]
    arrays = [(x, y) for x, y in errors if x.ndim or y.ndim]
    together = hypot(*numbers)
    return arrays + ([(np.array(together), np.zeros(()))] if together > 0 else [])
