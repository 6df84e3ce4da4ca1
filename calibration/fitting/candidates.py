"""Candidate models of the response: linear, quadratic, cubic, gamma, with knees, monotone PCHIP, or a given one."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb, log, log1p

import numpy as np
from numpy.typing import NDArray

from ...core.dn import Response, ResponseKind
from ..sensor.response import ResponseCurve
from .design import Array, Design

#: Fewest patches in excess of the parameters, so that leave-one-out fits are possible.
MIN_SPARE_PATCHES = 2
#: Most knots of a PCHIP response: sensors are smooth, and every knot adds uncertainty.
MAX_KNOTS = 4
#: Knots of a cubic or gamma curve, and how far it goes beyond the highest signal.
_N_KNOTS, _REACH = 64, 1.1
#: Places at which knees are looked for, and the lowest of them, relative to n_max.
_N_PLACES, _LOWEST_KNEE = 20, 1e-3
#: Start of the exponent of a gamma.
_START_GAMMA = 2.0


@dataclass(frozen=True)
class CandidateModel:
    """One model of the candidates: c(n) = h(n) / R with its parameters b.

    linear: b1 n. quadratic: b1 n + b2 n^2 / n_max, cubic: + b3 n^3 / n_max^2. gamma: b1 ((n + d)^g - d^g) / (g d^(g-1))
    with b2 = g, a power law of the DN, dark signal d included. knees: straight lines, with the values b1 to bk at the
    k - 1 knees and at n_max, and the places of the knees as further parameters: companding, or readouts that are
    joined. pchip: monotone cubic interpolation (F. N. Fritsch and R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238) of
    the values b at the knots, and 0 at 0. table: b1 times the response of a bracket.

    Parameters
    ----------
    kind : {'linear', 'quadratic', 'cubic', 'gamma', 'knees', 'pchip', 'table'}
        Which.
    knots_dn : tuple of float
        Increasing; the last is n_max, the highest signal of the fit; only that one but for pchip and for knees, whose
        places they are to begin with; the range of the bracket for a table.
    bracket : ResponseCurve or None
        Of a table.
    dark_dn : float
        Dark signal d, of a gamma.
    values : tuple of float
        Approximate values at the knees and at n_max, in DN, of a response with knees.
    """

    kind: ResponseKind
    knots_dn: tuple[float, ...]
    bracket: ResponseCurve | None = None
    dark_dn: float = 0.0
    values: tuple[float, ...] = ()

    @property
    def n_parameters(self) -> int:
        """Number of parameters b."""
        n = len(self.knots_dn)
        return {"linear": 1, "quadratic": 2, "cubic": 3, "gamma": 2, "knees": 2 * n - 1, "table": 1}.get(self.kind, n)

    @property
    def alike(self) -> int:
        """Models of its kind that it is the best of: places at which knees were looked for."""
        return comb(_N_PLACES, len(self.knots_dn) - 1) if self.kind == "knees" else 1

    def shape(self, net_dn: Array) -> Array:
        """Return the approximate shape of c: h of a table or of a typical gamma, else the signal itself."""
        if self.kind == "gamma":
            return self.curve(np.array([1.0, _START_GAMMA]), net_dn)[0]
        return net_dn if self.bracket is None else self.bracket.response.linearise(net_dn)

    def errors(self, net_dn: Array) -> Array:
        """Independent relative errors of a given shape, shape (k, n); empty for a fitted one."""
        return np.zeros((0, net_dn.size)) if self.bracket is None else self.bracket.errors(net_dn)

    def start(self, slope: float) -> Array:
        """Parameters of a straight line, or of a table, by the ratio of luminance to `shape`."""
        if self.kind == "pchip":
            return slope * np.array(self.knots_dn)
        if self.kind == "knees":
            return np.array([*(slope * value for value in self.values), *self.knots_dn[:-1]])
        second = _START_GAMMA if self.kind == "gamma" else 0.0
        return np.array([slope, second, 0.0][: self.n_parameters])

    def curve(self, parameters: Array, net_dn: Array) -> tuple[Array, Array]:
        """Values and slopes at signals, both of shape (n,); beyond n_max a pchip continues with the slope there."""
        top = self.knots_dn[-1]
        if self.kind == "linear":
            return parameters[0] * net_dn, np.full(net_dn.shape, parameters[0])
        if self.kind in ("quadratic", "cubic"):
            powers = np.arange(1, self.n_parameters + 1)
            slope = ((net_dn[:, None] / top) ** (powers - 1) * powers) @ parameters
            return self._powers(net_dn) @ parameters, slope
        if self.kind == "gamma":
            b, g = parameters
            ratio = self._ratio(net_dn)
            return b * ((ratio**g - 1) * self.dark_dn / g), b * ratio ** (g - 1)
        if self.bracket is not None:
            h = self.bracket.response
            return parameters[0] * h.linearise(net_dn), parameters[0] * h.slope(net_dn)
        return self._pchip(parameters, net_dn) if self.kind == "pchip" else self._knees(parameters, net_dn)

    def jacobian(self, parameters: Array, net_dn: Array) -> Array:
        """Return derivatives of the values by the parameters, shape (n, p); of pchip and knees by differences."""
        if self.kind == "linear":
            return net_dn[:, None]
        if self.kind in ("quadratic", "cubic"):
            return self._powers(net_dn)
        if self.kind == "gamma":
            b, g = parameters
            ratio = self._ratio(net_dn)
            shape = (ratio**g - 1) * self.dark_dn / g
            by_g = b * (ratio**g * np.log(ratio) * self.dark_dn - shape) / g
            return np.column_stack([shape, by_g])
        if self.bracket is not None:
            return self.bracket.response.linearise(net_dn)[:, None]
        value, _ = self.curve(parameters, net_dn)
        columns = []
        for k, step in enumerate(1e-6 * np.abs(parameters)):
            moved = parameters.copy()
            moved[k] += step
            columns.append((self.curve(moved, net_dn)[0] - value) / step)
        return np.column_stack(columns)

    def rises(self, parameters: Array) -> bool:
        """Whether c is zero at zero and strictly rising up to n_max."""
        if self.kind == "pchip":
            return bool((np.diff(parameters, prepend=0.0) > 0).all())
        if self.kind == "knees":
            return all(bool((np.diff(line) > 0).all()) for line in self._lines(parameters))
        steps = self.knots_dn[-1] * np.linspace(0, 1, 1 if self.bracket else _N_KNOTS)
        return bool(parameters[0] > 0 and (self.curve(parameters, steps)[1] > 0).all())

    def response(self, parameters: Array) -> tuple[Response, float]:
        """Return h, normalised at small signals (see `Response`), and R in DN s^-1 / (cd m^-2)."""
        top = self.knots_dn[-1]
        if self.bracket is not None or self.kind == "linear":
            return Response() if self.bracket is None else self.bracket.response, float(1 / parameters[0])
        if self.kind == "quadratic":
            at_top = top * (1 + parameters[1] / parameters[0])
            return Response("quadratic", (0.0, top), (0.0, float(at_top))), float(1 / parameters[0])
        if self.kind in ("pchip", "knees"):
            knots, values = np.array([0.0, *self.knots_dn]), np.array([0.0, *parameters])
            knots, values = self._lines(parameters) if self.kind == "knees" else (knots, values)
        else:
            edge = self.dark_dn if self.kind == "gamma" else top
            knots = edge * np.expm1(np.linspace(0, log1p(_REACH * top / edge), _N_KNOTS))
            values = self.curve(parameters, knots)[0]
        responsivity = float(knots[1] / values[1])
        return Response(self.kind, tuple(knots.tolist()), tuple((values * responsivity).tolist())), responsivity

    def _powers(self, net_dn: Array) -> Array:
        top = self.knots_dn[-1]
        powers: Array = top * (net_dn[:, None] / top) ** np.arange(1, self.n_parameters + 1)
        return powers

    def _ratio(self, net_dn: Array) -> Array:
        ratio: Array = np.maximum(1 + net_dn / self.dark_dn, 1e-6)
        return ratio

    def _pchip(self, parameters: Array, net_dn: Array) -> tuple[Array, Array]:
        from scipy.interpolate import PchipInterpolator

        curve = PchipInterpolator([0.0, *self.knots_dn], [0.0, *parameters])
        inside = np.clip(net_dn, 0, self.knots_dn[-1])
        slope = curve(inside, 1)
        return curve(inside) + slope * (net_dn - inside), slope

    def _knees(self, parameters: Array, net_dn: Array) -> tuple[Array, Array]:
        knots, values = self._lines(parameters)
        inside = np.minimum(np.maximum(net_dn, 0), knots[-1])
        slopes = (values[1:] - values[:-1]) / (knots[1:] - knots[:-1])
        slope = slopes[np.searchsorted(knots[1:-1], inside, side="right")]
        return np.interp(inside, knots, values) + slope * (net_dn - inside), slope

    def _lines(self, parameters: Array) -> tuple[Array, Array]:
        """Knots and values of straight lines."""
        n = len(self.knots_dn)
        knots: Array = np.array([0.0, *parameters[n:], self.knots_dn[-1]])
        return knots, np.array([0.0, *parameters[:n]])


def candidate_models(design: Design, dark_dn: float, bracket: ResponseCurve | None = None) -> list[CandidateModel]:
    """Models that the data can support: the response of a bracket if there is one, then the simplest first.

    Parameters
    ----------
    design : Design
        Observations and patches.
    dark_dn : float
        Dark signal.
    bracket : ResponseCurve or None
        Given shape of the response.
    """
    net_dn, n_patches = design.net_dn, len(design.patches)
    top = float(net_dn.max())
    candidates = [] if bracket is None else [CandidateModel("table", bracket.range_net_dn, bracket)]
    fitted = [CandidateModel("linear", (top,)), CandidateModel("quadratic", (top,))]
    fitted += [CandidateModel("gamma", (top,), dark_dn=max(dark_dn, 1.0)), CandidateModel("cubic", (top,))]
    spare = n_patches - MIN_SPARE_PATCHES
    candidates += [candidate for candidate in fitted if candidate.kind == "linear" or candidate.n_parameters <= spare]
    candidates += [_with_knees(design, n) for n in (1, 2) if 2 * n + 1 <= spare]
    for n_knots in range(min(MAX_KNOTS, spare), 2, -1):
        knots = top * np.arange(1, n_knots + 1) / n_knots
        # Every interval between knots needs signals.
        if (np.histogram(net_dn, bins=[0.0, *knots])[0] >= 2).all():
            candidates.append(CandidateModel("pchip", tuple(knots.tolist())))
            break
    return candidates


def _with_knees(design: Design, n: int) -> CandidateModel:
    """Response with knees, to begin with where straight lines deviate least from the readings."""
    from scipy.optimize import minimize

    net_dn, light = design.net_dn, design.readings / design.signals.scale_per_s
    top = float(net_dn.max())

    def lines(logarithms: NDArray[np.float64]) -> tuple[float, Array, Array]:
        """Sum of relative squares, and knots and values of the best straight lines with knees."""
        knots = np.array([0.0, *np.sort(np.exp(logarithms)), top])
        lengths = np.maximum(np.diff(knots), 1e-9 * top)
        inside = np.clip(net_dn[:, None] - knots[:-1], 0, lengths)
        slopes = np.linalg.lstsq(inside / light[:, None], np.ones_like(light), rcond=None)[0]
        left = float(np.sum((inside @ slopes / light - 1) ** 2))
        return left if (slopes > 0).all() else np.inf, knots[1:], np.cumsum(slopes * lengths)

    lowest = log(max(float(net_dn.min()), _LOWEST_KNEE * top))
    places = np.linspace(lowest, log(top), _N_PLACES + 2)[1:-1]
    start = min(combinations(places.tolist(), n), key=lambda knots: lines(np.array(knots))[0])

    def deviation(logarithms: NDArray[np.float64]) -> float:
        return lines(logarithms)[0]

    _, knots, values = lines(minimize(deviation, np.array(start, dtype=np.float64), method="Nelder-Mead").x)
    return CandidateModel("knees", tuple(knots.tolist()), values=tuple((values * knots[0] / values[0]).tolist()))
