"""Significance: p-values, critical values and Student's t."""

from __future__ import annotations

#: p-value of chi^2 below which the stated errors are too small.
SMALL_P_VALUE = 0.01
#: Family-wise false-alarm probability of all tests of one kind.
FALSE_ALARM = 0.01


def p_value_of_chi_squared(chi_squared: float, dof: int) -> float:
    """p-value of chi^2; 1 without degrees of freedom."""
    from scipy.special import chdtrc

    return float(chdtrc(dof, chi_squared)) if dof > 0 else 1.0


def critical_value(n_tests: int, dof: float = float("inf")) -> float:
    """Return the critical value of the largest of `n_tests` deviations, in standard uncertainties.

    For a family-wise probability `FALSE_ALARM` (Bonferroni); by Student's t with the dof of the uncertainty, or the
    normal distribution for a known one.
    """
    from scipy.stats import norm, t

    tail = FALSE_ALARM / (2 * max(n_tests, 1))
    return float(norm.isf(tail) if dof == float("inf") else t.isf(tail, max(dof, 1)))
