"""Figures that are plots: the fit of the responsivity, and the distribution of contrasts."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from ..calibration import Calibration, expanded_half_width
from .digits import Z_95, cdp_decimals, cdp_interval, fixed, percent, share_percent, shortened, with_half_width
from .drawing import (
    BLUE,
    GREEN,
    ORANGE,
    SMALL_SIZE,
    label,
    mark_simulated,
    new_figure,
    plain_numbers,
    png,
)
from .tables import contrast_with_half_width, pair_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..calibration import PatchResidual
    from ..contrast import ContrastDistribution, DetectionResult
    from ..evaluate import ContrastRow, SessionEvaluation


#: Contrasts are drawn up to so many times the upper end of the interval, at least and at most, and between them up to
#: this share of the pairs: a dark pixel close to 0 makes contrasts of any size, beside which the interval would be a
#: line.
_LEAST_TIMES, _MOST_TIMES, _DRAWN_SHARE = 4, 10, 0.9

#: Share of pairs beyond the drawn contrasts, from which on the figure tells it.
_TOLD_SHARE = 0.001


def fit_figure(evaluation: SessionEvaluation) -> bytes:
    """Draw signal over luminance by the meter with the fitted line (of no colour filters), and residuals, as PNG."""
    calibration = evaluation.calibration
    rows = sorted(calibration.residuals, key=lambda row: row.reading_cd_m2)
    figure = new_figure(10.0, max(4.5, 1.6 + 0.24 * len(rows)), bool(evaluation.simulated))
    if not isinstance(calibration, Calibration):
        draw_residuals(figure.add_subplot(), rows)
        return png(figure)
    line, residuals = figure.subplots(1, 2, width_ratios=(1.0, 1.05))
    draw_line(line, calibration, rows)
    draw_residuals(residuals, rows)
    return png(figure)


def draw_line(axes: Axes, calibration: Calibration, rows: list[PatchResidual]) -> None:
    """Draw signal over luminance with the model; `rows` by rising luminance."""
    r = calibration.responsivity.responsivity_dn_s_cd_m2
    half_width = r * expanded_half_width(calibration.meter_scale.half_width_rel, calibration.responsivity.random_rel)
    readings = np.array([row.reading_cd_m2 for row in rows])
    ends = np.array([readings[0] / 1.5, readings[-1] * 1.5])
    axes.plot(ends, r * ends, color=BLUE, linewidth=1.5, label="fitted line through zero")
    rates = [r * row.luminance_cd_m2 for row in rows]
    axes.plot(readings, rates, "o", markersize=5, color="black", markerfacecolor="none", label="patches")
    axes.set_xscale("log")
    axes.set_yscale("log")
    plain_numbers(axes.xaxis)
    axes.grid(color="0.9")
    axes.legend(fontsize=SMALL_SIZE, loc="upper left")
    title = f"Responsivity {with_half_width(r, half_width)} DN s⁻¹ / (cd m⁻²)"
    signal = "signal" if calibration.response.kind == "linear" else "linearised signal"
    label(axes, "luminance by the meter in cd/m²", f"{signal} by the camera in DN/s", title)


def draw_residuals(axes: Axes, rows: list[PatchResidual]) -> None:
    """Draw residuals with 95 % bars, the last of the rows on top."""
    places = np.arange(len(rows))
    half_widths = [100 * Z_95 * deviation_rel(row) for row in rows]
    axes.axvline(0.0, color=BLUE, linewidth=1.5)
    axes.errorbar(
        [100 * row.residual_rel for row in rows],
        places,
        xerr=half_widths,
        fmt="o",
        markersize=5,
        color="black",
        markerfacecolor="white",
        capsize=2.5,
        elinewidth=1.0,
    )
    axes.grid(axis="x", color="0.9")
    axes.set_axisbelow(True)
    axes.set_ylim(-0.7, len(rows) - 0.3)
    axes.margins(x=0.08)
    label(axes, "residual in %, with 95 % bars", "", "Camera over meter, less one; brightest patch on top")
    axes.set_yticks(places, [shortened(row.patch, 24) for row in rows], fontsize=SMALL_SIZE, parse_math=False)


def deviation_rel(row: PatchResidual) -> float:
    """Return the residual's standard deviation by the stated errors, relative to the reading."""
    if row.standardised_residual != 0:
        return abs(row.residual_rel / row.standardised_residual)
    return row.reading_random_cd_m2 / row.reading_cd_m2


