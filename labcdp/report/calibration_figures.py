"""The figures of a calibration's report: the fit, its residuals over luminance and image, the response."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import hypot
from typing import TYPE_CHECKING

import numpy as np

from .digits import Z_95, fixed, printable, shortened
from .drawing import BLUE, ORANGE, SMALL_SIZE, label, new_figure, plain_numbers, png
from .figures import ReportFigure
from .plots import deviation_rel, draw_line, draw_residuals

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..calibration import Calibration, PatchResidual

#: Names are written beside the points of up to so many patches.
_MOST_NAMES = 14


def calibration_figures(calibration: Calibration) -> list[ReportFigure]:
    """Draw the figures of a calibration: its fit, the response if it is not linear, and the residuals."""
    response = [] if calibration.response.kind == "linear" else [_response(calibration)]
    return [_fit(calibration), *response, _residuals(calibration)]


def _fit(calibration: Calibration) -> ReportFigure:
    rows = sorted(calibration.residuals, key=lambda row: row.reading_cd_m2)
    figure = new_figure(10.0, max(4.5, 1.6 + 0.24 * len(rows)), calibration.state.camera.simulated)
    line, residuals = figure.subplots(1, 2, width_ratios=(1.0, 1.05))
    draw_line(line, calibration, rows)
    _draw_held_out(line, calibration)
    draw_residuals(residuals, rows)
    worst = max(rows, key=lambda row: abs(row.residual_rel))
    signal = "Signal" if calibration.response.kind == "linear" else "Linearised signal"
    return ReportFigure(
        "calibration-fit.png",
        png(figure),
        f"Left: {signal.lower()} above dark over the luminance by the meter, with the fitted line. Right: what the "
        "line leaves over. The bars hold 95 % by all stated errors that differ between patches; the meter's scale "
        "error is common to all patches and not in them.",
        f"Fit over {len(rows)} patches; the largest residual is {fixed(100 * worst.residual_rel, 2, sign=True)} % at "
        f"patch {printable(worst.patch)}.",
    )


def _draw_held_out(axes: Axes, calibration: Calibration) -> None:
    if not calibration.held_out:
        return
    r = calibration.responsivity.responsivity_dn_s_cd_m2
    axes.plot(
        [row.reading_cd_m2 for row in calibration.held_out],
        [r * row.luminance_cd_m2 for row in calibration.held_out],
        "s",
        markersize=6,
        color=ORANGE,
        label="held out",
    )
    axes.legend(fontsize=SMALL_SIZE, loc="upper left")


def _response(calibration: Calibration) -> ReportFigure:
    low, high = calibration.range_net_dn
    net = np.linspace(0, 1.1 * high, 400)[1:]
    bend = 100 * (calibration.response.linearise(net) / net - 1)
    figure = new_figure(7.0, 3.6, calibration.state.camera.simulated)
    axes = figure.add_subplot()
    inside = (net >= low) & (net <= high)
    axes.plot(net, bend, color="0.7", linestyle="--", linewidth=1.2, label="beyond the calibrated signals")
    axes.plot(net[inside], bend[inside], color=BLUE, linewidth=1.8, label="calibrated")
    knots = np.array([n for n in calibration.response.net_dn if n > 0])
    if calibration.response.kind == "pchip" and knots.size:
        axes.plot(knots, 100 * (calibration.response.linearise(knots) / knots - 1), "o", color=BLUE, label="knots")
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.grid(color="0.9")
    axes.legend(fontsize=SMALL_SIZE)
    label(axes, "signal above dark in DN", "correction in %", "Linearised over measured signal, less one")
    return ReportFigure(
        "calibration-response.png",
        png(figure),
        "What the camera's response departs from a straight line: a signal is multiplied by 1 plus this.",
        f"Correction of the response, {fixed(float(bend[-1]), 2, sign=True)} % at the highest signal.",
    )


def _residuals(calibration: Calibration) -> ReportFigure:
    height, width = calibration.state.image_shape
    places: list[tuple[str, Callable[[PatchResidual], float]]] = [
        ("luminance by the meter in cd/m²", lambda row: row.reading_cd_m2),
        ("x in pixels", lambda row: row.centre_px[0]),
        ("y in pixels", lambda row: row.centre_px[1]),
        (
            "distance from the middle of the image in pixels",
            lambda row: hypot(row.centre_px[0] - width / 2, row.centre_px[1] - height / 2),
        ),
    ]
    figure = new_figure(10.0, 6.4, calibration.state.camera.simulated)
    panels = figure.subplots(2, 2, sharey=True).ravel()
    for axes, (name, place) in zip(panels, places, strict=True):
        _draw_over(axes, calibration.residuals, place, "black", "white", "fit")
        _draw_over(axes, calibration.held_out, place, ORANGE, ORANGE, "held out")
        label(axes, name, "camera over meter, less one, in %", "")
    panels[0].set_xscale("log")
    plain_numbers(panels[0].xaxis)
    panels[1].set_xlim(0, width)
    panels[2].set_xlim(0, height)
    panels[3].set_xlim(0, hypot(height, width) / 2)
    if calibration.held_out:
        panels[0].legend(fontsize=SMALL_SIZE)
    if len(calibration.residuals) + len(calibration.held_out) <= _MOST_NAMES:
        for row in (*calibration.residuals, *calibration.held_out):
            panels[0].annotate(
                shortened(row.patch, 14),
                (row.reading_cd_m2, 100 * row.residual_rel),
                xytext=(4, 4),
                textcoords="offset points",
                fontsize=7,
                parse_math=False,
            )
    return ReportFigure(
        "calibration-residuals.png",
        png(figure),
        "Residuals over luminance and over the place of the patches in the image, with 95 % bars. A trend over "
        "luminance points to glare, a wrong darkness or a bent response; one over the place to the fall-off of the "
        "lens or to uneven light.",
        f"Residuals of {len(calibration.residuals)} patches over luminance, x, y and distance from the middle.",
    )


def _draw_over(
    axes: Axes,
    rows: Sequence[PatchResidual],
    place: Callable[[PatchResidual], float],
    colour: str,
    face: str,
    name: str,
) -> None:
    axes.axhline(0.0, color=BLUE, linewidth=1.2)
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    if rows:
        axes.errorbar(
            [place(row) for row in rows],
            [100 * row.residual_rel for row in rows],
            yerr=[100 * Z_95 * deviation_rel(row) for row in rows],
            fmt="o",
            markersize=5,
            color=colour,
            markerfacecolor=face,
            capsize=2.5,
            elinewidth=1.0,
            label=name,
        )
