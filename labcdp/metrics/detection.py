"""Contrast detection probability (CDP) between two regions, exact over all pairs of pixels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import hypot, isnan, nan, sqrt
from typing import Any, Generic, Literal, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from .arrays import numeric_array
from .contrast import ContrastDefinition, Epsilon, TargetContrast
from .distribution import Distribution, Region
from .pairs import PairTally, bright_and_dark, tally_pairs
from .result import CdpResult, DetectionResult
from .uncertainty import confidence_interval, unbiased_variance

#: An error of the calibration beyond the light itself leaves at least this part of it.
LEAST_FACTOR = 1e-3


def cdp_range(
    a: Region,
    b: Region,
    contrasts: Iterable[float],
    epsilon: Epsilon = 0.5,
    *,
    definition: ContrastDefinition = "weber",
) -> tuple[CdpResult, ...]:
    """Contrast detection probability between two regions at several contrasts, as one record each.

    For further processing of the records; `cdp` returns arrays. The pixels count as independent, whatever their shape.

    Parameters
    ----------
    a, b, epsilon, definition
        As for `cdp`; ``a`` and ``b`` are the regions in any order.
    contrasts : iterable of float
        Contrasts, each as for `cdp`; for equal steps see `contrast_range`.

    Returns
    -------
    tuple of CdpResult
        One for each contrast.

    Raises
    ------
    InputError
        As `cdp`.
    """
    asked = [TargetContrast(contrast, epsilon, definition) for contrast in contrasts]
    return results_of(*bright_and_dark(a, b), asked)


def results_of(
    bright: Distribution, dark: Distribution, bright_name: Literal["a", "b"], asked: Iterable[TargetContrast]
) -> tuple[CdpResult, ...]:
    """Count the pairs of independent pixels for each contrast."""
    return tuple(
        result_of_tally(tally_pairs(bright, dark, one.ratios), bright, dark, bright_name, one) for one in asked
    )


def result_of_tally(
    tally: PairTally,
    bright: Distribution,
    dark: Distribution,
    bright_name: Literal["a", "b"],
    asked: TargetContrast,
    variance_inflation: float = 1.0,
) -> CdpResult:
    """Make the result of a tally; its variance is that of independent pixels times `variance_inflation`."""
    standard_error, interval = nan, (nan, nan)
    if bright.size is not None and dark.size is not None:
        variance = variance_inflation * unbiased_variance(
            tally.inside, tally.inside_per_dark, dark.weights, tally.inside_per_bright, bright.weights
        )
        standard_error = sqrt(variance)
        # Effective number of independent pixels.
        smaller_size = min(bright.size, dark.size) / variance_inflation
        interval = confidence_interval(tally.inside, variance, smaller_size)
    return CdpResult(
        cdp=tally.inside,
        standard_error=standard_error,
        confidence_interval=interval,
        contrast=asked.contrast,
        epsilon=asked.epsilon,
        definition=asked.definition,
        interval=asked.interval,
        below=tally.below,
        above=tally.above,
        undefined=bright.not_positive * dark.not_positive,
        bright=bright_name,
        bright_size=bright.size,
        dark_size=dark.size,
        correlation_inflation=sqrt(variance_inflation),
    )


_Result = TypeVar("_Result", bound=DetectionResult)
#: Relative errors of the pixels of two regions for one standard uncertainty of a common error.
RegionErrors = tuple[ArrayLike, ArrayLike]
#: Values with and without an error.
_Values: TypeAlias = NDArray[np.float64] | float
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
    checked = [(_checked(x, first, "a"), _checked(y, second, "b")) for x, y in errors]

    def with_errors(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
        regions = with_error(first, x), with_error(second, y)
        return cdp_range(*regions, (contrast,), epsilon, definition=definition)[0].cdp

    changed = [[with_errors(sign * x, sign * y) for sign in (1, -1)] for x, y in joined_errors(checked)]
    variance = float(variance_of_changes(base.cdp, changed))
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
    numbers = [_factor(x) / _factor(y) - 1 for x, y in errors if x.ndim == y.ndim == 0]
    arrays = [(x, y) for x, y in errors if x.ndim or y.ndim]
    together = hypot(*numbers)
    return arrays + ([(np.array(together), np.zeros(()))] if together > 0 else [])


def with_error(values: NDArray[np.floating[Any]], relative: ArrayLike) -> NDArray[np.float64]:
    """Return values with a relative error, which leaves at least `LEAST_FACTOR` of them: no light is negative.

    Errors of single values, as of the dark signal, may make some of them negative, but not all.
    """
    error = np.asarray(relative, dtype=float)
    changed: NDArray[np.float64] = values * (_factor(error) if error.ndim == 0 else 1 + error)
    if changed.max(initial=0.0) <= 0 < values.max(initial=0.0):
        changed = values * np.float64(LEAST_FACTOR)
    return changed


def _factor(relative: NDArray[np.float64]) -> float:
    return max(1 + float(relative), LEAST_FACTOR)


def variance_of_changes(base: _Values, changed: Sequence[Sequence[_Values]]) -> NDArray[np.float64]:
    """Sum over the errors of the mean square of the two changes by each.

    Parameters
    ----------
    base : ndarray of float, shape (k,), or float
        Values without an error.
    changed : sequence of two ndarray of float, shape (k,), or two floats
        For each error, the values with it added and with it subtracted.

    Returns
    -------
    ndarray of float, shape (k,) or ()
        nan where a value is not finite.
    """
    variance = np.zeros(np.shape(base))
    with np.errstate(invalid="ignore"):
        for both in changed:
            variance = variance + np.square(np.asarray(both) - base).mean(axis=0)
    return variance
