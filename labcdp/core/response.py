"""Response: how the DN above dark grows with the light, and its inverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError

ResponseKind = Literal["linear", "quadratic", "cubic", "gamma", "pchip", "table"]


@dataclass(frozen=True)
class Response:
    """Linearised DN h(n) of a DN n above dark: h is proportional to the exposure (luminance times time) of a pixel.

    h rises strictly and h(0) = 0. A fitted response is normalised at small signals: the slope of a quadratic one is 1
    at zero, and the others have h = n at their first knot, so that R is the responsivity at small signals. Below zero,
    where noise leads, h is continued with its slope at zero.

    Parameters
    ----------
    kind : {'linear', 'quadratic', 'cubic', 'gamma', 'pchip', 'table'}
        linear: h(n) = n. quadratic: h(n) = n (1 + q n / n_max). pchip: monotone cubic interpolation (F. N. Fritsch and
        R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238) of the knots; cubic and gamma, too, with many knots of such
        a curve. table: straight lines between the knots.
    net_dn : tuple of float
        Knots, rising from 0; empty for linear, (0, n_max) for quadratic.
    linear_dn : tuple of float
        h at the knots; empty for linear, (0, h(n_max)) for quadratic.

    Raises
    ------
    InputError
        If the knots do not start at 0, or do not rise.
    """

    kind: ResponseKind = "linear"
    net_dn: tuple[float, ...] = ()
    linear_dn: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.kind == "linear":
            if self.net_dn or self.linear_dn:
                raise InputError("a linear response has no knots: leave net_dn and linear_dn empty")
            return
        least = 2
        if len(self.net_dn) != len(self.linear_dn) or len(self.net_dn) < least:
            raise InputError(
                f"a {self.kind} response has {len(self.net_dn)} and {len(self.linear_dn)} knots: give at least {least} "
                "pairs of net_dn and linear_dn"
            )
        for name in ("net_dn", "linear_dn"):
            values = np.array(getattr(self, name))
            if not (np.isfinite(values).all() and values[0] == 0 and (np.diff(values) > 0).all()):
                raise InputError(f"{name} of the response does not rise from 0: give rising values")
        if self.kind == "quadratic" and not (len(self.net_dn) == 2 and self.linear_dn[1] > self.net_dn[1] / 2):
            raise InputError("a quadratic response that rises has two knots, and its h(n_max) is above n_max / 2")

    def linearise(self, net_dn: ArrayLike) -> NDArray[np.float64]:
        """h(n), any shape; beyond the last knot with the slope there."""
        return self._evaluate(net_dn)[0]

    def covers(self, net_dn: float) -> bool:
        """Whether h is known at a signal: of a table between its knots but 0, of others above 0."""
        return net_dn > 0 if self.kind != "table" else self.net_dn[1] <= net_dn <= self.net_dn[-1]

    def slope(self, net_dn: ArrayLike) -> NDArray[np.float64]:
        """dh/dn, any shape."""
        return self._evaluate(net_dn)[1]

    def _evaluate(self, net_dn: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        n = np.asarray(net_dn, dtype=float)
        if self.kind == "linear":
            return n.copy(), np.ones_like(n)
        knots, values = np.array(self.net_dn), np.array(self.linear_dn)
        inside = np.clip(n, 0, knots[-1])
        if self.kind == "quadratic":
            bend = (values[1] / knots[1] - 1) / knots[1]
            value, slope = inside * (1 + bend * inside), 1 + 2 * bend * inside
        elif self.kind != "table":
            curve = _pchip(knots, values)
            value, slope = curve(inside), curve(inside, 1)
        else:
            value = np.interp(inside, knots, values)
            steps = np.diff(values) / np.diff(knots)
            slope = steps[np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, steps.size - 1)]
        return value + slope * (n - inside), slope


def _pchip(knots: NDArray[np.float64], values: NDArray[np.float64]) -> Any:
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(knots, values)
