"""Slanted edges: where the edge is, its profile across, and the transform of that with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan, degrees, log, nan, pi
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.quantity import Quantity, as_number

_Array = NDArray[np.float64]

#: Spatial frequencies of a response in cycles/pixel: up to the sampling frequency, twice what pixels can show.
FREQUENCY = np.linspace(0.0, 1.0, 201)
#: Knots of the profile of an edge on each side of it: an eighth of a pixel apart at a sharp edge.
_KNOTS = 64
#: Smoothness of the profile, relative to the pixels at a knot: fills knots without pixels, and takes 1e-5 of a
#: modulation with four knots in a period.
_SMOOTHNESS = 1e-5
#: Least half width of a profile in pixels, that of a sharp edge, that for finding the edge, and that of a blurred one
#: in widths of its rise from 10 to 90 %.
_LEAST_PX, _SHARP_PX, _SEARCH_PX, _RISES = 4.0, 8.0, 16.0, 4.0
#: Share of the rows that need not reach as far as the profile.
_SHORT_ROWS = 0.25
#: Fewest rows, fewest of a group, and most groups, which the uncertainty comes from.
FEWEST_ROWS, _ROWS_OF_GROUP, _MOST_GROUPS = 20, 2, 20
#: Largest distance between the phases at which rows cross the edge in pixels, and least step in its uncertainties.
_LARGEST_GAP_PX, _LEAST_STEP = 0.3, 10.0
#: Largest angle of an edge.
_MOST_DEG = 40
#: Degrees of the polynomial through the rows' positions: the distortion of a lens bends an edge.
_DEGREES = (1, 2, 3)
#: Steps of the robust fit.
_ROBUST_STEPS = 8


def light_step(rows: _Array) -> float:
    """Mean of the right quarter less that of the left one."""
    known = np.isfinite(rows)
    with_values = known.any(axis=0)
    columns = np.where(known, rows, 0.0).sum(axis=0)[with_values] / known.sum(axis=0)[with_values]
    quarter = max(columns.size // 4, 1)
    return float(columns[-quarter:].mean() - columns[:quarter].mean())


@dataclass(frozen=True, eq=False)
class EdgeLine:
    """Rows that an edge crosses, and the polynomial of its position in them over (row - middle) / middle."""

    shape: tuple[int, int]
    row: NDArray[np.intp]
    coefficients: _Array

    @property
    def along(self) -> _Array:
        """Middles of the rows, -1 at the upper end of the region and 1 at the lower one."""
        return (self.row.astype(np.float64) + 0.5) / (self.shape[0] / 2) - 1

    @property
    def position_px(self) -> _Array:
        """Position in each row."""
        return np.asarray(np.polyval(self.coefficients, self.along), dtype=np.float64)

    @property
    def slope(self) -> _Array:
        """Pixels that the position moves from row to row."""
        return np.asarray(np.polyval(np.polyder(self.coefficients), self.along) / (self.shape[0] / 2), dtype=np.float64)

    @property
    def angle_deg(self) -> float:
        """Mean angle from the columns."""
        return degrees(atan(float(self.slope.mean())))

    @property
    def distance_px(self) -> _Array:
        """Distance across the edge, shape (rows, width)."""
        x_px = np.arange(self.shape[1]) + 0.5
        distance: _Array = (x_px - self.position_px[:, None]) / np.sqrt(1 + self.slope[:, None] ** 2)
        return distance

    def fitted_to(self, position_px: _Array, degrees_tried: Sequence[int]) -> EdgeLine:
        """Return the edge through the positions of its rows, by the degree that explains them best."""
        fits = [_robust_fit(self.along, position_px, degree) for degree in degrees_tried]
        return replace(self, coefficients=min(fits, key=lambda fit: fit[1])[0])


def _robust_fit(along: _Array, position_px: _Array, degree: int) -> tuple[_Array, float]:
    """Polynomial through the rows' positions, less weight for those that deviate, and its information criterion."""
    design = np.vander(along, degree + 1).astype(np.float64)
    weights = np.ones(along.size)
    for _ in range(_ROBUST_STEPS):
        weighted = design * weights[:, None]
        coefficients = np.asarray(np.linalg.solve(weighted.T @ design, weighted.T @ position_px), dtype=np.float64)
        deviation = position_px - design @ coefficients
        scale = max(1.4826 * float(np.median(np.abs(deviation))), 1e-6)
        # Tukey's biweight, nearly as efficient as least squares.
        weights = np.clip(1 - (deviation / (4.685 * scale)) ** 2, 1e-3, 1.0) ** 2
    variance = float(np.average(deviation**2, weights=weights))
    return coefficients, along.size * log(max(variance, 1e-12)) + (degree + 1) * log(along.size)


