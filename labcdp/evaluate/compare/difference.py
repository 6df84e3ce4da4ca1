"""The difference of two uncertain values, with errors that they have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.table import Z_95

#: Relative difference of values that are equal but for rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Uncertain:
    """A value, or an array of values, with its 95 % interval.

    Parameters
    ----------
    value : array_like of float
        The value.
    below, above : array_like of float
        Distance of the ends of the interval; nan if they are not known, 0 for an exact value.
    common : mapping of str to array_like of float
        Part of the uncertainty by each error that other values may have, too: its standard uncertainty over the whole,
        0 to 1, by what identifies the error, for example a meter and its state.
    sources : tuple of str
        In place of `common` what the uncertainty is by, if the parts are not known.
    """

    value: ArrayLike
    below: ArrayLike = 0.0
    above: ArrayLike = 0.0
    common: Mapping[str, ArrayLike] = field(default_factory=dict)
    sources: tuple[str, ...] = ()

    def correlation(self, other: Uncertain) -> NDArray[np.float64]:
        """Return the coefficient of correlation: sum of the products of the parts by errors that both have.

        If the parts are not known, it is 1 if all sources are the same, 0 if none is, and nan otherwise.
        """
        if n_same := len({*self.sources} & {*other.sources}):
            return np.array(1.0 if n_same == len({*self.sources, *other.sources}) else np.nan)
        shared = [np.multiply(part, other.common[name]) for name, part in self.common.items() if name in other.common]
        total: NDArray[np.float64] = np.clip(np.sum(np.broadcast_arrays(0.0, *shared), axis=0), 0.0, 1.0)
        return total


@dataclass(frozen=True, eq=False)
class Difference:
    """Second value minus first value.

    Parameters
    ----------
    value, low, high : ndarray of float
        The difference, and the ends of its 95 % interval.
    z : ndarray of float
        Difference over its standard uncertainty on the side of 0; infinite if exact values differ.
    """

    value: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    z: NDArray[np.float64]

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Whether 0 lies outside the 95 % interval."""
        return np.abs(self.z) > Z_95


def difference(first: Uncertain, second: Uncertain) -> Difference:
    """Return the difference of two values with its 95 % interval and z.

    The ends of the interval lie sqrt(a^2 + b^2 - 2 r a b) from the difference, where a and b are the distances of the
    ends of the two intervals that move it there, and r is the correlation. For symmetric intervals that is the law of
    propagation (JCGM 100:2008, 5.2.2); for intervals of probabilities it is method 10 of R. G. Newcombe, Statistics in
    Medicine 17, 873 (1998), with the correlation after G. Y. Zou, Psychological Methods 12, 399 (2007), which holds at
    a probability of 0 or 1, too.

    Parameters
    ----------
    first, second : Uncertain
        Values of shapes that broadcast together.
    """
    correlation = first.correlation(second)
    a, b = np.asarray(first.value, dtype=np.float64), np.asarray(second.value, dtype=np.float64)
    d = np.where(np.abs(b - a) <= _ROUNDING * np.maximum(np.abs(a), np.abs(b)), 0.0, b - a)
    down = _joined(second.below, first.above, correlation)
    up = _joined(second.above, first.below, correlation)
    towards_zero = np.where(d > 0, down, up)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(d == 0, 0.0, Z_95 * d / towards_zero)
    return Difference(d, d - down, d + up, z)


def _joined(a: ArrayLike, b: ArrayLike, correlation: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    # Rounding may leave less than 0 of two equal errors.
    variance: NDArray[np.float64] = np.maximum((a - b) ** 2 + 2 * (1 - correlation) * a * b, 0.0)
    return np.sqrt(variance)
