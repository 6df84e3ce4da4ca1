"""Contrast detection probability (CDP) between two regions, exact over all pairs of pixels, and its common errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import hypot, nan
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .contrast import TargetContrast
from .distribution import Distribution
from .pairs import PairTally, tally_pairs
from .result import Cdp, cdp_of_shares
from .uncertainty import unbiased_variance

#: An error of the calibration beyond the light itself leaves at least this part of it.
LEAST_FACTOR = 1e-3
#: Values with and without an error.
_Values: TypeAlias = NDArray[np.float64] | float
#: Signed relative errors in two regions for one standard uncertainty, of shape () or that of the pixels.
PairError = tuple[NDArray[np.float64], NDArray[np.float64]]


def count_cdp(
    bright: Distribution,
    dark: Distribution,
    targets: Sequence[TargetContrast],
    *,
    swapped: bool = False,
    inflation_of: Callable[[PairTally], float] = lambda _: 1.0,
) -> Cdp[NDArray[np.float64]]:
    """Count the pairs of two regions for each target contrast.

    Parameters
    ----------
    bright, dark : Distribution
        The regions, the one with the larger mean first.
    targets : sequence of TargetContrast
        Contrasts to be detected.
    swapped : bool
        Whether the brighter region was given as the dark one.
    inflation_of : callable
        Factor on the variance of independent pixels by correlated noise, from the tally of a contrast.
    """
    tallies = [tally_pairs(bright, dark, target.ratios) for target in targets]
    inflations = np.array([inflation_of(tally) for tally in tallies])
    counted = bright.size is not None and dark.size is not None
    variances = [
        unbiased_variance(tally.inside, tally.inside_per_dark, dark.weights, tally.inside_per_bright, bright.weights)
        if counted
        else nan
        for tally in tallies
    ]
    undefined = bright.not_positive * dark.not_positive
    return cdp_of_shares(
        targets,
        [(tally.below, tally.inside, tally.above, undefined) for tally in tallies],
        inflations * variances,
        pairs=bright.size * dark.size if bright.size is not None and dark.size is not None else None,
        inflations=inflations,
        n_bright=bright.size if counted else None,
        n_dark=dark.size if counted else None,
        swapped=swapped,
    )


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
