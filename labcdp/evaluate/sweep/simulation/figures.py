"""The figures and pictures of a simulated chain."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ....metrics import Distribution, contrast_histogram
from ....metrics.contrast import each_contrast
from ....report import drawing
from ....report.layout import ReportFigure
from ....report.plots import ContrastPanel, stage_figure
from ....report.text import percent, printable, shortened, span
from ..maps.axes import LARGEST_SNR
from ..maps.view import COLOURS
from .evaluation import distributions, pixels_behind
from .rows import PairRow, SimulationEvaluation, StageRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Values of a distribution that a plot shows; those of a result are reduced to it to save memory.
_MOST_VALUES = 4096

#: A picture of a stage is enlarged, by repeating pixels, to at least this many pixels.
_PICTURE_SIDE = 600

_Points = Sequence[tuple[StageRow, PairRow]]


def along_figures(evaluation: SimulationEvaluation) -> list[ReportFigure]:
    """Draw CDP at each contrast and SNR along the chain, for each sensor and each pair of regions."""
    targets, figures, branches = each_contrast(evaluation.contrast), [], evaluation.run.chain.branches
    for branch, names in branches.items():
        key = f"{file_name(branch)}-" if len(branches) > 1 else ""
        stages = [stage for stage in evaluation.stages if stage.name in names]
        for number, first in enumerate(range(0, len(stages[0].pairs), len(targets)), start=1):
            lines = [[(stage, stage.pairs[first + index]) for stage in stages] for index in range(len(targets))]
            row = stages[0].pairs[first]
            pair, kind = pair_name(row), "region to region" if row.neighbours is None else "nearest-neighbour"
            figures.append(
                ReportFigure(
                    f"chain-{key}{number}.png",
                    _along(dict(zip(targets, lines, strict=True))),
                    f"CDP along the chain, {pair}, {kind}, with 95 % intervals; SNR of {row.bright}, of the values "
                    "(also in dB, 10 lg) and of the luminance they stand for.",
                    f"CDP and SNR after each stage, {pair}.",
                )
            )
    return figures


def contrast_panels(evaluation: SimulationEvaluation) -> list[ContrastPanel]:
    """Return the contrasts of each pair behind the last stage of each sensor."""
    run = evaluation.run
    panels: list[ContrastPanel] = []
    for stage in evaluation.stages:
        if stage.name not in run.chain.final_stages:
            continue
        seen = distributions(pixels_behind(run[stage.name])[1], run.chain.scene.regions())
        for row in stage.pairs:
            if row.cdp is None:
                continue
            contrasts = contrast_histogram(seen[row.bright], seen[row.dark], row.cdp.detected_range.high)
            at = f" at {percent(row.cdp.contrast, 4)}" if isinstance(evaluation.contrast, tuple) else ""
            title = f"{pair_name(row)}{at}, after {printable(stage.name)}"
            panels += [] if contrasts is None else [ContrastPanel(title, contrasts, row.cdp)]
    return panels


def stage_figures(evaluation: SimulationEvaluation) -> list[ReportFigure]:
    """Draw the distribution of the values behind each stage."""
    return [
        ReportFigure(
            f"stage-{file_name(name)}.png",
            stage_figure(
                name, shown_distribution(values), f"{signal.quantity} in {signal.unit}", shown_distribution(luminance)
            ),
            f"{printable(name)}: cumulative probability (blue) and density (grey, scaled to 1) of the values of "
            "the whole frame, and of the luminance they stand for.",
            f"Distribution of the values after {printable(name)}.",
        )
        for name, signal in evaluation.run.items()
        for values, luminance, _ in (pixels_behind(signal),)
    ]


def shown_distribution(values: NDArray[Any]) -> Distribution:
    """Return the distribution of an image's values for a plot, of floats in at most 4096 bins at their own mean.

    Parameters
    ----------
    values : ndarray, shape (height, width)
        Integers or finite floats.
    """
    low, high = float(values.min()), float(values.max())
    if values.dtype.kind in "iu" or high <= low:
        return Distribution.from_array(values)
    counts, sums = np.zeros(_MOST_VALUES), np.zeros(_MOST_VALUES)
    for row in values:
        bins = ((row - low) * (_MOST_VALUES * (1 - 1e-6) / (high - low))).astype(np.intp)
        counts += np.bincount(bins, minlength=_MOST_VALUES)
        sums += np.bincount(bins, weights=row, minlength=_MOST_VALUES)
    hit = counts > 0
    return Distribution(sums[hit] / counts[hit], counts[hit].astype(np.int64))


def shown_picture(name: str, values: NDArray[Any]) -> ReportFigure:
    """Return the picture of a stage for the page, a large one with fewer pixels."""
    side = drawing.reduction((values.shape[0], values.shape[1]))
    low, high = float(values.min()), float(values.max())
    reduced = f"; {side} x {side} pixels are drawn as one" if side > 1 else ""
    return ReportFigure(
        f"{file_name(name)}.png",
        picture(values if side == 1 else drawing.block_mean(values, side)),
        f"{printable(name)}: {span(f'{low:.4g}', f'{high:.4g}')}{reduced}",
        f"Grey picture after {printable(name)}.",
    )


def picture(values: NDArray[Any]) -> bytes:
    """Draw the values of a stage as a grey PNG, from the lowest to the highest; equal ones as white, unless 0."""
    import cv2

    low, high = float(values.min()), float(values.max())
    grey = np.full(values.shape, 255 if low > 0 else 0, np.uint8)
    if high > low:
        grey = np.rint((values - low) * (255 / (high - low))).astype(np.uint8)
    times = max(1, _PICTURE_SIDE // max(grey.shape))
    enlarged = np.repeat(np.repeat(grey, times, axis=0), times, axis=1)
    done, data = cv2.imencode(".png", enlarged)
    assert done
    return data.tobytes()


def file_name(stage: str) -> str:
    """Return the name of a stage as part of a file's name."""
    return re.sub(r"[^\w.]+", "-", stage).strip("-")


