"""A video as a spreadsheet: a column a frame as in the 2018 thesis, a row a frame and contrast, and a summary."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .digits import printable
from .long_workbook import (
    MOST_COLUMNS,
    MOST_ROWS,
    LongCell,
    LongSheet,
    continued,
    pieces,
    write_long_workbook,
)
from .video_summary import VideoSummary, notes_of, summarise, times_s
from .video_wording import configuration, provenance, summary_facts, title, unit_text
from .workbook import Cell, Number, Sheet

if TYPE_CHECKING:
    from xarray import Dataset

#: Heads and decimals of the numbers of a frame and contrast, by variable; contrasts are shown in percent.
_OF_CONTRAST = {
    "cdp": ("CDP", 4),
    "cdp_standard_uncertainty": ("standard uncertainty of CDP", 4),
    "cdp_low": ("CDP, low end of 95 %", 4),
    "cdp_high": ("CDP, high end of 95 %", 4),
    "below": ("share below", 4),
    "above": ("share above", 4),
}
_OF_FRAME = {
    "measured_contrast": ("measured contrast in %", 2),
    "measured_contrast_standard_uncertainty": ("standard uncertainty of measured contrast in %", 2),
    "csnr": ("CSNR", 2),
    "csnr_standard_uncertainty": ("standard uncertainty of CSNR", 3),
    "reference_contrast": ("reference contrast in %", 2),
    "reference_cdp": ("CDP of reference contrast", 4),
    "reference_cdp_low": ("CDP of reference contrast, low end of 95 %", 4),
    "reference_cdp_high": ("CDP of reference contrast, high end of 95 %", 4),
}
_IN_PERCENT = ("measured_contrast", "measured_contrast_standard_uncertainty", "reference_contrast")

#: The same of a region; {unit} is that of the video.
_OF_REGION = {
    "mean": ("mean in {unit}", 4),
    "mean_standard_uncertainty": ("standard uncertainty of mean in {unit}", 5),
    "snr": ("SNR (mean / standard deviation)", 2),
    "snr_standard_uncertainty": ("standard uncertainty of SNR", 3),
    "saturated": ("share saturated", 4),
    "quality": ("quality of following", 3),
    "lost": ("lost (1) or not (0)", 0),
    "centre_x": ("centre x in pixels", 2),
    "centre_y": ("centre y in pixels", 2),
}

#: Rows of frames made at once.
_FRAMES_AT_ONCE = 500

Column = tuple[str, Cell, NDArray[Any] | list[str]]


def write_video_spreadsheet(dataset: Dataset, path: Path, time: datetime) -> None:
    """Write a video as an Office Open XML workbook; equal arguments give equal bytes.

    The first sheet has the contrasts in its first column and then a column a frame; what exceeds the columns of a
    sheet goes on in a further one, and so do the rows of the tidy sheet. The memory it takes does not grow with the
    video.

    Parameters
    ----------
    dataset : xarray.Dataset
        Results of a video.
    path : Path
        Written as it goes: give a temporary name and rename.
    time : datetime
        Time of the content, with time zone, for the file's properties.

    Raises
    ------
    InputError
        If the dataset is no result of a video.
    OSError
        If the file cannot be written.
    """
    summary = summarise(dataset)
    frames, rows = _frame_sheets(dataset), _row_sheets(dataset)
    sheets: list[LongSheet | Sheet] = [*frames, *rows, _summary(dataset, summary, len(frames), len(rows))]
    write_long_workbook(path, sheets, title(dataset), time)


def _frame_sheets(dataset: Dataset) -> list[LongSheet]:
    """CDP of each contrast, a column a frame."""
    numbers = dataset["frame"].values.tolist()
    percents = _percents(dataset["contrast"].values)
    ranges = pieces(len(numbers), MOST_COLUMNS)
    return [
        LongSheet(
            continued("CDP", place, len(ranges)),
            ["Contrasts in %", *(f"Frame number {numbers[column]}" for column in columns)],
            [Number(max(percents), 2), Number(1.0, 4)],
            _cdp_rows(dataset, percents, columns),
            len(percents),
            matrix=True,
        )
        for place, columns in enumerate(ranges, start=1)
    ]


def _cdp_rows(dataset: Dataset, percents: Sequence[float], columns: range) -> Iterator[list[LongCell]]:
    cdp = dataset["cdp"].values[columns.start : columns.stop]
    for number, percent in enumerate(percents):
        yield [percent, *cdp[:, number].tolist()]


def _row_sheets(dataset: Dataset) -> list[LongSheet]:
    """All numbers, a row for each frame and contrast; the contrast changes fastest."""
    n_contrasts = dataset.sizes["contrast"]
    columns = _columns(dataset)
    ranges = pieces(dataset.sizes["frame"], MOST_ROWS // n_contrasts)
    return [
        LongSheet(
            continued("Frames", place, len(ranges)),
            [head for head, _, _ in columns],
            [pattern for _, pattern, _ in columns],
            _tidy_rows(columns, frames, n_contrasts),
            len(frames) * n_contrasts,
        )
        for place, frames in enumerate(ranges, start=1)
    ]


def _columns(dataset: Dataset) -> list[Column]:
    """Heads, patterns and values of the columns; values have one axis, or the second one of contrasts."""
    frames, n_contrasts = dataset["frame"].values, dataset.sizes["contrast"]
    percents = np.broadcast_to(_percents(dataset["contrast"].values), (len(frames), n_contrasts))
    columns: list[Column] = [
        ("frame", Number(float(frames[-1]), 0), frames),
        ("time in s", Number(1e4, 3), times_s(dataset)),
        ("contrast in %", Number(1e3, 2), percents),
    ]
    for name, (head, n_decimals) in _OF_CONTRAST.items():
        columns.append((head, Number(1.0, n_decimals), dataset[name].values))
    for name, (head, n_decimals) in _OF_FRAME.items():
        if name in dataset:
            values = dataset[name].values * (100 if name in _IN_PERCENT else 1)
            columns.append((head, Number(1e3 if name in _IN_PERCENT else 1.0, n_decimals), values))
    for number in range(dataset.sizes.get("region", 0)):
        columns += _region_columns(dataset.isel(region=number), unit_text(dataset))
    notes = notes_of(dataset)
    columns.append(("note", max(notes, key=len), notes))
    return columns


def _region_columns(one: Dataset, unit: str) -> list[Column]:
    name = printable(str(one["region"].values))
    columns: list[Column] = [
        (f"{name}: {head.format(unit=unit)}", Number(1e3, n_decimals), np.asarray(one[variable].values, dtype=float))
        for variable, (head, n_decimals) in _OF_REGION.items()
        if variable in one
    ]
    for corner in range(one.sizes.get("corner", 0)):
        for axis in "xy":
            values = one[f"corner_{axis}"].values[:, corner]
            columns.append((f"{name}: corner {corner + 1} {axis} in pixels", Number(1e3, 2), values))
    return columns


def _tidy_rows(columns: Sequence[Column], frames: range, n_contrasts: int) -> Iterator[tuple[LongCell, ...]]:
    for start in range(frames.start, frames.stop, _FRAMES_AT_ONCE):
        part = slice(start, min(start + _FRAMES_AT_ONCE, frames.stop))
        yield from zip(*(_repeated(values[part], n_contrasts) for _, _, values in columns), strict=True)


def _repeated(values: NDArray[Any] | list[str], n_contrasts: int) -> list[LongCell]:
    """Values of a column for some frames: as they are by contrast, or each for all contrasts."""
    if isinstance(values, list):
        return [value for value in values for _ in range(n_contrasts)]
    each: list[LongCell] = (values.ravel() if values.ndim == 2 else np.repeat(values, n_contrasts)).tolist()
    return each


def _percents(contrasts: NDArray[np.float64]) -> list[float]:
    """Contrasts in percent, without the traces of the binary numbers: 0.07 is 7, not 7.000000000000001."""
    return [float(f"{100 * contrast:.12g}") for contrast in contrasts.tolist()]


def _summary(dataset: Dataset, summary: VideoSummary, n_frame_sheets: int, n_row_sheets: int) -> Sheet:
    rows = [(fact.name, fact.value) for fact in (*summary_facts(dataset, summary), *provenance(dataset))]
    rows += [("Setting", line) for line in configuration(dataset).splitlines()]
    for name, number, most in (("CDP", n_frame_sheets, "16384 columns"), ("Frames", n_row_sheets, "1048576 rows")):
        if number > 1:
            rows.append((f"Sheet {name}", f"goes on over {number} sheets, as one sheet has {most} at the most"))
    return Sheet("Summary", ("What", "Value"), rows)