def located_edge(rows: _Array) -> EdgeLine:
    """Find the edge: first where each row rises most, then where it fits the profile of all."""
    known = np.isfinite(rows).sum(axis=1) >= 2 * _LEAST_PX
    row = np.flatnonzero(known)
    if row.size < FEWEST_ROWS:
        raise InputError(f"{row.size} rows have pixels on both sides of the edge: give at least {FEWEST_ROWS}")
    smooth = _smoothed(rows[row])
    steepest = np.argmax(smooth[:, 3:] - smooth[:, :-3], axis=1) + 2.0
    edge = EdgeLine(rows.shape, row, np.zeros(1)).fitted_to(steepest, (1,))
    if abs(edge.angle_deg) > _MOST_DEG:
        # At 45° all rows have one phase: their profile says nothing of the angle.
        raise InputError(f"the edge is slanted by {abs(edge.angle_deg):.0f}°: slant it by 5°, at most {_MOST_DEG}°")
    for tried in ((1,), (1,), _DEGREES, _DEGREES):
        edge = _inside(edge, rows)
        profile = _fitted(rows, edge, min(_reach_px(edge, rows), _SEARCH_PX))
        shift_px = profile.shifts_px(rows[edge.row], edge.distance_px)
        edge = edge.fitted_to(edge.position_px + shift_px * np.sqrt(1 + edge.slope**2), tried)
    return _inside(edge, rows)


def _smoothed(rows: _Array) -> _Array:
    """Mean of 3 x 3 pixels, shape (height, width); pixels without a value have that of the nearest in their row."""
    columns = np.arange(rows.shape[1])
    filled = np.array([np.interp(columns, columns[known := np.isfinite(row)], row[known]) for row in rows])
    padded = np.pad(filled, 1, mode="edge")
    shifted = [padded[y : y + filled.shape[0], x : x + filled.shape[1]] for y in range(3) for x in range(3)]
    means: _Array = np.mean(shifted, axis=0)
    return means


def _inside(edge: EdgeLine, rows: _Array) -> EdgeLine:
    """Return the edge in the rows that have pixels far enough on both sides of it; raises InputError for too few."""
    distance = np.where(np.isfinite(rows[edge.row]), edge.distance_px, 0.0)
    inside = (distance.min(axis=1) <= -_LEAST_PX) & (distance.max(axis=1) >= _LEAST_PX)
    if np.count_nonzero(inside) < FEWEST_ROWS:
        raise InputError(
            f"{np.count_nonzero(inside)} rows have {_LEAST_PX:g} pixels and more on both sides of an edge: draw the "
            f"region about one edge, at least {FEWEST_ROWS} rows of it"
        )
    return replace(edge, row=edge.row[inside])


