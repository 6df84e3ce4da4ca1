"""Spatial frequency response (SFR) of a camera, from the slanted edges of a chart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, isfinite, log, nan, pi, radians, sin
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.luminance import WHOLE, Invalid, LuminanceMap
from ..core.quantity import Interval, Quantity, as_number
from ..core.roi import Roi
from .arrays import light_array
from .edge_profile import FEWEST_ROWS, FREQUENCY, edge_profile, light_step, located_edge
from .region import SATURATED_SHARE

#: Direction in which an edge shows the sharpness: an edge along the columns that along the rows, ``horizontal``.
Direction: TypeAlias = Literal["horizontal", "vertical"]
_Array = NDArray[np.float64]
#: Least response of the pixels, that at 0.75 cycles/pixel, and least modulation from which the MTF of a lens is taken.
_LEAST_PIXEL, _LEAST_MODULATION = 0.3, 0.05
#: Most modulation that a chain takes, of a camera that sharpens.
_MOST_MODULATION = 4.0
#: Beyond: most points, and modulation that is left out. Error of linear interpolation between all points.
_MOST_FURTHER, _NO_MODULATION, _INTERPOLATED = 800, 0.003, 0.001


@dataclass(frozen=True, eq=False)
class Sfr:
    """Spatial frequency response of a camera at an edge, or the mean of that at several.

    Parameters
    ----------
    frequency : ndarray of float, shape (n,)
        Spatial frequencies across the edge in cycles/pixel.
    response : Quantity of ndarray, shape (n,)
        Modulation at these frequencies, 1 at 0, with that of the pixel's own square.
    mtf50, mtf10 : Quantity
        First frequencies in cycles/pixel at which the response is 50 % and 10 %; nan if it is nowhere below.
    overshoot, undershoot : Quantity
        How far the profile of the edge rises above its bright side and falls below its dark side, as a fraction of the
        step; sharpening makes both. Without it they are 0 within their noise.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics import sfr
    >>> distance = (np.arange(60) + 0.5 - 30) - 0.1 * (np.arange(80)[:, None] + 0.5 - 40)
    >>> measured = sfr(100 + 50 * np.tanh(distance))
    >>> measured.response.value[[0, 40]].round(3).tolist()
    [1.0, 0.562]
    """

    frequency: _Array
    response: Quantity[_Array]
    mtf50: Quantity
    mtf10: Quantity
    overshoot: Quantity
    undershoot: Quantity


@dataclass(frozen=True, eq=False)
class EdgeSfr(Sfr):
    """Spatial frequency response at an edge, with the edge.

    Its further parameters are given below; those of `Sfr` come first.

    Parameters
    ----------
    direction : {'horizontal', 'vertical'}
        Direction in which the sharpness is measured: along the rows, at an edge along the columns, or the other one.
    angle_deg : float
        Angle between the edge and the columns (or the rows) of pixels, in degrees, above 0 where it leans to the right
        (down) further down (right).
    line_px : ndarray of float, shape (m, 2)
        Points (x, y) on the edge, in pixels from the upper left corner of the region.
    distance_px, profile : ndarray of float, shape (k,)
        Profile of the edge: light over the distance from it, across it, in pixels.
    bright, dark : float
        Light of its two sides.
    pixel_response : ndarray of float, shape (n,)
        Response across this edge of a square pixel, or behind a colour filter of the pixels whose mean a value is; the
        lens has the response over that.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics import sfr
    >>> distance = (np.arange(60) + 0.5 - 30) - 0.1 * (np.arange(80)[:, None] + 0.5 - 40)
    >>> measured = sfr(100 + 50 * np.tanh(distance))
    >>> measured.direction, round(measured.angle_deg, 1), round(measured.bright)
    ('horizontal', 5.7, 150)
    """

    direction: Direction
    angle_deg: float
    line_px: _Array
    distance_px: _Array
    profile: _Array
    bright: float
    dark: float
    pixel_response: _Array


def sfr(
    values: ArrayLike | LuminanceMap,
    roi: Roi | None = None,
    *,
    direction: Direction | None = None,
    pixels: Mapping[tuple[int, int], float] | None = None,
) -> EdgeSfr:
    """Measure the spatial frequency response of a camera at a slanted edge.

    Parameters
    ----------
    values : array_like of float, shape (height, width), or LuminanceMap
        Light of the region about an edge, linear: companding and gamma undone. Pixels that are nan are left out, and
        of a map those that are defective.
    roi : Roi or None
        Region about one edge in pixels of the image, of whose pixels only those inside count; None for all.
    direction : {'horizontal', 'vertical'} or None
        Direction in which the sharpness is measured: ``horizontal`` for an edge along the columns of pixels,
        ``vertical`` for one along the rows; None for that which the region shows.
    pixels : mapping of (int, int) to float, or None
        Of a map behind a colour filter the pixels that a value is the mean of: weights by row and column in each group
        of 2 x 2; None for all of them alike. It is part of `EdgeSfr.pixel_response`.

    Returns
    -------
    EdgeSfr

    Raises
    ------
    InputError
        If there is no edge, or it cannot be measured: the region is too small or saturated, or the rows cross the edge
        at too few phases of the pixels, as those of an edge that is not slanted do.

    Notes
    -----
    The slanted-edge method (ISO 12233). Each row has the same profile, shifted; the shifts follow a polynomial along
    the edge (a straight line, or up to the third degree where that explains the rows better by the criterion of
    G. Schwarz, Ann. Statist. 6, 1978), fitted to the rows without those that deviate. The profile over the distance
    from the edge is a cubic spline, fitted to the pixels by least squares: unlike bins and differences it has no
    response of its own that had to be taken off (relative error below 1e-5 up to the sampling frequency). The response
    is the Fourier transform of its derivative, within a window that is flat in the middle half, over that at frequency
    0; so light further off than the window, as of flare, is not part of it. The square of its noise is taken off.

    Behind a colour filter a map has one value for each group of 2 x 2 pixels: the response is that of the groups, with
    frequencies in cycles per pixel of the sensor, up to half the sampling frequency.

    The uncertainty is that by rows: groups of neighbouring rows are left out in turn (jackknife; B. Efron and
    C. Stein, Ann. Statist. 9, 1981), so that noise which neighbouring pixels share counts, too.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.special import ndtr
    >>> from labcdp.metrics import sfr
    >>> distance = (np.arange(60) + 0.5 - 30) - 0.1 * (np.arange(80)[:, None] + 0.5 - 40)
    >>> blurred = ndtr(np.cos(np.arctan(0.1)) * distance / 0.8)  # Gaussian, 0.8 px
    >>> measured = sfr(20 + 80 * blurred)
    >>> round(measured.mtf50.value, 3), round(float(np.sqrt(np.log(2) / 2) / np.pi / 0.8), 3)
    (0.234, 0.234)
    """
    light, step, corner = _region(values, roi)
    chosen = direction or _direction(light)
    rows = light if chosen == "horizontal" else light.T
    is_falling = light_step(rows) < 0
    # From here on the bright side is on the right.
    rows = rows[:, ::-1] if is_falling else rows
    edge = located_edge(rows)
    profile = edge_profile(rows, edge)
    x = rows.shape[1] - edge.position_px if is_falling else edge.position_px
    line = np.column_stack([x, edge.row + 0.5][:: 1 if chosen == "horizontal" else -1])
    angle_deg = -edge.angle_deg if is_falling else edge.angle_deg
    response, frequency = profile.response, FREQUENCY / step
    return EdgeSfr(
        frequency, response, _crossing(frequency, response, 0.5), _crossing(frequency, response, 0.1),
        profile.excess(1), profile.excess(-1), chosen, angle_deg, step * (line + corner), step * profile.grid_px,
        profile.curves(profile.grid_px)[0], float(profile.bright[0]), float(profile.dark[0]),
        _value_response(frequency, angle_deg, chosen, pixels or dict.fromkeys(np.ndindex(step, step), 1.0)),
    )  # fmt: skip


def mean_sfr(edges: Sequence[Sfr], *, repeated: bool = False) -> Sfr:
    """Average the responses at several edges.

    Parameters
    ----------
    edges : sequence of Sfr
        At least one, all of images with one colour filter or none.
    repeated : bool
        Whether it is one edge in several pictures.

    Returns
    -------
    Sfr
        Means of the edges. Their uncertainty is by the scatter from edge to edge, noise and field together; that of a
        single edge is its own. Of a repeated edge it is by the rows of each picture, or by the scatter if that is
        larger. A frequency that an edge does not have is that of the others.

    Raises
    ------
    InputError
        If there is none, or they have different frequencies.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics import mean_sfr, sfr
    >>> distance = (np.arange(60) + 0.5 - 30) - 0.1 * (np.arange(80)[:, None] + 0.5 - 40)
    >>> edges = [sfr(np.tanh(distance / blur)) for blur in (0.9, 1.1)]
    >>> mean = mean_sfr(edges)
    >>> mean.mtf50.value == (edges[0].mtf50.value + edges[1].mtf50.value) / 2, mean.mtf50.dof
    (True, 1)
    """
    if not edges:
        raise InputError("there is no edge: give one or more")
    if any(edge.frequency[-1] != edges[0].frequency[-1] for edge in edges):
        raise InputError("the edges are of images with and without a colour filter: average those of one kind")
    names = ("response", "mtf50", "mtf10", "overshoot", "undershoot")
    return Sfr(edges[0].frequency, **{name: _mean([getattr(edge, name) for edge in edges], repeated) for name in names})


def _mean(quantities: Sequence[Quantity[Any]], repeated: bool) -> Quantity[Any]:
    """Mean with the uncertainty by the scatter of the values that are known."""
    known = [quantity for quantity in quantities if np.isfinite(quantity.value).all()]
    if len(known) < 2:
        return known[0] if known else quantities[0]
    values = np.array([quantity.value for quantity in known])
    u = values.std(axis=0, ddof=1) / len(known) ** 0.5
    if repeated:
        by_rows = np.sqrt(np.sum([np.square(quantity.u) for quantity in known], axis=0)) / len(known)
        dof = min(quantity.dof for quantity in known)
        return Quantity(as_number(values.mean(axis=0)), as_number(np.maximum(u, by_rows)), dof=dof)
    return Quantity(as_number(values.mean(axis=0)), as_number(u), dof=len(known) - 1)


def lens_mtf(edges: Sequence[EdgeSfr], pixel_pitch_m: float) -> tuple[tuple[float, float], ...]:
    """Return the MTF of the lens alone, as the key ``mtf`` of the optics in a chain file takes it.

    Parameters
    ----------
    edges : sequence of EdgeSfr
        At least one.
    pixel_pitch_m : float
        Distance of the pixels of the sensor in metres.

    Returns
    -------
    tuple of (float, float)
        Line pairs per mm on the sensor and modulation, from (0, 1) on, as many as linear interpolation between them
        needs. A pixel of the chain adds its square again.

    Raises
    ------
    InputError
        If there is no edge, or the pixel pitch is not above 0.

    Notes
    -----
    The mean over the edges of response over that of the pixels, up to where noise or the pixels' own response leave too
    little of it: where that is below 0.3, at 0.75 cycles/pixel, or the MTF below 0.05 or three times its noise.
    Beyond it continues as the Gaussian through its last point. Of a camera that sharpens it is above 1, up to 4.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.metrics import lens_mtf, sfr
    >>> distance = (np.arange(60) + 0.5 - 30) - 0.1 * (np.arange(80)[:, None] + 0.5 - 40)
    >>> table = lens_mtf([sfr(np.tanh(distance))], 3e-6)
    >>> table[0]
    (0.0, 1.0)
    """
    if not (isfinite(pixel_pitch_m) and pixel_pitch_m > 0):
        raise InputError(f"the pixel pitch is {pixel_pitch_m:g} m: give a length above 0, such as 3e-6")
    frequency, pixels = mean_sfr(edges).frequency, np.min([edge.pixel_response for edge in edges], axis=0)
    each = [edge.response.value / np.maximum(edge.pixel_response, _LEAST_PIXEL / 2) for edge in edges]
    modulation = np.mean(each, axis=0)
    # By noise: edges that differ over the field are none the less known.
    noise = np.sqrt(np.mean([edge.response.u**2 for edge in edges], axis=0) / len(edges))
    u = noise / np.maximum(pixels, _LEAST_PIXEL / 2)
    weak = (modulation < np.maximum(_LEAST_MODULATION, 3 * u)) | (pixels < _LEAST_PIXEL)
    last = max(int(np.argmax(weak)) - 1, 1)
    modulation = np.minimum(modulation, _MOST_MODULATION)
    fall = log(1 / min(modulation[last], 0.999)) / frequency[last] ** 2
    further = frequency[last] + frequency[1] * np.arange(1, _MOST_FURTHER)
    further = further[np.exp(-fall * further**2) > _NO_MODULATION]
    frequency = np.concatenate([frequency[: last + 1], further])
    values = np.concatenate([modulation[: last + 1], np.exp(-fall * further**2)])
    kept = _needed_points(frequency, values)
    lp_per_mm = 1e-3 * frequency / pixel_pitch_m
    return tuple((round(float(lp_per_mm[i]), 3), round(float(values[i]), 4)) for i in kept)


def _needed_points(x: _Array, y: _Array) -> list[int]:
    """Points from which linear interpolation gives all others, about."""
    kept = [0, len(x) - 1]
    while True:
        deviation = np.abs(np.interp(x, x[kept], y[kept]) - y)
        if deviation.max() <= _INTERPOLATED:
            return kept
        kept = sorted([*kept, int(np.argmax(deviation))])


def pixel_response(frequency: ArrayLike, angle_deg: float = 0.0) -> _Array:
    """Return the response of a square pixel, sensitive on all of it, across an edge.

    Parameters
    ----------
    frequency : array_like of float
        Spatial frequencies in cycles/pixel.
    angle_deg : float
        Angle between the edge and the sides of the pixel in degrees.

    Returns
    -------
    ndarray of float
        Of the shape of `frequency`: abs(sinc(f cos angle) sinc(f sin angle)), the transform of the square.

    Examples
    --------
    >>> from labcdp.metrics.slanted_edge import pixel_response
    >>> pixel_response([0.0, 0.5]).round(4).tolist()
    [1.0, 0.6366]
    """
    across, along = cos(radians(angle_deg)), sin(radians(angle_deg))
    cycles = np.asarray(frequency, dtype=np.float64)
    response: _Array = np.abs(np.sinc(cycles * across) * np.sinc(cycles * along))
    return response


def _value_response(
    frequency: _Array, angle_deg: float, direction: Direction, pixels: Mapping[tuple[int, int], float]
) -> _Array:
    """Response of a value that is the weighted mean of pixels, by row and column: of a pixel times that of places."""
    # Places of the pixels across the edge, in the direction of its normal.
    across, along = cos(radians(angle_deg)), sin(radians(angle_deg))
    x_y = (across, -along) if direction == "horizontal" else (-along, across)
    phases = [
        weight * np.exp(2j * pi * frequency * (column * x_y[0] + row * x_y[1]))
        for (row, column), weight in pixels.items()
    ]
    places = np.abs(np.sum(phases, axis=0)) / sum(pixels.values())
    response: _Array = pixel_response(frequency, angle_deg) * places
    return response


def _region(values: ArrayLike | LuminanceMap, roi: Roi | None) -> tuple[_Array, int, tuple[int, int]]:
    """Light of a region with nan beside it, image pixels for each of its pixels, and its first column and row."""
    if isinstance(values, LuminanceMap):
        step, region = values.step, None if roi is None else values.scaled(roi)
        light, invalid = np.asarray(values.luminance_cd_m2), values.invalid
    else:
        step, region, light = 1, roi, light_array(values, "the light")
        invalid = np.zeros(light.shape, dtype=np.uint8)
    if light.ndim != 2:
        raise InputError(f"the light has the shape {light.shape}: give rows of pixels")
    rows, columns = WHOLE if region is None else region.window((light.shape[0], light.shape[1]))
    part, flags = light[rows, columns].astype(np.float64), invalid[rows, columns]
    if min(part.shape) < FEWEST_ROWS:
        size = f"{step * part.shape[1]} x {step * part.shape[0]}"
        raise InputError(f"the region is {size} pixels: give at least {step * FEWEST_ROWS} on each side")
    inside = np.isfinite(part) if region is None else region.mask((light.shape[0], light.shape[1])) & np.isfinite(part)
    usable = inside & ((flags & Invalid.DEFECT) == 0)
    if not usable.any():
        raise InputError("no pixel has a value: give another region")
    if np.mean((flags[usable] & Invalid.SATURATED) > 0) > SATURATED_SHARE:
        raise InputError("pixels are saturated, which makes an edge seem sharper: shorten the exposure")
    return np.where(usable, part, nan), step, (columns.start or 0, rows.start or 0)


def _direction(light: _Array) -> Direction:
    """Direction in which the light changes more on the whole, which is that across the edge."""
    across_columns, across_rows = (abs(light_step(rows)) * len(rows) for rows in (light, light.T))
    return "horizontal" if across_columns >= across_rows else "vertical"


def _crossing(frequency: _Array, response: Quantity[_Array], level: float) -> Quantity:
    """First frequency at which a response is at a level; its interval is where that of the response holds the level.

    Of the response that is exact (E. C. Fieller, J. R. Statist. Soc. B 16, 1954), where a slope would not do. Where
    the response does not leave the level for certain, the frequency is not known.
    """
    ends = [_first_below(frequency, values, level) for values in (response.value, *response.interval)]
    value, low, high = ends if np.isfinite(ends).all() else (nan, nan, nan)
    return Quantity(value, (high - low) / (2 * response.k), dof=response.dof, ends=Interval(low, high))


def _first_below(frequency: _Array, response: _Array, level: float) -> float:
    """First frequency at which a response falls to a level, linear between frequencies; nan for none."""
    below = np.flatnonzero(response < level)
    if not below.size:
        return nan
    at = max(int(below[0]), 1)
    high, low = response[at - 1], response[at]
    return float(frequency[at] - (level - low) / (high - low) * (frequency[at] - frequency[at - 1]))