def pair_name(row: PairRow) -> str:
    """Return "bright / dark"."""
    return printable(f"{row.bright} / {row.dark}")


def _along(lines: Mapping[float | None, _Points]) -> bytes:
    """Draw CDP at each contrast with its intervals, below it the SNR of the bright region, from stage to stage."""
    points = next(iter(lines.values()))
    names = [shortened(stage.name, 24) for stage, _ in points]
    figure = drawing.new_figure(max(6.0, 2.0 + 1.1 * len(names)), 6.4, "chain")
    above, below = figure.subplots(2, 1, sharex=True)
    if len(lines) == 1:
        _draw_cdp(above, points, drawing.BLUE)
    for colour, target in zip(COLOURS, list(lines)[:: ceil(len(lines) / len(COLOURS))], strict=False):
        if len(lines) > 1 and target is not None:
            _draw_cdp(above, lines[target], colour, f"{percent(target, 4)}")
    bright = [next(row for row in stage.regions if row.region == pair.bright) for stage, pair in points]
    texts = [f"{row.snr_10log10_db.value:.1f} dB" for row in bright]
    values, luminance = (np.array([getattr(row, name).value for row in bright]) for name in ("snr", "luminance_snr"))
    _draw_snr(below, values, luminance, texts)
    slanted = max(map(len, names)) > 11
    below.set_xticks(
        range(len(names)), names, rotation=30 if slanted else 0, ha="right" if slanted else "center", parse_math=False
    )
    below.set_xlim(-0.5, len(names) - 0.5)
    drawing.add_legend(figure, *below.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    for panel in (above, below):
        panel.grid(color="0.9")
        panel.set_axisbelow(True)
    return drawing.png(figure)


def _draw_cdp(axes: Axes, points: _Points, colour: str, text: str = "") -> None:
    """Draw CDP with its intervals, as text or with a name in the legend."""
    indexed = [
        (index, pair.cdp if pair.neighbours is None else pair.neighbours) for index, (_, pair) in enumerate(points)
    ]
    known = [(index, cdp.cdp, *cdp.interval) for index, cdp in indexed if cdp is not None]
    if known:
        places, cdp, low, high = np.array(known).T
        axes.plot(places, cdp, "o-", color=colour, linewidth=1.5, markersize=5, label=text or None)
        # A bar cannot have a negative length, which an interval by another method than the point's may ask for.
        bars = np.clip(np.nan_to_num([cdp - low, high - cdp]), 0, None)
        axes.errorbar(places, cdp, yerr=bars, fmt="none", ecolor="black", capsize=3, elinewidth=1.0)
        for x, value, top in () if text else zip(places, cdp, cdp + bars[1], strict=True):
            _write_above(axes, x, top, f"{value:.3f}")
    axes.set_ylim(-0.05, 1.2)
    axes.set_yticks(np.linspace(0, 1, 6))
    drawing.label(axes, "", "CDP", "CDP after each stage, with 95 % intervals")
    if text:
        drawing.add_legend(axes, title="target contrast", loc="upper left", bbox_to_anchor=(1, 1))


def _draw_snr(axes: Axes, values: NDArray[np.float64], luminance: NDArray[np.float64], texts: Sequence[str]) -> None:
    """Draw two SNR; without noise but that of rounding they are arrows above all others."""
    from matplotlib.ticker import LogLocator

    both = np.concatenate((values, luminance))
    finite = both[(both > 0) & (both <= LARGEST_SNR)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (1.0, 1.0)
    top = high * max((high / low) ** 0.25, 1.5)
    axes.set_yscale("log")
    # The luminance on top, in smaller marks, so that both show where they are equal.
    for ratio, style, colour, size, text in (
        (values, "o-", drawing.BLUE, 7, "SNR of the values"),
        (luminance, "s--", drawing.GREEN, 4, "SNR of the luminance in cd/m²"),
    ):
        places, drawn, endless = np.arange(ratio.size), (ratio > 0) & (ratio <= LARGEST_SNR), ratio > LARGEST_SNR
        axes.plot(places[drawn], ratio[drawn], style, color=colour, linewidth=1.5, markersize=size, label=text)
        axes.plot(places[endless], np.full(endless.sum(), top), "^", color=colour, markersize=size)
    axes.set_ylim(low / max((high / low) ** 0.15, 1.3), top * max((high / low) ** 0.15, 1.3))
    drawing.plain_numbers(axes.yaxis)
    if finite.size:
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    else:
        axes.set_yticks([])
    for index in np.flatnonzero(values > 0).tolist():
        shown = values[index] <= LARGEST_SNR
        _write_above(axes, index, values[index] if shown else top, texts[index] if shown else "∞")
    drawing.label(axes, "", "SNR (mean/std)", "SNR after each stage")


def _write_above(axes: Axes, x: float, y: float, text: str) -> None:
    """Write a value above its point, readable across a line."""
    from matplotlib.patheffects import withStroke

    axes.annotate(
        text,
        (x, y),
        xytext=(0, 7),
        textcoords="offset points",
        horizontalalignment="center",
        fontsize=drawing.SMALL_SIZE,
        path_effects=[withStroke(linewidth=3, foreground="white")],
    )
