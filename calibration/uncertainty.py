"""Expanded uncertainty: rectangular and normal parts, degrees of freedom and Student's t."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import erf, exp, inf, isfinite, pi, sqrt
from typing import NamedTuple

from ..core.errors import InputError
from .setup import MeterScale

#: Coverage probability of all intervals of this package.
COVERAGE = 0.95
#: Probability of a value above such an interval.
COVERAGE_TAIL = (1 - COVERAGE) / 2
#: p-value of chi^2 below which the stated errors are too small.
SMALL_P_VALUE = 0.01
#: Family-wise false-alarm probability of all tests of one kind.
FALSE_ALARM = 0.01
#: Least effect that counts, relative to the luminance: small compared with the 2 % of a meter.
SMALL_EFFECT_REL = 0.002


class Scatter(NamedTuple):
    """A standard deviation that the stated errors do not explain, and its degrees of freedom."""

    size: float = 0.0
    dof: float = inf

    @property
    def part(self) -> tuple[float, float]:
        """Variance and degrees of freedom."""
        return self.size**2, self.dof


#: Where the stated errors explain all.
NO_SCATTER = Scatter()


def effective_dof(parts: Iterable[tuple[float, float]]) -> float:
    """Degrees of freedom of a sum of variances, after Welch and Satterthwaite (JCGM 100:2008, G.4.1).

    Parameters
    ----------
    parts : iterable of (float, float)
        Variances with their degrees of freedom.
    """
    parts = [*parts]
    fourth = sum(variance**2 / dof for variance, dof in parts)
    return sum(variance for variance, _ in parts) ** 2 / fourth if fourth > 0 else inf


def variance_from_one_estimate(parts: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """Variance and degrees of freedom of a sum of variances that follow from one estimate and err together."""
    parts = [*parts]
    total = sum(variance for variance, _ in parts)
    spread = sum(variance / sqrt(dof) for variance, dof in parts)
    return total, (total / spread) ** 2 if spread > 0 else inf


def student_factor(dof: float) -> float:
    """Student's t over the normal quantile of 95 % (JCGM 100:2008, G.3)."""
    return 1.0 if dof == inf else _quantile(COVERAGE_TAIL, dof) / _quantile(COVERAGE_TAIL)


def three_over_two(dof: float) -> float:
    """Ratio of Student's t exceeded by chance as rarely as three standard deviations to that of 95 %."""
    from scipy.special import ndtr

    return _quantile(float(ndtr(-3.0)), dof) / _quantile(COVERAGE_TAIL, dof)


def expanded_uncertainty(parts: Iterable[tuple[float, float]], rectangular: Iterable[float] = ()) -> float:
    """Return the expanded uncertainty U (95 %) of independent errors.

    The largest rectangular one counts as such, all others as normal, with Student's t for their effective degrees of
    freedom.

    Parameters
    ----------
    parts : iterable of (float, float)
        Variances of normal errors with their degrees of freedom.
    rectangular : iterable of float
        Standard uncertainties of errors between limits.
    """
    largest, *others = sorted((*map(abs, rectangular), 0.0), reverse=True)
    normal = [*parts, *((u**2, inf) for u in others)]
    total = sqrt(sum(variance for variance, _ in normal))
    return expanded_half_width(sqrt(3) * largest, total * student_factor(effective_dof(normal)))


def coverage_probability(half_width: float, limits: float, u: float) -> float:
    """Probability that a rectangular plus a normal error lies within +-`half_width`.

    With U uniform on +-a, N normal with standard deviation s, and G(z) = z Phi(z) + phi(z), the integral of the
    normal distribution function Phi, the distribution function of U + N at w is
    (s / 2a) (G((w + a) / s) - G((w - a) / s)): the convolution of the two distributions that JCGM 101:2008
    (GUM Supplement 1), 6.4.2 and 6.4.7, assigns to limits and to a standard uncertainty.

    Parameters
    ----------
    half_width : float
        w, in the unit of the errors, at least 0.
    limits : float
        a, at least 0.
    u : float
        s, at least 0.

    Returns
    -------
    float
        Probability of -w <= U + N <= w, 0 to 1.

    Examples
    --------
    >>> from labcdp.calibration import coverage_probability
    >>> round(coverage_probability(1.96, 0.0, 1.0), 3)
    0.95
    """
    w, a, s = half_width, limits, u
    if s <= 1e-9 * a or s == 0:  # the normal part has vanished
        return 1.0 if w >= a else w / a
    if a <= 1e-6 * s:  # the rectangular part has; the difference below would lose its digits
        return erf(w / (s * sqrt(2)))
    distribution = s / (2 * a) * (_integral_of_phi((w + a) / s) - _integral_of_phi((w - a) / s))
    return min(max(2 * distribution - 1, 0.0), 1.0)