@dataclass(frozen=True, eq=False)
class EdgeProfile:
    """Splines of an edge's profile: with all rows, and with each group of rows left out.

    Parameters
    ----------
    half_width_px : float
        Distance that they reach from the edge.
    coefficients : ndarray of float, shape (1 + groups, n)
        Of cubic B-splines on uniform knots.
    halves : ndarray of float, shape (2, n)
        The same of every other group.
    """

    half_width_px: float
    coefficients: _Array
    halves: _Array

    @property
    def grid_px(self) -> _Array:
        """Distances from one end to the other, two for each knot."""
        return np.linspace(-self.half_width_px, self.half_width_px, 4 * _KNOTS + 1)

    @property
    def rise_px(self) -> float:
        """Distance in which the profile rises from 10 to 90 %."""
        relative = (self.curves(self.grid_px)[0] - self.dark[0]) / (self.bright[0] - self.dark[0])
        middle = int(np.argmin(np.abs(self.grid_px)))
        below, above = np.flatnonzero(relative[:middle] < 0.1), np.flatnonzero(relative[middle:] > 0.9)
        low = self.grid_px[below[-1]] if below.size else -self.half_width_px
        return float((self.grid_px[middle + above[0]] if above.size else self.half_width_px) - low)

    def curves(self, distance_px: _Array, derivative: bool = False, coefficients: _Array | None = None) -> _Array:
        """Return the profiles, or their derivatives, at distances, shape (1 + groups, m)."""
        chosen = self.coefficients if coefficients is None else coefficients
        first, weights = _basis(distance_px, self.half_width_px, derivative)
        curves: _Array = np.sum([chosen[:, first + k] * weights[k] for k in range(4)], axis=0)
        return curves

    def shifts_px(self, rows: _Array, distance_px: _Array) -> _Array:
        """Distances by which each row lies beyond the common profile, by least squares."""
        near = np.isfinite(rows) & (np.abs(distance_px) < self.half_width_px)
        within = np.clip(distance_px, -self.half_width_px, self.half_width_px).ravel()
        value, slope = (self.curves(within, derivative)[0].reshape(rows.shape) for derivative in (False, True))
        slope = np.where(near, slope, 0.0)
        residual = np.where(near, rows - value, 0.0)
        shift = -(slope * residual).sum(axis=1) / np.maximum((slope**2).sum(axis=1), 1e-300)
        clipped: _Array = np.clip(shift, -_LEAST_PX / 2, _LEAST_PX / 2)
        return clipped

    @property
    def window(self) -> _Array:
        """Window of the derivative: 1 in the middle half, falling to 0 at the ends as a cosine."""
        outer = np.clip(2 * np.abs(self.grid_px) / self.half_width_px - 1, 0.0, 1.0)
        window: _Array = (1 + np.cos(pi * outer)) / 2
        return window

    @property
    def response(self) -> Quantity[_Array]:
        """Response without the square of its noise."""
        weighted = self.curves(self.grid_px, derivative=True) * self.window * (self.half_width_px / (2 * _KNOTS))
        transform = weighted @ np.exp(-2j * pi * self.grid_px[:, None] * FREQUENCY)
        transform /= transform[:, :1].real
        change = transform[1:] - transform[0]
        noise = (len(change) - 1) / len(change) * np.sum(np.abs(change - change.mean(axis=0)) ** 2, axis=0)
        magnitude = np.abs(transform[0])
        response = np.sqrt(np.maximum(magnitude**2 - noise, 0.0))
        # Along the phase of the whole: noise across it is no change of the response.
        changes = (change * transform[0].conj()).real / np.maximum(magnitude, 1e-300)
        return jackknifed(np.concatenate([response[None], response + changes]))

    @property
    def bright(self) -> _Array:
        """Light of the bright side of each profile, shape (1 + groups,)."""
        return self._side(1, self.coefficients)

    @property
    def dark(self) -> _Array:
        """The same of the dark side."""
        return self._side(-1, self.coefficients)

    def _side(self, side: Literal[1, -1], coefficients: _Array) -> _Array:
        """Mean where the window falls: the step is then the transform at frequency 0."""
        weights = np.maximum(-side * np.gradient(self.window), 0.0)
        mean: _Array = self.curves(self.grid_px, coefficients=coefficients) @ (weights / weights.sum())
        return mean

    def excess(self, side: Literal[1, -1]) -> Quantity:
        """How far a side is exceeded, in steps: where one half of the rows exceeds it most, by the other half."""
        near = self.grid_px[(side * self.grid_px > 0) & (np.abs(self.grid_px) <= self.half_width_px / 2)]

        def excesses(coefficients: _Array) -> _Array:
            plateau, other = (self._side(s, coefficients)[:, None] for s in (side, -side))
            return (self.curves(near, coefficients=coefficients) - plateau) / (plateau - other)

        halves = excesses(self.halves)
        value = float(np.mean(halves[[1, 0], np.argmax(halves, axis=1)]))
        each = excesses(self.coefficients)
        at_peak = jackknifed(each[:, int(np.argmax(each[0]))])
        return Quantity(value, at_peak.u, dof=at_peak.dof)


