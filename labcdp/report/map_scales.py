"""Scales of the drawn axes of a map."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..evaluate.map_axes import MapAxis
from .drawing import plain_numbers


def cell_edges(axis: MapAxis) -> NDArray[np.float64]:
    """Edges of the cells around the values of an axis, half way on its scale, shape (n + 1,).

    A cell ends at 0 where nothing can be below it, as with contrasts.
    """
    places = axis.scaled(axis.values)
    if places.size == 1:
        half = 0.5 * (abs(places[0]) or 1.0)
        edges = axis.unscaled(np.array([places[0] - half, places[0] + half]))
    else:
        middles = (places[1:] + places[:-1]) / 2
        outer = [2 * places[0] - middles[0]], [2 * places[-1] - middles[-1]]
        edges = axis.unscaled(np.concatenate((outer[0], middles, outer[1])))
    return np.maximum(edges, 0) if axis.never_negative else edges


def set_scale(axis: MapAxis, drawn: Any) -> None:
    """Make a drawn axis logarithmic if the map's is, with numbers at decades, on a short axis also between them."""
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

    if not axis.log:
        return
    drawn.axes.set(**{f"{drawn.axis_name}scale": "log"})
    low, high = sorted(drawn.get_view_interval())
    decades = np.log10(high / low)
    if decades <= 2.5:
        drawn.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades > 1 else (1.0, 2.0, 3.0, 5.0, 7.0)))
    if low < 1e-4 or high > 1e5:
        drawn.set_major_formatter(LogFormatterSciNotation())
        drawn.set_minor_formatter(NullFormatter())
    else:
        plain_numbers(drawn)
