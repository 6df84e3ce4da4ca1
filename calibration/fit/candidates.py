"""Candidate models of the response: linear, quadratic, monotone PCHIP, or a given one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...core.response import Response, ResponseKind
from ..response.curve import ResponseCurve
from .design import Array

#: Fewest patches in excess of the parameters, so that leave-one-out fits are possible.
MIN_SPARE_PATCHES = 2
#: Most knots of a PCHIP response: sensors are smooth, and every knot adds uncertainty.
MAX_KNOTS = 4


class Curve(NamedTuple):
    """c(n) = h(n) / R at signals n, shape (n,): values, slopes, and derivatives by the parameters, shape (n, p)."""

    value: Array
    slope: Array
    jacobian: Array


@dataclass(frozen=True)
class CandidateModel:
    """One model of the candidates: c(n) = h(n) / R with its parameters b.

    linear: b1 n. quadratic: b1 n + b2 n^2 / n_max. pchip: monotone cubic interpolation (F. N. Fritsch and R. E.
    Carlson, SIAM J. Numer. Anal. 17 (1980) 238) of the values b at the knots, and 0 at 0. table: b1 times the response
    of a bracket.

    Parameters
    ----------
    kind : {'linear', 'quadratic', 'pchip', 'table'}
        Which.
    knots_dn : tuple of float
        Increasing; the last is n_max, the highest signal of the fit; only that one for linear and quadratic; the range
        of the bracket for a table.
    bracket : ResponseCurve or None
        Of a table.
    """

    kind: ResponseKind
    knots_dn: tuple[float, ...]
    bracket: ResponseCurve | None = None

    @property
    def n_parameters(self) -> int:
        """Number of parameters b."""
        return {"linear": 1, "quadratic": 2, "table": 1}.get(self.kind, len(self.knots_dn))

    def shape(self, net_dn: Array) -> Array:
        """Return the approximate shape of c: h of a table, else the signal itself."""
        return net_dn if self.bracket is None else self.bracket.response.linearise(net_dn)

    def errors(self, net_dn: Array) -> Array:
        """Independent relative errors of a given shape, shape (k, n); empty for a fitted one."""
        return np.zeros((0, net_dn.size)) if self.bracket is None else self.bracket.errors(net_dn)

    def start(self, slope: float) -> Array:
        """Parameters of a straight line, or of a table, by the ratio of luminance to `shape`."""
        if self.kind == "pchip":
            return slope * np.array(self.knots_dn)
        return np.array([slope, 0.0][: self.n_parameters])

    def curve(self, parameters: Array, net_dn: Array) -> Curve:
        """Evaluate at signals, shape (n,); beyond n_max a pchip continues with the slope there."""
        top = self.knots_dn[-1]
        if self.kind == "linear":
            return Curve(parameters[0] * net_dn, np.full(net_dn.shape, parameters[0]), net_dn[:, None])
        if self.kind == "quadratic":
            a, b = parameters
            jacobian = np.column_stack([net_dn, net_dn**2 / top])
            return Curve(jacobian @ parameters, a + 2 * b * net_dn / top, jacobian)
        if self.bracket is not None:
            h = self.bracket.response
            value, slope = h.linearise(net_dn), h.slope(net_dn)
            return Curve(parameters[0] * value, parameters[0] * slope, value[:, None])
        return self._pchip(parameters, net_dn)

    def rises(self, parameters: Array) -> bool:
        """Whether c is zero at zero and strictly rising up to n_max."""
        if self.kind == "pchip":
            return bool((np.diff(parameters, prepend=0.0) > 0).all())
        if self.bracket is not None:
            return bool(parameters[0] > 0)
        return bool(parameters[0] > 0 and self.curve(parameters, np.array(self.knots_dn)).slope[-1] > 0)

    def response(self, parameters: Array) -> tuple[Response, float]:
        """Return h, normalised at small signals (see `Response`), and R in DN s^-1 / (cd m^-2)."""
        top = self.knots_dn[-1]
        if self.kind == "linear":
            return Response(), float(1 / parameters[0])
        if self.bracket is not None:
            return self.bracket.response, float(1 / parameters[0])
        if self.kind == "quadratic":
            at_top = top * (1 + parameters[1] / parameters[0])
            return Response("quadratic", (0.0, top), (0.0, float(at_top))), float(1 / parameters[0])
        responsivity = self.knots_dn[0] / parameters[0]
        values = tuple(float(v) for v in parameters * responsivity)
        return Response("pchip", (0.0, *self.knots_dn), (0.0, *values)), float(responsivity)

    def _pchip(self, parameters: Array, net_dn: Array) -> Curve:
        from scipy.interpolate import PchipInterpolator

        # Finite differences of all parameters at once, as further columns.
        step = 1e-6 * parameters[-1]
        values = np.repeat(np.concatenate([[0.0], parameters])[:, None], parameters.size + 1, axis=1)
        for k in range(parameters.size):
            values[k + 1, k + 1] += step
        curve = PchipInterpolator([0.0, *self.knots_dn], values, axis=0)
        inside = np.clip(net_dn, 0, self.knots_dn[-1])
        slopes = curve(inside, 1)
        values = curve(inside) + slopes * (net_dn - inside)[:, None]
        return Curve(values[:, 0], slopes[:, 0], (values[:, 1:] - values[:, :1]) / step)


def candidate_models(net_dn: Array, n_patches: int, bracket: ResponseCurve | None = None) -> list[CandidateModel]:
    """Models that the data can support: the response of a bracket if there is one, then the simplest first.

    Parameters
    ----------
    net_dn : ndarray of float, shape (n,)
        Signals above dark of all observations.
    n_patches : int
        Number of patches.
    bracket : ResponseCurve or None
        Given shape of the response.
    """
    top = float(net_dn.max())
    candidates = [] if bracket is None else [CandidateModel("table", bracket.range_net_dn, bracket)]
    candidates.append(CandidateModel("linear", (top,)))
    if n_patches >= 2 + MIN_SPARE_PATCHES:
        candidates.append(CandidateModel("quadratic", (top,)))
    for n_knots in range(min(MAX_KNOTS, n_patches - MIN_SPARE_PATCHES), 2, -1):
        knots = top * np.arange(1, n_knots + 1) / n_knots
        # Every interval between knots needs signals.
        if (np.histogram(net_dn, bins=[0.0, *knots])[0] >= 2).all():
            candidates.append(CandidateModel("pchip", tuple(float(v) for v in knots)))
            break
    return candidates