def _basis(distance_px: _Array, half_width_px: float, derivative: bool = False) -> tuple[NDArray[np.intp], _Array]:
    """First of the four cubic B-splines that are not 0 at each distance, and their values, shape (4, n)."""
    knot_px = half_width_px / _KNOTS
    place = (distance_px + half_width_px) / knot_px
    first = np.clip(np.floor(place).astype(np.intp), 0, 2 * _KNOTS - 1)
    t = place - first
    if derivative:
        values = [-((1 - t) ** 2) / 2, (3 * t**2 - 4 * t) / 2, (-3 * t**2 + 2 * t + 1) / 2, t**2 / 2]
        return first, np.array(values) / knot_px
    return first, np.array([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6


def edge_profile(rows: _Array, edge: EdgeLine) -> EdgeProfile:
    """Fit the profile as far as the blur reaches, with its groups of rows; raises InputError."""
    _require_phases(edge, rows)
    reach_px = _reach_px(edge, rows)
    rise_px = _fitted(rows, edge, min(reach_px, _SEARCH_PX)).rise_px
    n_groups = int(np.clip(edge.row.size // _ROWS_OF_GROUP, 2, _MOST_GROUPS))
    profile = _fitted(rows, edge, min(max(_RISES * rise_px, _SHARP_PX), reach_px), n_groups)
    step = jackknifed(profile.bright - profile.dark)
    if not step.value > _LEAST_STEP * step.u:
        raise InputError("there is no edge in the noise: draw the region about one edge, or take it with more contrast")
    return profile


def _reach_px(edge: EdgeLine, rows: _Array) -> float:
    """Distance from the edge that most rows reach on both sides."""
    distance = np.where(np.isfinite(rows[edge.row]), edge.distance_px, 0.0)
    ends = -distance.min(axis=1), distance.max(axis=1)
    return float(min(np.quantile(end, _SHORT_ROWS) for end in ends))


def _fitted(rows: _Array, edge: EdgeLine, half_px: float, n_groups: int = 1) -> EdgeProfile:
    """Fit the profile of an edge, with all rows and without each group of them."""
    distance, light = edge.distance_px, rows[edge.row]
    near = np.isfinite(light) & (np.abs(distance) <= half_px)
    group = np.broadcast_to((np.arange(edge.row.size) * n_groups // edge.row.size)[:, None], near.shape)[near]
    matrices, sides = _normal_equations(distance[near], light[near], group, half_px, n_groups)
    total, total_side = matrices.sum(axis=0), sides.sum(axis=0)
    smooth = np.diff(np.eye(total.shape[0]), n=2, axis=0)
    penalty = _SMOOTHNESS * float(np.trace(total)) / total.shape[0] * smooth.T @ smooth

    def solved(matrix: _Array, side: _Array) -> _Array:
        solution: _Array = np.linalg.solve(matrix + penalty, side[..., None])[..., 0]
        return solution

    whole = solved(total, total_side)[None]
    if n_groups == 1:
        return EdgeProfile(half_px, whole, whole)
    left_out = solved(total - matrices, total_side - sides)
    halves = solved(*(np.array([part[::2].sum(axis=0), part[1::2].sum(axis=0)]) for part in (matrices, sides)))
    return EdgeProfile(half_px, np.concatenate([whole, left_out]), halves)


def _normal_equations(
    distance_px: _Array, light: _Array, group: NDArray[np.intp], half_px: float, n_groups: int
) -> tuple[_Array, _Array]:
    """Matrices, shape (groups, n, n), and right sides, shape (groups, n), of the least squares of each group."""
    first, weights = _basis(distance_px, half_px)
    n = 2 * _KNOTS + 3
    row = group * n + first

    def summed(index: NDArray[np.intp], values: _Array, size: int) -> _Array:
        return np.asarray(np.bincount(index, values, n_groups * size), dtype=np.float64)

    each = range(4)
    sides = np.sum([summed(row + k, weights[k] * light, n) for k in each], axis=0)
    matrices = np.sum(
        [summed((row + j) * n + first + k, weights[j] * weights[k], n * n) for j in each for k in each], axis=0
    )
    return matrices.reshape(n_groups, n, n), sides.reshape(n_groups, n)


def _require_phases(edge: EdgeLine, rows: _Array) -> None:
    distance = edge.distance_px[np.isfinite(rows[edge.row])]
    near = np.sort(distance[np.abs(distance) <= _LEAST_PX / 2])
    gap = float(np.diff(near).max()) if near.size > 1 else nan
    if not gap <= _LARGEST_GAP_PX:
        raise InputError(
            f"the rows cross the edge at phases {gap:.2g} pixels apart: slant the edge by about 5°, or "
            "take more of its rows"
        )


def jackknifed(values: _Array) -> Quantity[Any]:
    """Value of all rows, the first one, with the uncertainty by those with each group of rows left out."""
    left_out = values[1:]
    n = len(left_out)
    u = np.sqrt((n - 1) / n * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0))
    return Quantity(as_number(values[0]), as_number(u), dof=n - 1)
