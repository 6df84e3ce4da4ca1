"""A value with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Self, TypeVar

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: 97.5 % quantile of the standard normal distribution: U (95 %) in standard uncertainties.
Z_95 = 1.959963984540054

#: A number, or an array of numbers.
Number = TypeVar("Number", float, "NDArray[np.float64]")


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
    dof : float
        Effective degrees of freedom of `u`; inf for an uncertainty that is known exactly.
    unit : str
        For example ``cd/m²``; empty for a number.

    Examples
    --------
    >>> luminance = Quantity(102.0, 0.5, unit="cd/m²")
    >>> round(luminance.U, 2)
    0.98
    >>> round(Quantity(102.0, 0.5, dof=2).U, 2)
    2.15
    >>> float(luminance)
    102.0
    """

    value: Number
    u: Number
    dof: float = inf
    unit: str = ""

    @property
    def k(self) -> float:
        """Coverage factor of `U`: the 97.5 % quantile of Student's t distribution, 1.96 for infinite `dof`."""
        return coverage_factor(self.dof)

    @property
    def U(self) -> Number:  # noqa: N802 - the symbol of the GUM
        """Expanded uncertainty (95 %)."""
        return self.k * self.u

    @property
    def interval(self) -> Interval[Number]:
        """95 % interval, `value` - `U` to `value` + `U`."""
        return Interval(self.value - self.U, self.value + self.U)

    @property
    def u_rel(self) -> Number:
        """Standard uncertainty relative to the absolute value; nan or inf for a value of 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio: Number = as_number(np.divide(self.u, np.abs(self.value)))
        return ratio

    @property
    def U_rel(self) -> Number:  # noqa: N802 - the symbol of the GUM
        """Expanded uncertainty (95 %) relative to the absolute value."""
        return self.k * self.u_rel

    def with_u(self, u: Number) -> Self:
        """Return the value with another standard uncertainty."""
        return replace(self, u=u)

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
