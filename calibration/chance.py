"""Limits of what counts as chance."""

from __future__ import annotations

#: Probability of a chi^2 below which the stated errors are taken to be too small.
SMALL_CHANCE = 0.01
#: Probability that all tests of one kind together find something where there is nothing.
FALSE_ALARM = 0.01
#: Probability that an interval of this room is stated for.
_COVERAGE = 0.95


def chance_of_chi_squared(chi_squared: float, freedom: int) -> float:
    """Probability of a chi^2 at least this large; 1 without degrees of freedom."""
    from scipy.special import chdtrc

    return float(chdtrc(freedom, chi_squared)) if freedom > 0 else 1.0


def limit(n_tests: int, freedom: float = float("inf")) -> float:
    """Return the standard uncertainties that the largest of `n_tests` deviations exceeds by chance.

    With probability `FALSE_ALARM` for all of them together (Bonferroni); Student's t with the degrees of freedom the
    uncertainty has, or the normal distribution for one that is known.
    """
    from scipy.stats import norm, t

    tail = FALSE_ALARM / (2 * max(n_tests, 1))
    return float(norm.isf(tail) if freedom == float("inf") else t.isf(tail, max(freedom, 1)))


def student_widening(freedom: float) -> float:
    """Student's t over the normal quantile of 95 % (JCGM 100:2008, G.3): widens an uncertainty from few residuals."""
    from scipy.stats import norm, t

    tail = (1 - _COVERAGE) / 2
    return float(t.isf(tail, max(freedom, 1)) / norm.isf(tail))
