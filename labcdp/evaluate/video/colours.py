"""Colours of two regions in the frames of a video."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.disk.journal import Row
from ...core.errors import InputError
from ...core.result import Finding
from ...core.roi import Roi
from ...core.table import Column, Table, values_of
from ...files.video.source import StoredPixels, VideoFrame
from ...report import drawing
from ...report.layout import ReportFigure
from ..colour.measure import SeenColours, separated
from ..colour.planes import frame_colours
from ..picture.converter import Converter
from .dataset import COLOUR_COLUMNS

if TYPE_CHECKING:
    from xarray import Dataset


def frame_separation(
    frame: VideoFrame, converter: Converter, rois: Sequence[Roi], epsilon: float
) -> tuple[Row, list[Finding]]:
    """Return the separation of the colours of two regions as values of a row, and what limits them.

    Raises
    ------
    InputError
        If the video is grey.
    """
    assert frame.pixels is not None
    seen, planes = _seen(frame.pixels, converter, rois)
    result, _ = separated(seen, planes, epsilon)
    row = {name: values[0] for name, values in values_of(COLOUR_COLUMNS, [result]).items()}
    named = ("colours-saturated", "colours-not-measured")
    return row, [finding for finding in result.findings if finding.code in named]


def _seen(pixels: StoredPixels, converter: Converter, rois: Sequence[Roi]) -> tuple[list[SeenColours], int]:
    """Return the colours of regions, and the number of planes."""
    if pixels.colours is not None:
        seen = []
        for roi in rois:
            values, saturated = pixels.colours(roi.window(pixels.shape))
            mask = roi.mask(pixels.shape)
            seen.append(SeenColours(roi.name, values[mask].astype(np.float64), mask, float(np.mean(saturated[mask]))))
        return seen, 3
    if pixels.frame.colour_filter is None:
        raise InputError("the video is grey: its regions have no colours to separate")
    colours = frame_colours(pixels.frame, converter.calibration)
    return [colours.region(roi) for roi in rois], len(colours.names)


_COLUMNS = (
    Column("quantity", "quantity"),
    Column("mean", "mean", "", "Over the frames that have a value.", 4),
    Column("lowest", "lowest", "", "In one of these frames.", 4),
    Column("lowest_frame", "in frame", "", "The first of them.", decimals=0),
    Column("n_evaluated", "frames", "", "Frames that have a value.", decimals=0),
)


def colours_table(dataset: Dataset) -> Table:
    """Return the separation of the colours over the frames."""
    rows: list[dict[str, Any]] = []
    for column in COLOUR_COLUMNS[::3]:
        values = dataset[column.name].values
        known = np.isfinite(values)
        row: dict[str, Any] = {"quantity": column.label, "n_evaluated": int(known.sum())}
        if known.any():
            lowest = int(np.nanargmin(values))
            row |= {
                "mean": float(values[known].mean()),
                "lowest": float(values[lowest]),
                "lowest_frame": int(dataset["frame"].values[lowest]),
            }
        rows.append(row)
    note = "The sheet of frames has the 95 % interval of each. The distance is in standard deviations of the pixels."
    return Table.of_items("colours", "Colour separation over the frames", _COLUMNS, rows, note)


def colours_figure(dataset: Dataset) -> ReportFigure:
    """Draw distance and share of pairs over time, with their 95 % intervals."""
    figure = drawing.new_figure(6.6, 4.4)
    distance, detected = figure.subplots(2, sharex=True)
    times = dataset["time_s"].values
    for plot, name, colour in (
        (distance, "colour_distance", drawing.BLUE),
        (detected, "colours_detected", drawing.VERMILLION),
    ):
        plot.plot(times, dataset[name].values, color=colour, linewidth=1.0)
        ends = [dataset[f"{name}_{end}"].values for end in ("low", "high")]
        plot.fill_between(times, *ends, color=colour, alpha=0.25, linewidth=0)
    drawing.finish(distance, "", "distance", "Distance of the colours")
    drawing.finish(detected, "time in s", "share", "Pairs of pixels that keep the difference of chromaticity")
    detected.set_ylim(-0.03, 1.03)
    return drawing.reported("colours", figure, "Separation of the colours over time, with 95 % intervals.")
