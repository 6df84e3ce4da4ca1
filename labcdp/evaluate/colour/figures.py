"""The figure of colour separation: the pixels of both regions, with their ellipses."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, isfinite

import numpy as np
from numpy.typing import NDArray

from ...core.result import Result
from ...report import drawing
from ...report.layout import Card, ReportFigure, Section
from ...report.text import fixed, shortened, significant
from .measure import PairColours

#: Pairs that are drawn, and in a row.
_MOST_PAIRS, _COLUMNS = 6, 2
#: Root of the 95 % quantile of chi-squared with two degrees of freedom.
ELLIPSE_95 = 2.4477468306808161
_LONGEST_NAME = 24


def ellipse(mean: NDArray[np.float64], covariance: NDArray[np.float64], points: int = 181) -> NDArray[np.float64]:
    """Return the outline of the ellipse that 95 % of a normal distribution lie in, shape (points, 2)."""
    sizes, directions = np.linalg.eigh(covariance)
    angle = np.linspace(0, 2 * np.pi, points)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * np.sqrt(np.maximum(sizes, 0))
    outline: NDArray[np.float64] = mean + ELLIPSE_95 * circle @ directions.T
    return outline


def colour_figure(pairs: Sequence[PairColours]) -> ReportFigure:
    """Draw the pixels of the first pairs of regions with their 95 % ellipses."""
    drawn = pairs[:_MOST_PAIRS]
    columns = min(_COLUMNS, len(drawn))
    rows = ceil(len(drawn) / columns)
    figure = drawing.new_figure(3.5 * columns + 0.6, 3.3 * rows)
    plots = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for plot, pair in zip(plots, drawn, strict=False):
        clouds = ((pair.first, drawing.BLUE, "o"), (pair.second, drawing.VERMILLION, "^"))
        for cloud, colour, marker in clouds:
            name = shortened(cloud.name, _LONGEST_NAME)
            plot.plot(*cloud.points.T, marker, color=colour, markersize=1.6, alpha=0.35, linestyle="none")
            plot.plot(*ellipse(cloud.mean, cloud.covariance).T, color=colour, linewidth=1.3, label=name)
            plot.plot(*cloud.mean, "+", color="black", markersize=7)
        drawing.finish(plot, *pair.axes, shortened(pair.name, 2 * _LONGEST_NAME))
    for plot in plots[len(drawn) :]:
        plot.set_axis_off()
    text = "Pixels of both regions, their means, and the ellipses that 95 % of normal pixels lie in."
    return drawing.reported("colours", figure, text)


def colour_cards(pairs: Sequence[PairColours]) -> list[Card]:
    """Make a card for each of the first pairs."""
    cards = []
    for pair in pairs[:_MOST_PAIRS]:
        separation = pair.separation
        if not isfinite(separation.distance.value):
            cards.append(Card(f"Colours, {pair.name}", "saturated" if pair.saturated else "not compared"))
            continue
        low, high = separation.csp.interval
        nearest, farthest = (significant(end, 3) for end in separation.distance.interval)
        ends = separation.detected.interval
        lines = (
            f"distance {significant(separation.distance.value, 3)} ({nearest} to {farthest})",
            f"pairs detected {fixed(separation.detected.value, 3)} ({fixed(ends.low, 3)} to {fixed(ends.high, 3)})",
        )
        detail = f"CSP, 95 %: {fixed(low, 4)} to {fixed(high, 4)}"
        cards.append(Card(f"Colours, {pair.name}", fixed(separation.csp.value, 4), detail, lines))
    return cards


def colour_section(pairs: Sequence[PairColours], result: Result) -> Section:
    """Return the section of a page with the figure and table of the colours of pairs."""
    return Section("Colours", [colour_figure(pairs), *result.tables_named("colour_separation")])
