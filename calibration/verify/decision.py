"""Decision rule of a verification: conform, not conform or undecided, with a guard band."""

from __future__ import annotations

from math import isfinite
from typing import Literal

from ...core.errors import InputError

Verdict = Literal["conform", "undecided", "not conform"]


def decide(deviation_rel: float, expanded_rel: float, tolerance_rel: float) -> Verdict:
    """Decide whether a deviation conforms to a tolerance, with a guard band as wide as its U (95 %).

    Conform if the size of d plus U is at most T, not conform if that minus U exceeds T, else undecided: guarded
    acceptance and rejection of JCGM 106:2012, 8.3, with the guard band w = U of ILAC-G8:09/2019. The probability of a
    wrong decision is at most 2.5 %, whatever the true deviation.

    Parameters
    ----------
    deviation_rel, expanded_rel : float
        d, and its expanded uncertainty U (95 %), as fractions.
    tolerance_rel : float
        T, as a fraction.
    """
    if abs(deviation_rel) + expanded_rel <= tolerance_rel:
        return "conform"
    return "not conform" if abs(deviation_rel) - expanded_rel > tolerance_rel else "undecided"


def conformance_probability(deviation_rel: float, standard_uncertainty_rel: float, tolerance_rel: float) -> float:
    """Probability that the true deviation is within the tolerance (JCGM 106:2012, 7.2, for a normal distribution)."""
    from scipy.special import ndtr

    if standard_uncertainty_rel == 0:
        return float(abs(deviation_rel) <= tolerance_rel)
    u = standard_uncertainty_rel
    return float(ndtr((tolerance_rel - deviation_rel) / u) - ndtr((-tolerance_rel - deviation_rel) / u))


def require_tolerance(tolerance_rel: float) -> float:
    """Refuse a tolerance that is not above 0 and up to 1."""
    if not (isfinite(tolerance_rel) and 0 < tolerance_rel <= 1):
        raise InputError(f"tolerance_rel is {tolerance_rel}: give a fraction above 0, up to 1, such as 0.03")
    return tolerance_rel
