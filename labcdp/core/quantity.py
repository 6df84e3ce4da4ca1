"""A value with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any, Generic, NamedTuple

import numpy as np
from typing_extensions import TypeVar

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: 97.5 % quantile of the standard normal distribution: U (95 %) in standard uncertainties.
Z_95 = 1.959963984540054

#: A number, or an array of numbers; a number where it is not said.
Number = TypeVar("Number", float, "NDArray[np.float64]", default=float)


class Interval(NamedTuple, Generic[Number]):
    """Lower and upper end of an interval, numbers or arrays."""

    low: Number
    high: Number


@dataclass(frozen=True)
class Quantity(Generic[Number]):
    """A value with its standard uncertainty (JCGM 100:2008).

    Parameters
    ----------
    value : float or ndarray of float
        The value, in `unit`.
    u : float or ndarray of float
        Its standard uncertainty, in `unit`; nan where it is not known.
    unit : str
        For example ``cd/m²``; empty or ``1`` for a number.
    note : str
        Method or limitation; may be empty.
    dof : float
        Effective degrees of freedom of `u`; inf for an uncertainty that is known exactly.
    coverage : float or None
        Coverage factor k of `U` where its distribution is neither normal nor that of Student, as of limits that
        prevail; None for that of `dof`.
    ends : Interval or None
        The 95 % interval where it does not lie evenly about the value, as of a share near 1; None for `value` ± `U`.

    Examples
    --------
    >>> luminance = Quantity(102.0, 0.5, "cd/m²")
    >>> round(luminance.U, 2)
    0.98
    >>> round(Quantity(102.0, 0.5, dof=2).U, 2)
    2.15
    >>> float(luminance)
    102.0
    >>> share = Quantity(0.99, 0.02, ends=Interval(0.93, 1.0))
    >>> share.interval, round(share.U, 3)
    (Interval(low=0.93, high=1.0), 0.035)
    """

    value: Number
    u: Number
    unit: str = ""
    note: str = ""
    dof: float = inf
    coverage: float | None = None
    ends: Interval[Number] | None = None

    @property
    def k(self) -> float:
        """Coverage factor of `U`."""
        return coverage_factor(self.dof) if self.coverage is None else self.coverage

    @property
    def U(self) -> Number:  # noqa: N802 - the symbol of the GUM
        """Expanded uncertainty (95 %), half the width of `interval`."""
        if self.ends is not None:
            return (self.ends.high - self.ends.low) / 2
        return self.k * self.u

    @property
    def interval(self) -> Interval[Number]:
        """95 % interval: `ends`, or `value` - `U` to `value` + `U`."""
        if self.ends is not None:
            return self.ends
        return Interval(self.value - self.U, self.value + self.U)

    @property
    def u_known(self) -> Number:
        """Standard uncertainty, 0 where it is not known."""
        u: Number = as_number(np.where(np.isfinite(self.u), self.u, 0.0))
        return u

    @property
    def u_rel(self) -> Number:
        """Standard uncertainty relative to the absolute value; nan or inf for a value of 0.

        Examples
        --------
        >>> Quantity(200.0, 3.0).u_rel
        0.015
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio: Number = as_number(np.divide(self.u, np.abs(self.value)))
        return ratio

    @property
    def U_rel(self) -> Number:  # noqa: N802 - the symbol of the GUM
        """Expanded uncertainty (95 %) relative to the absolute value."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio: Number = as_number(np.divide(self.U, np.abs(self.value)))
        return ratio

    def over(self, other: Quantity, unit: str, note: str = "", power: int = 1) -> Quantity[Number]:
        """Return the ratio to a power of an independent quantity, by the law of propagation (JCGM 100:2008, 5.1.2).

        Examples
        --------
        >>> Quantity(10.0, 0.3, "DN").over(Quantity(2.0, 0.08, "DN/e-"), "e-")
        Quantity(value=5.0, u=0.25, unit='e-', note='', dof=inf, coverage=None, ends=None)
        """
        divisor = other.value**power
        value = self.value / divisor
        u: Number = as_number(np.hypot(self.u_known / divisor, power * value * other.u_known / abs(other.value)))
        return Quantity(value, u, unit, note)

    def __sub__(self, other: Quantity[Number]) -> Quantity[Number]:
        """Return the difference of independent quantities of one unit."""
        u: Number = as_number(np.hypot(self.u, other.u))
        return Quantity(self.value - other.value, u, self.unit)

    def __float__(self) -> float:
        return float(self.value)


def as_number(values: Any) -> Any:
    """Return an array unchanged, and a float for an array without a dimension."""
    return values if np.ndim(values) else float(values)


def coverage_factor(dof: float) -> float:
    """Return the coverage factor of a 95 % interval, the 97.5 % quantile of Student's t distribution.

    Parameters
    ----------
    dof : float
        Degrees of freedom, above 0.

    Examples
    --------
    >>> round(coverage_factor(4), 3)
    2.776
    """
    if dof == inf:
        return Z_95
    from scipy.special import stdtrit

    return float(stdtrit(dof, 0.975))
