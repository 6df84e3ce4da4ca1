"""Limits of a luminance: pass, fail or undecided, with a guard band."""

from __future__ import annotations

from typing import Literal

LimitVerdict = Literal["pass", "fail", "undecided"]


def limit_verdict(value: float, expanded: float, limits: tuple[float, float]) -> LimitVerdict:
    """Decide whether a value is within its limits, with a guard band as wide as its U (95 %).

    Guarded acceptance and rejection of JCGM 106:2012, 8.3, with the guard band w = U of ILAC-G8:09/2019: pass if all of
    value ± U is within the limits, fail if all of it is outside on one side, else undecided.

    Parameters
    ----------
    value, expanded : float
        The value and its U; without a known U (nan) the value itself decides.
    limits : (float, float)
        Lowest and highest permitted value.

    Examples
    --------
    >>> [limit_verdict(value, 0.5, (9.0, 11.0)) for value in (10.0, 10.8, 12.0)]
    ['pass', 'undecided', 'fail']
    """
    low, high = limits
    guard = expanded if expanded == expanded else 0.0
    if low + guard <= value <= high - guard:
        return "pass"
    return "fail" if not low - guard <= value <= high + guard else "undecided"
