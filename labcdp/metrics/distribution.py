"""Distribution: frequencies of the values in a region, from which all pair statistics follow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from math import nan
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from .arrays import check_exact, numeric_array

#: Longest histogram counted by index, whatever the size of the region (that of a 16-bit image).
_SHORT_HISTOGRAM = 2**16
#: Values that are looked at first, whether all are whole.
_LOOKED_AT = 64
#: Subscripts of `numpy.einsum` for a sum of weights times 0, 1 and 2 factors.
_SUBSCRIPTS = ("i->", "i,i->", "i,i,i->")
#: Number of steps that represent a normal distribution.
_NORMAL_STEPS = 2**15


@dataclass(frozen=True, eq=False)
class Distribution:
    """Distinct values of a region in rising order, each with its weight; the arrays are read-only.

    Parameters
    ----------
    values : array_like of numbers, shape (n,)
        Distinct, finite, increasing; in DN, cd/m^2 or any other unit. Stored as float64.
    weights : array_like of numbers, shape (n,)
        Integers are counts of pixels. Floats are probabilities (any total): such a distribution has no `size`, and
        results from it have no standard error. Values of weight 0 are dropped. Stored as float64, so that products of
        counts cannot overflow; sums over pairs are exact up to 2^53 pairs (two regions of 94 megapixels).

    Attributes
    ----------
    size : int or None
        Number of pixels, None if the weights are not counts.
    each_once : bool
        Whether the weights are counts and all of them 1.

    Raises
    ------
    InputError
        If the arrays do not fit together, a value is not finite or not above its predecessor, a weight is
        negative or not finite, or all weights are 0.

    Examples
    --------
    >>> from labcdp.metrics import Distribution
    >>> region = Distribution([10, 11, 13], [2, 5, 1])
    >>> region.size, region.mean
    (8, 11.0)
    """

    values: NDArray[Any]
    weights: NDArray[Any]
    size: int | None = field(init=False)
    each_once: bool = field(init=False)

    def __post_init__(self) -> None:
        values, weights = numeric_array(self.values, "values"), numeric_array(self.weights, "weights")
        counted = weights.dtype.kind in "iu"
        if values.ndim != 1 or values.shape != weights.shape or values.size == 0:
            raise InputError(
                f"values have shape {values.shape}, weights {weights.shape}: give two lists of equal length"
            )
        values = _read_only(values)
        rising = bool((values[1:] > values[:-1]).all())
        if not (rising and np.isfinite(values[[0, -1]]).all()):
            raise InputError("values are not finite or not rising: sort them and join equal ones")
        lightest, total = weights.min(), weights.sum(dtype=np.float64)
        if not (lightest >= 0 and np.isfinite(total) and total > 0):
            raise InputError("weights are not finite, negative or all 0: give how often each value occurs")
        if lightest == 0:
            values, weights = _read_only(values[weights > 0]), weights[weights > 0]
        each_once = bool(counted and total == values.size)
        # A single 1 broadcast to n: a region of distinct floats then needs no memory for its weights.
        weights = np.broadcast_to(np.float64(1), values.shape) if each_once else _read_only(weights)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "size", int(total) if counted else None)
        object.__setattr__(self, "each_once", each_once)

    @classmethod
    def from_array(cls, pixels: ArrayLike, name: str = "pixels") -> Distribution:
        """Count the values of an array.

        Parameters
        ----------
        pixels : array_like of int or float, any shape
            At least one pixel; at most 64 bit a value.
        name : str
            Name of the array in error messages.

        Raises
        ------
        InputError
            If the array is empty, masked, boolean, complex or not of numbers, or holds a value that is not
            finite or an integer beyond 2^53 (which float64 would round).

        Examples
        --------
        >>> from labcdp.metrics import Distribution
        >>> region = Distribution.from_array([[10, 11], [11, 13]])
        >>> region.values.tolist(), region.weights.tolist()
        ([10.0, 11.0, 13.0], [1.0, 2.0, 1.0])
        """
        flat = numeric_array(pixels, name).ravel()
        if flat.size == 0:
            raise InputError(f"{name} holds no pixel: give at least one")
        if flat.dtype.kind == "f":
            values, counts = _count_by_sorting(flat)
            # Sorting puts non-finite values at the ends.
            if not np.isfinite(values[[0, -1]]).all():
                raise InputError(
                    f"{name} holds {np.count_nonzero(~np.isfinite(flat))} values that are not finite: "
                    "leave such pixels out"
                )
            return cls(values, counts)
        # Short types need no look at the pixels.
        lowest, highest = np.iinfo(flat.dtype).min, np.iinfo(flat.dtype).max
        if lowest < 0 or highest >= _SHORT_HISTOGRAM:
            lowest, highest = check_exact(flat, name)
        if lowest >= 0 and highest < max(_SHORT_HISTOGRAM, flat.size):
            histogram = np.bincount(flat.astype(np.intp, copy=False))
            levels = np.flatnonzero(histogram)
            return cls(levels, histogram[levels])
        return cls(*_count_by_sorting(flat))

    @classmethod
    def normal(cls, mean: float, std: float) -> Distribution:
        """Make the normal distribution, as probabilities of 2^15 + 1 values up to 8 standard deviations from the mean.

        Parameters
        ----------
        mean, std : float
            Mean and standard deviation in the unit of the values; `std` above 0.

        Raises
        ------
        InputError
            If one is not finite or `std` is not above 0.

        Notes
        -----
        A CDP of two such distributions is that of the closed form to 1e-6, and to 1e-4 where an end of the interval
        maps one distribution to the other. The values are not equidistant, because pairs from two regular grids would
        lie on the ends of the interval too often.

        Examples
        --------
        >>> from labcdp.metrics import Distribution, cdp
        >>> round(cdp(Distribution.normal(120, 5), Distribution.normal(100, 5), 0.2).cdp, 4)
        0.7994
        """
        if not (np.isfinite(mean) and np.isfinite(std) and std > 0):
            raise InputError(f"mean {mean}, standard deviation {std}: give finite numbers, the latter above 0")
        steps = np.linspace(-np.arcsinh(8), np.arcsinh(8), _NORMAL_STEPS + 1)
        deviation = np.sinh(steps)
        return cls(mean + std * deviation, np.exp(-(deviation**2) / 2) * np.cosh(steps))

    @cached_property
    def cumulative(self) -> NDArray[np.float64]:
        """Weight of the first 0, 1, ... n values, shape (n + 1,)."""
        sums = np.zeros(self.weights.size + 1)
        np.cumsum(self.weights, out=sums[1:])
        sums.flags.writeable = False
        return sums

    @cached_property
    def total(self) -> float:
        """Sum of the weights."""
        return float(self.weights.sum())

    @cached_property
    def mean(self) -> float:
        """Weighted mean, in the unit of the values."""
        return weighted_sum(self.weights, self.values) / self.total

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Deviation of each value from the mean, shape (n,)."""
        return self.values - self.mean

    @cached_property
    def variance(self) -> float:
        """Variance, with n - 1 for n pixels; nan for one."""
        if self.values.size == 1 and self.size != 1:
            return 0.0
        dof = self.total if self.size is None else self.size - 1
        return weighted_sum(self.weights, self.deviations, self.deviations) / dof if dof else nan

    @property
    def not_positive(self) -> float:
        """Share of the values that are 0 or below."""
        return weight_not_positive(self) / self.total

    def map(self, conversion: Callable[[NDArray[np.float64]], ArrayLike]) -> Distribution:
        """Convert the distinct values, for example DN to cd/m^2, and merge those that become equal.

        Parameters
        ----------
        conversion : callable
            Takes the values, shape (n,), and returns as many finite numbers; it need not be monotone.

        Raises
        ------
        InputError
            If the conversion returns another shape or values that are not finite.

        Examples
        --------
        >>> from labcdp.metrics import Distribution
        >>> Distribution.from_array([64, 65, 67]).map(lambda dn: 0.5 * (dn - 64)).values.tolist()
        [0.0, 0.5, 1.5]
        """
        converted = numeric_array(conversion(self.values), "converted values")
        if converted.shape != self.values.shape:
            raise InputError(
                f"the conversion returned shape {converted.shape} for {self.values.shape}: "
                "it must convert each value by itself"
            )
        values, indices = np.unique(converted, return_inverse=True)
        weights = np.bincount(indices, weights=self.weights)
        return Distribution(values, weights if self.size is None else weights.astype(np.int64))