def expanded_half_width(limits: float, u: float) -> float:
    """Half-width w of the interval that contains U + N with a probability of 95 %; see `coverage_probability`.

    Two standard uncertainties would be too wide where the rectangular part dominates: 95 % of it lies within
    1.65 of its standard deviations.

    Parameters
    ----------
    limits, u : float
        Of the rectangular part U and of the normal part N, in one unit, at least 0.

    Raises
    ------
    InputError
        If a value is negative or not finite.

    Examples
    --------
    >>> from labcdp.calibration import expanded_half_width
    >>> round(expanded_half_width(0.0, 1.0), 2), round(expanded_half_width(1.0, 0.0), 2)
    (1.96, 0.95)
    """
    for name, value in (
        ("limits", limits),
        ("u", u),
    ):
        if not (isfinite(value) and value >= 0):
            raise InputError(f"{name} is {value}: give a finite number of at least 0")
    if limits == 0 and u == 0:
        return 0.0

    from scipy.optimize import brentq

    unit = max(limits, u)
    a, s = limits / unit, u / unit
    widest = a + 10 * s  # leaves out less than 1e-22
    return unit * float(brentq(lambda w: coverage_probability(w, a, s) - COVERAGE, 0.0, widest, xtol=1e-12))


def _integral_of_phi(z: float) -> float:
    return z * (1 + erf(z / sqrt(2))) / 2 + exp(-z * z / 2) / sqrt(2 * pi)


def p_value_of_chi_squared(chi_squared: float, dof: int) -> float:
    """p-value of chi^2; 1 without degrees of freedom."""
    from scipy.special import chdtrc

    return float(chdtrc(dof, chi_squared)) if dof > 0 else 1.0


def critical_value(n_tests: int, dof: float = float("inf")) -> float:
    """Return the critical value of the largest of `n_tests` deviations, in standard uncertainties.

    For a family-wise probability `FALSE_ALARM` (Bonferroni); by Student's t with the dof of the uncertainty, or the
    normal distribution for a known one.
    """
    return _quantile(FALSE_ALARM / (2 * max(n_tests, 1)), dof)


def _quantile(tail: float, dof: float = inf) -> float:
    """Return what Student's t, or a normal deviation for infinite degrees of freedom, exceeds with a probability."""
    from scipy.special import ndtri, stdtrit

    return -float(ndtri(tail) if dof == inf else stdtrit(max(dof, 1), tail))


def scales_apart(meter: MeterScale, calibrated: MeterScale) -> tuple[MeterScale, ...]:
    """Return the scales whose errors do not cancel between readings and a calibration: none of the same meter's.

    If that changed among the calibration's readings, half of the change is left on either side; and so is what it may
    have drifted between calibration and readings.
    """
    if not meter.is_as_in(calibrated):
        return meter, calibrated
    step_rel, drift_rel = calibrated.step_rel / 2, abs(meter.drift_rel - calibrated.drift_rel)
    left = replace(calibrated, limits_rel=step_rel, certificate=None, f1_prime=None, drift_rel=drift_rel)
    return (left,) if step_rel or drift_rel else ()


def expanded_rel(scales: Sequence[MeterScale], random_rel: float, dof: float = inf) -> float:
    """Relative expanded uncertainty U (95 %) of a value with the errors of meters and a further normal one."""
    normal = [(scale.normal_rel**2, scale.degrees_of_freedom) for scale in scales]
    rectangular = [part for scale in scales for part in scale.rectangular_rel]
    return expanded_uncertainty([*normal, (random_rel**2, dof)], rectangular)