def contrast_figure(row: ContrastRow, simulated: bool) -> bytes:
    """Draw the contrasts of all pairs of pixels of two patches, with the one by the meter, as PNG."""
    measured = contrast_with_half_width(row.measured_contrast, row.measured_standard_uncertainty)
    return contrasts_figure(
        row.distribution,
        row.cdp,
        shortened(pair_name(row), 60),
        "bench" if simulated else "",
        (row.measured_contrast, f"by the meter: {measured} %"),
    )


def contrasts_figure(
    distribution: ContrastDistribution,
    result: DetectionResult,
    title: str,
    simulated: str = "",
    reference: tuple[float, str] | None = None,
) -> bytes:
    """Draw cumulative probability and density of the contrasts of all pairs of pixels, as PNG.

    As the 2018 thesis draws its distributions: a blue line, and grey bars scaled to a largest one of 1. Contrasts far
    above the interval and those of most pairs are not drawn; the legend tells how many there are.

    Parameters
    ----------
    distribution : ContrastDistribution
        The contrasts.
    result : CdpResult or NeighbourCdp
        CDP of the same pixels.
    title : str
        First line above the plot; the second is the CDP.
    simulated : str
        What the picture says is simulated: "bench" or "chain"; empty for a measurement.
    reference : (float, str), optional
        Another contrast to mark, and its text in the legend.
    """
    figure = new_figure(8.0, 4.8, simulated=False)
    if simulated:
        mark_simulated(figure, simulated)
    axes = figure.add_subplot()
    edges = 100 * distribution.edges
    share = np.diff(distribution.cumulative)
    density = share / share.max() if share.any() else share
    axes.plot(edges, distribution.cumulative, color=BLUE, linewidth=1.8, label="cumulative probability")
    axes.stairs(density, edges, fill=True, color="0.6", label="density, scaled to 1")
    low, high = result.interval
    detected = f"detected: {percent(low)} to {percent(high)}"
    axes.axvspan(100 * low, 100 * high, color=ORANGE, alpha=0.25, linewidth=0, zorder=0, label=detected)
    asked = percent(result.contrast)
    axes.axvline(100 * result.contrast, color="black", linestyle="--", label=f"asked for: {asked}")
    if reference is not None:
        axes.axvline(100 * reference[0], color=GREEN, linestyle="-.", label=reference[1])
    axes.set_ylim(0.0, 1.05)
    start, stop, beyond = _drawn_contrasts(distribution, result)
    axes.set_xlim(100 * start, 100 * stop)
    if beyond >= _TOLD_SHARE:
        axes.plot(
            [], [], linestyle="none", label=f"above {fixed(100 * stop, 1)} %: {share_percent(beyond)} of the pairs"
        )
    cdp = f"CDP {fixed(result.cdp, cdp_decimals(result))}"
    if isfinite(result.standard_error):
        cdp += f" (95 %: {cdp_interval(result)})"
    label(axes, "Weber contrast in %", "probability", f"{title}\n{cdp}")
    figure.legend(loc="outside lower center", ncols=3, fontsize=SMALL_SIZE)
    return png(figure)


def _drawn_contrasts(distribution: ContrastDistribution, result: DetectionResult) -> tuple[float, float, float]:
    """Lowest and highest contrast that are drawn, and the share of pairs above the latter."""
    low, high = result.interval
    edges, cumulative = distribution.edges, distribution.cumulative
    bulk = edges[min(int(np.searchsorted(cumulative, _DRAWN_SHARE)), edges.size - 1)]
    wanted = min(max(_LEAST_TIMES * high, bulk), _MOST_TIMES * high)
    # An edge, at which the share is known.
    last = min(int(np.searchsorted(edges, wanted)), edges.size - 1)
    margin = 0.1 * (high - low)
    return min(float(edges[0]), low - margin), max(float(edges[last]), high + margin), float(1 - cumulative[last])
