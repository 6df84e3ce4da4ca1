"""Dynamic range: the luminances between which a figure of merit of a camera reaches a limit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import exp, hypot, inf, isfinite, log, log2, log10, nan, sqrt
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.quantity import Z_95, Interval

#: Why a range ends: the figure falls below the limit, pixels saturate, or there is no patch beyond.
RangeEnd: TypeAlias = Literal["noise", "saturation", "chart"]
_Array = NDArray[np.float64]
#: Patches about a crossing that a curve is fitted to, at most, and fewest of a curve that is not a straight line.
_FITTED, _FEWEST_FOR_CURVE = 6, 4
#: Length of the part of the axis that they may span, in stops: beyond, the curve is no parabola any more.
_SPAN_STOPS = 3.0


@dataclass(frozen=True)
class DynamicRange:
    """The luminances between which a figure of merit reaches a limit.

    Parameters
    ----------
    limit : float
        The limit.
    low, high : float
        Ends of the range, in the unit of the luminances; nan if no patch reaches the limit.
    low_interval, high_interval : (float, float)
        Their 95 % intervals.
    low_end, high_end : {'noise', 'saturation', 'chart'} or None
        Why the range ends there: the figure is below the limit beyond, or pixels are saturated, or the chart has no
        patch beyond, so that the range is at least this one.
    dips : tuple of float
        Luminances inside the range at which the figure is below the limit, as at the hand-over of an HDR camera.
    u_scale_rel : float
        Part of the relative standard uncertainty of both ends that they have in common, which cancels in their ratio.

    Examples
    --------
    >>> from labcdp.metrics import dynamic_range
    >>> found = dynamic_range([1, 2, 4, 8], [10, 14, 20, 28], 4)
    >>> found.stops, round(found.decibels, 1), found.bound
    (3.0, 18.1, '>')
    """

    limit: float
    low: float
    high: float
    low_interval: Interval
    high_interval: Interval
    low_end: RangeEnd | None = None
    high_end: RangeEnd | None = None
    dips: tuple[float, ...] = ()
    u_scale_rel: float = 0.0

    @property
    def ratio(self) -> float:
        """High over low luminance."""
        return self.high / self.low

    @property
    def u_log(self) -> float:
        """Standard uncertainty of the natural logarithm of the ratio."""
        ends = (self.low_interval, self.high_interval)
        both = hypot(*(log(high / low) / (2 * Z_95) if high > low > 0 else 0.0 for low, high in ends))
        return sqrt(max(both**2 - 2 * self.u_scale_rel**2, 0.0))

    @property
    def ratio_interval(self) -> Interval:
        """95 % interval of the ratio."""
        factor = exp(Z_95 * self.u_log) if isfinite(self.ratio) else nan
        return Interval(self.ratio / factor, self.ratio * factor)

    @property
    def decibels(self) -> float:
        """20 log10 of the ratio."""
        return 20 * log10(self.ratio) if self.ratio > 0 else nan

    @property
    def stops(self) -> float:
        """log2 of the ratio."""
        return log2(self.ratio) if self.ratio > 0 else nan

    @property
    def u_stops(self) -> float:
        """Standard uncertainty of `stops`."""
        return self.u_log / log(2)

    @property
    def bound(self) -> Literal[">", ""]:
        """``>`` if the chart ends before the camera does at either end: the true range is at least this one."""
        return ">" if "chart" in (self.low_end, self.high_end) else ""


def dynamic_range(
    luminance: ArrayLike,
    figure: ArrayLike,
    limit: float,
    u: ArrayLike = 0.0,
    *,
    saturated: ArrayLike = False,
    saturation: float | None = None,
    logarithmic: bool = True,
    u_luminance_rel: ArrayLike = 0.0,
    u_scale_rel: float = 0.0,
) -> DynamicRange:
    """Find the luminances between which a figure of merit reaches a limit, from patches of known luminance.

    Parameters
    ----------
    luminance : array_like of float, shape (n,)
        Luminances of the patches, in any order and unit, above 0.
    figure : array_like of float, shape (n,)
        Figure of merit of each patch: SNR, CNR or CDP; nan where there is none.
    limit : float
        Least figure of merit, above 0.
    u : array_like of float, shape (n,) or ()
        Standard uncertainty of the figure.
    saturated : array_like of bool, shape (n,) or ()
        Which patches have saturated pixels, and therefore no figure.
    saturation : float or None
        Luminance from which the camera is saturated, where it is known; by default half way, on a logarithmic scale,
        between the brightest patch that is not saturated and the next one.
    logarithmic : bool
        Whether the figure is interpolated on a logarithmic scale, as ratios are; False for probabilities.
    u_luminance_rel : array_like of float, shape (n,) or ()
        Relative standard uncertainty of each luminance, independent from patch to patch.
    u_scale_rel : float
        Relative standard uncertainty that all luminances have in common, as of the white of a chart of densities: it is
        part of the intervals of both ends, and cancels in their ratio.

    Returns
    -------
    DynamicRange

    Raises
    ------
    InputError
        If the arrays differ in length, there are fewer than two patches, or a luminance or the limit is not above 0.

    Notes
    -----
    The range is about the patch with the largest figure, and reaches as far as patches reach the limit; a single one
    below it, with others beyond that reach it again, is a dip and no end. An end lies where the curve through the
    patches nearest to it crosses the limit: of the logarithm of the figure over that of the luminance, a parabola
    fitted to the four nearest patches, or to up to six within three stops, weighted by the uncertainties; of fewer
    patches, and of probabilities, the straight line through both patches at the end. Its interval is that of the fit,
    in which an error of a luminance counts as one of the figure, by the slope of the curve there.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics import dynamic_range
    >>> luminance = np.geomspace(0.1, 100, 31)
    >>> snr = luminance / np.sqrt(luminance + 0.25)  # shot noise and read noise, of a camera that 1000 would saturate
    >>> found = dynamic_range(luminance, snr, limit=2)
    >>> round(found.low, 2), found.low_end, round(found.high), found.high_end
    (4.24, 'noise', 100, 'chart')
    """
    sorted_levels, figures, known, full, u_rel = _sorted(luminance, figure, u, saturated, limit, u_luminance_rel)
    levels = sorted_levels.tolist()
    usable = np.isfinite(figures) & ~full
    if not usable.any() or not (figures[usable] >= limit).any():
        nowhere = Interval(nan, nan)
        return DynamicRange(limit, nan, nan, nowhere, nowhere)
    reached = usable & (figures >= limit)
    first, last = _run(reached, int(np.argmax(np.where(reached, figures, -inf))))
    curve = _Curve(np.log(sorted_levels), figures, known, usable, limit, logarithmic, u_rel)
    low, low_interval, low_end = _at(levels[first], "chart", u_rel[first])
    if first > 0:
        low, low_interval, low_end = *curve.crossing(first - 1, first), "noise"
    high, high_interval, high_end = _at(levels[last], "chart", u_rel[last])
    if last + 1 < len(levels) and full[last + 1]:
        if saturation is None:
            ends = Interval(levels[last], levels[last + 1])
            high, high_interval, high_end = sqrt(ends.low * ends.high), ends, "saturation"
        else:
            high, high_interval, high_end = _at(float(saturation), "saturation", u_rel[last])
    elif last + 1 < len(levels):
        high, high_interval, high_end = *curve.crossing(last + 1, last), "noise"
    dips = tuple(levels[at] for at in range(first + 1, last) if not reached[at])
    low_interval, high_interval = (_widened(interval, u_scale_rel) for interval in (low_interval, high_interval))
    return DynamicRange(limit, low, high, low_interval, high_interval, low_end, high_end, dips, u_scale_rel)


def _at(luminance: float, end: RangeEnd, u_rel: float) -> tuple[float, Interval, RangeEnd]:
    return luminance, _widened(Interval(luminance, luminance), u_rel), end


def _widened(interval: Interval, u_rel: float) -> Interval:
    """Return the interval of a luminance with a further relative uncertainty."""
    if not u_rel > 0:
        return interval
    low, high = log(interval.low), log(interval.high)
    middle, half_width = (low + high) / 2, hypot((high - low) / 2, Z_95 * u_rel)
    return Interval(exp(middle - half_width), exp(middle + half_width))


def _sorted(
    luminance: ArrayLike,
    figure: ArrayLike,
    u: ArrayLike,
    saturated: ArrayLike,
    limit: float,
    u_luminance_rel: ArrayLike,
) -> tuple[_Array, _Array, _Array, NDArray[np.bool_], _Array]:
    levels = np.asarray(luminance, dtype=np.float64)
    figures = np.asarray(figure, dtype=np.float64)
    if levels.ndim != 1 or levels.shape != figures.shape or levels.size < 2:
        raise InputError(
            f"luminance has the shape {levels.shape} and figure {figures.shape}: give one of each for two patches or "
            "more"
        )
    if not (np.isfinite(levels).all() and (levels > 0).all()):
        raise InputError("a luminance is not above 0: give that of each patch")
    if not (isfinite(limit) and limit > 0):
        raise InputError(f"limit is {limit:g}: give a number above 0")
    order = np.argsort(levels, kind="stable")
    known, u_rel = (np.broadcast_to(np.asarray(of, dtype=np.float64), levels.shape) for of in (u, u_luminance_rel))
    full = np.broadcast_to(np.asarray(saturated, dtype=np.bool_), levels.shape)
    return levels[order], figures[order], np.nan_to_num(known[order]), full[order], np.nan_to_num(u_rel[order])


def _run(reached: NDArray[np.bool_], start: int) -> tuple[int, int]:
    """First and last patch about one that reaches the limit; single patches that do not are dips."""

    def walk(at: int, step: int) -> Iterator[int]:
        yield at
        while 0 <= at + step < reached.size:
            if reached[at + step]:
                at += step
            elif 0 <= at + 2 * step < reached.size and reached[at + 2 * step]:
                at += 2 * step
            else:
                return
            yield at

    return [*walk(start, -1)][-1], [*walk(start, 1)][-1]


@dataclass(frozen=True, eq=False)
class _Curve:
    """Figure of merit over the logarithm of the luminance."""

    log_levels: _Array
    figures: _Array
    u: _Array
    usable: NDArray[np.bool_]
    limit: float
    logarithmic: bool
    u_luminance_rel: _Array

    def crossing(self, outside: int, inside: int) -> tuple[float, Interval]:
        """Luminance at which the limit is crossed between two patches next to each other, with its 95 % interval."""
        x, y, u, u_rel = self._near(outside, inside)
        target = log(self.limit) if self.logarithmic else self.limit
        if x.size < 2:
            # A patch outside without light, or without a value: the end lies somewhere between both.
            ends = sorted(np.exp(self.log_levels[[outside, inside]]).tolist())
            return sqrt(ends[0] * ends[1]), Interval(*ends)
        degree = 2 if x.size >= _FEWEST_FOR_CURVE else 1
        middle = float(self.log_levels[[outside, inside]].mean())
        design = np.vander(x - middle, degree + 1)
        coefficients, covariance = _fitted(design, y, u)
        if u_rel.any():
            u = np.hypot(u, np.polyval(np.polyder(coefficients), x - middle) * u_rel)
            coefficients, covariance = _fitted(design, y, u)
        low, high = sorted(self.log_levels[[outside, inside]].tolist())
        log_ratio = _root(coefficients, target, low - middle, high - middle)
        slope = float(np.polyval(np.polyder(coefficients), log_ratio))
        row = np.vander([log_ratio], degree + 1)[0]
        u_log_ratio = sqrt(max(float(row @ covariance @ row), 0.0)) / abs(slope) if slope and u.any() else 0.0
        # Noise cannot move it far beyond the two patches, one of which is known to reach the limit.
        return exp(middle + log_ratio), Interval(
            exp(middle + log_ratio - Z_95 * u_log_ratio), exp(middle + log_ratio + Z_95 * u_log_ratio)
        )

    def _near(self, outside: int, inside: int) -> tuple[_Array, _Array, _Array, _Array]:
        """Up to six patches about a crossing that have a figure, on the scale of interpolation."""
        positive = self.usable & ((self.figures > 0) | (not self.logarithmic))
        middle = self.log_levels[[outside, inside]].mean()
        distance = np.abs(self.log_levels - middle)
        nearest = [at for at in np.argsort(distance, kind="stable").tolist() if positive[at]]
        n_near = int(np.count_nonzero(distance[nearest] <= _SPAN_STOPS / 2 * log(2)))
        chosen = np.sort(nearest[: min(max(n_near, _FEWEST_FOR_CURVE), _FITTED)])
        if not self.logarithmic or len(chosen) < _FEWEST_FOR_CURVE:
            # Probabilities bend too much: the two patches alone.
            chosen = np.array([at for at in sorted((outside, inside)) if positive[at]], dtype=np.intp)
        y, u = self.figures[chosen], self.u[chosen]
        if self.logarithmic:
            u, y = u / y, np.log(y)
        return self.log_levels[chosen], y, u, self.u_luminance_rel[chosen]


def _fitted(design: _Array, y: _Array, u: _Array) -> tuple[_Array, _Array]:
    """Coefficients of a weighted fit by least squares, and their covariance."""
    weights = np.square(1 / np.maximum(u, 1e-9))[:, None]
    covariance: _Array = np.linalg.pinv((design * weights).T @ design).astype(np.float64)
    return covariance @ (design * weights).T @ y, covariance


def _root(coefficients: _Array, target: float, low: float, high: float) -> float:
    """Place between two ends at which a polynomial has a value; the nearer end if there is none."""
    shifted = coefficients.copy()
    shifted[-1] -= target
    roots = np.roots(shifted)
    real = roots[np.abs(roots.imag) < 1e-12].real
    inside = real[(real >= low - 1e-12) & (real <= high + 1e-12)]
    if inside.size:
        return float(inside[np.argmin(np.abs(inside))])
    return low if abs(np.polyval(shifted, low)) < abs(np.polyval(shifted, high)) else high
