"""Weber and Michelson contrast."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from math import inf, isfinite
from numbers import Real
from sys import float_info
from typing import Literal, TypeAlias, TypeGuard, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.percent import plain_contrast
from .arrays import numeric_array
from .distribution import Region
from .pixel_pairs import bright_and_dark

#: Detection intervals that are kept for the next frame of a video.
_KEPT = 2**14
#: Ends of intervals are at most half the largest float.
_LARGEST_END = int(float_info.max) // 2
#: A number as the ratio of two whole ones, the second above 0.
_Exact: TypeAlias = tuple[int, int]
#: Contrasts to be detected, fractions: one, or several; None for the one that a pair has.
TargetContrasts: TypeAlias = float | tuple[float, ...] | None


def each_contrast(contrasts: TargetContrasts) -> tuple[float | None, ...]:
    """Return contrasts to be detected as a tuple, that of None as (None,)."""
    return contrasts if isinstance(contrasts, tuple) else (contrasts,)


def weber_contrast(bright: ArrayLike, dark: ArrayLike) -> NDArray[np.float64]:
    """Weber contrast K = bright / dark - 1, a fraction (1.0 is 100 %).

    Parameters
    ----------
    bright, dark : array_like of int or float
        Values in one linear unit, of broadcastable shapes.

    Returns
    -------
    ndarray of float64
        Contrast, of the common shape. Where dark is 0 or below: inf if bright is above 0, nan if it is not.

    Raises
    ------
    InputError
        If the values are not integers or floats of at most 64 bit.

    Notes
    -----
    The form of Weber contrast that CDP is defined with (L. Ebbert, Implementierung von CDP, 2018). For detection
    probabilities use `cdp`, which rounds no quotient.

    Examples
    --------
    >>> from labcdp.metrics import weber_contrast
    >>> weber_contrast([12.0, 5.0, 3.0], [10.0, 0.0, 4.0])
    array([ 0.2 ,   inf, -0.25])
    """
    upper = numeric_array(bright, "bright").astype(np.float64)
    lower = numeric_array(dark, "dark").astype(np.float64)
    lit = lower > 0
    return np.where(lit, upper / np.where(lit, lower, 1) - 1, np.where(upper > 0, np.inf, np.nan))


def weber_contrast_of_means(a: Region, b: Region) -> float:
    """Weber contrast of the means of two regions, larger over smaller: at least 0.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions in one linear unit.

    Returns
    -------
    float
        A fraction; inf if the smaller mean is 0 or below, nan if both are.

    Raises
    ------
    InputError
        If a region cannot be used, or neither holds a value above 0.

    Examples
    --------
    >>> from labcdp.metrics import weber_contrast_of_means
    >>> weber_contrast_of_means([10, 10], [14, 16])
    0.5
    """
    bright, dark, _ = bright_and_dark(a, b)
    return float(weber_contrast(bright.mean, dark.mean))


#: Definition of the contrast of a bright value b and a dark one d: Weber b / d - 1, Michelson (b - d) / (b + d).
ContrastDefinition: TypeAlias = Literal["weber", "michelson"]


@dataclass(frozen=True)
class DetectionInterval:
    """Relative tolerance of a target contrast, below and above.

    Parameters
    ----------
    below : float or None
        Tolerance below the contrast, 0 to 1; None for no lower end.
    above : float or None
        Tolerance above it, 0 or more; None for no upper end.

    Raises
    ------
    InputError
        If a tolerance is out of range, both are 0 or both are None.

    Notes
    -----
    The interval of a contrast K is K (1 - below) to K (1 + above), ends included. A number is short for equal
    tolerances: 0.5 is ``DetectionInterval(0.5, 0.5)``. Without an upper end, pairs of unbounded contrast (dark value 0
    or below, bright value above 0) are detected. Without a lower end, pairs of negative contrast (the bright region's
    pixel is the darker one) are detected. Pairs in which no value is above 0 are never detected.

    Examples
    --------
    >>> import labcdp
    >>> dark, bright = [100, 100], [115, 160]
    >>> labcdp.cdp(bright, dark, 0.2, labcdp.DetectionInterval.at_least(0.5)).cdp
    1.0
    >>> labcdp.cdp(bright, dark, 0.2, 0.5).cdp
    0.5
    """

    below: float | None
    above: float | None

    def __post_init__(self) -> None:
        if self.below is None and self.above is None:
            raise InputError("the detection interval has no end: give a tolerance below or above the contrast")
        if self.below is not None and not 0 <= self.below <= 1:
            raise InputError(f"tolerance below the contrast is {self.below}: give a fraction from 0 to 1, or None")
        if self.above is not None and not (isfinite(self.above) and self.above >= 0):
            raise InputError(f"tolerance above the contrast is {self.above}: give a fraction of 0 or more, or None")
        if self.below == self.above == 0:
            raise InputError("both tolerances of the detection interval are 0: give one above 0, or None")

    @classmethod
    def at_least(cls, below: float) -> DetectionInterval:
        """Detect from K (1 - `below`) on, without an upper end."""
        return cls(below, None)

    @classmethod
    def at_most(cls, above: float) -> DetectionInterval:
        """Detect up to K (1 + `above`), without a lower end."""
        return cls(None, above)


#: Tolerance argument: a number above 0 up to 1 for both sides, or an interval.
Epsilon: TypeAlias = float | DetectionInterval


def checked_contrast(contrast: object, epsilon: object, definition: object = "weber") -> float:
    """Return a contrast to be detected as a fraction.

    Raises
    ------
    InputError
        If it is not above 0, or in the Michelson definition not below 1; or if its tolerance or the definition is none.
    """
    contrast = plain_contrast(contrast, "contrast")
    if definition not in get_args(ContrastDefinition):
        raise InputError(f"contrast definition is {definition!r}: give 'weber' or 'michelson'")
    if not (_is_number(contrast) and isfinite(contrast) and contrast > 0):
        raise InputError(f"contrast is {contrast!r}: give a fraction above 0 (1.0 is 100 %)")
    if definition == "michelson" and contrast >= 1:
        raise InputError(f"Michelson contrast is {contrast}: give a fraction above 0 and below 1")
    if not (isinstance(epsilon, DetectionInterval) or (_is_number(epsilon) and 0 < epsilon <= 1)):
        raise InputError(f"epsilon is {epsilon!r}: give a fraction above 0, up to 1")
    return float(contrast)


@lru_cache(maxsize=_KEPT)
def detected_contrasts(contrast: float, epsilon: Epsilon) -> tuple[float, float]:
    """Lowest and highest contrast that counts as detected; -inf or inf for an end that is open."""
    low, high = _ends(contrast, epsilon)
    return -inf if low is None else _rounded(low), inf if high is None else _rounded(high)


@lru_cache(maxsize=_KEPT)
def detected_ratios(contrast: float, epsilon: Epsilon, definition: ContrastDefinition = "weber") -> tuple[float, float]:
    """Lowest and highest ratio of bright to dark value that counts as detected; -inf or inf for an open end.

    Michelson contrast M rises with the ratio of the values, (1 + M) / (1 - M), so that its interval is the Weber
    interval between 2 M / (1 - M) at both ends. No ratio reaches M = 1: an upper end there or beyond is open.
    """
    low, high = (None if end is None else _ratio(end, definition) for end in _ends(contrast, epsilon))
    return -inf if low is None else low, inf if high is None else high


def _ends(contrast: float, epsilon: Epsilon) -> tuple[_Exact | None, _Exact | None]:
    """Return the ends of the interval, from the decimals that contrast and tolerance are written as."""
    below, above = (
        (epsilon.below, epsilon.above) if isinstance(epsilon, DetectionInterval) else (float(epsilon), float(epsilon))
    )
    number, of = decimal_ratio(contrast)

    def end(tolerance: float, sign: int) -> _Exact:
        part, whole = decimal_ratio(tolerance)
        return number * (whole + sign * part), of * whole

    return None if below is None else end(below, -1), None if above is None else end(above, 1)


def _ratio(end: _Exact, definition: ContrastDefinition) -> float:
    number, of = end
    if definition == "weber":
        return _rounded((of + number, of))
    return inf if number >= of else _rounded((of + number, of - number))


def _rounded(quotient: _Exact) -> float:
    """Return the nearest float, at most half the largest one: with its tolerance an end there would be open."""
    number, of = quotient
    # Python rounds the quotient of two whole numbers correctly.
    return number / of if number <= _LARGEST_END * of else float(_LARGEST_END)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


@lru_cache(maxsize=_KEPT)
def decimal_ratio(number: float) -> tuple[int, int]:
    """Return a float as the exact ratio of its shortest decimal: 0.1 is exactly 1 to 10."""
    return Decimal(repr(float(number))).as_integer_ratio()