#: Region argument: its pixels, or their `Distribution`.
Region: TypeAlias = ArrayLike | Distribution


def as_distribution(region: Region, name: str) -> Distribution:
    """Return a distribution unchanged, or that of an array; raises InputError as `Distribution`."""
    return region if isinstance(region, Distribution) else Distribution.from_array(region, name)


def weight_not_positive(distribution: Distribution) -> float:
    """Weight of the values that are 0 or below."""
    return float(distribution.weights[: np.searchsorted(distribution.values, 0, side="right")].sum())


def weighted_sum(weights: NDArray[np.float64], *factors: NDArray[np.float64]) -> float:
    """Sum of the products of weights and factors, all of shape (n,); single-threaded, hence reproducible."""
    return float(np.einsum(_SUBSCRIPTS[len(factors)], weights, *factors))


def _count_by_sorting(flat: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Distinct values in rising order and their counts."""
    ordered = np.sort(_as_short(flat))
    ordered.flags.writeable = False
    is_new = np.ones(flat.size, dtype=np.bool_)
    np.not_equal(ordered[1:], ordered[:-1], out=is_new[1:])
    if is_new.all():
        return ordered, np.broadcast_to(np.int8(1), flat.shape)
    starts = np.flatnonzero(is_new)
    counts = np.empty(starts.size, dtype=np.intp)
    np.subtract(starts[1:], starts[:-1], out=counts[:-1])
    counts[-1] = flat.size - starts[-1]
    return ordered[starts], counts


def _as_short(flat: NDArray[Any]) -> NDArray[Any]:
    """Return whole numbers that fit into 32 bits as such, which NumPy sorts faster than 64; else `flat`."""
    if flat.dtype.itemsize <= 4 and flat.dtype.kind in "iu":
        return flat
    # Most values that are not whole show it at once.
    with np.errstate(invalid="ignore", over="ignore"):
        if not np.array_equal(flat[:_LOOKED_AT].astype(np.int32), flat[:_LOOKED_AT]):
            return flat
        whole = flat.astype(np.int32)
    return whole if np.array_equal(whole, flat) else flat


def _read_only(array: NDArray[Any]) -> NDArray[np.float64]:
    """Return a read-only array, copied only if it is writable elsewhere or of another type."""
    if array.dtype == np.float64 and array.base is None and not array.flags.writeable:
        return array
    copy = array.astype(np.float64)
    copy.flags.writeable = False
    return copy
