"""Tables, figures, page and files of a chart in a video."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.quantity import Z_95
from ...core.result import InputFile, Result
from ...core.table import Column, Table, uncertain, with_bound
from ...metrics.region import SATURATED_SHARE
from ...output import Destination, open_results
from ...output.file import writing
from ...report import drawing
from ...report.files import dataset_bytes, envelope_json
from ...report.html import render_page
from ...report.layout import Block, Card, Page, ReportFigure, Section, Verbatim, facts_table, input_facts
from ...report.sheets import write_result
from ...report.text import bounded, fixed, printable, significant, span
from ..chart.figures import matrix_maps
from ..chart.tables import matrix_table
from ..video.dataset import NOTE, TIME, restored
from ..video.findings import frame_tables, times_s
from ..video.page import METHODS
from .over_frames import FRAME_COLUMNS, PAIR_COLUMNS, PATCH_COLUMNS, RANGE_COLUMNS, ordered_patches, patch_means

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import Dataset

_Array = NDArray[np.float64]
_RANGE_NOTE = (
    "Of the frames that have the range, which is that of a picture of the chart. Where the chart has no patch beyond "
    "its end in any of them, it is at least this one."
)
_PAIR_NOTE = (
    "Patches next to each other in stated luminance. Detected: CDP ≥ {limit:g}. The interval of the lowest CDP is that "
    "of its frame. All patches against all are in the sheets of results.xlsx, and in results.nc."
)


def chart_video_result(dataset: Dataset) -> Result:
    """Return the tables and findings of a chart in a video, by its Dataset."""
    configuration, name = json.loads(dataset.attrs["configuration"]), str(dataset.attrs["file"])
    tables = [
        _range_table(dataset), _pair_table(dataset, float(configuration["cdp_limit"])), _patch_table(dataset),
        *frame_tables(dataset), *_matrices(dataset),
    ]  # fmt: skip
    inputs = [InputFile(**file) for file in json.loads(dataset.attrs["inputs"])]
    return Result(
        "video",
        PurePath(name).name or "video",
        tuple(tables),
        restored(json.loads(dataset.attrs["findings"])),
        (InputFile("video", name, str(dataset.attrs["sha256"])), *inputs),
        {
            **configuration,
            "mode": "chart",
            **{key: dataset.attrs[key] for key in ("method", "unit", "conversion")},
        },
    )


def _chart_unit(dataset: Dataset) -> str:
    unit = str(dataset.attrs["chart_unit"])
    return "" if unit == "relative" else unit


def _range_table(dataset: Dataset) -> Table:
    """Return the dynamic ranges over the frames, a row for each figure of merit and limit."""
    unit = _chart_unit(dataset)
    columns = (
        Column("figure", "figure of merit and limit"),
        Column("mean_stops", "mean range", "stops", "Mean of the frames that have the range.", decimals=2,
               bound="bound"),
        Column("bound", "mean range, bound", "", "Whether the chart ends before the camera does, in any frame: the true"
               " range is larger (>).", shown=False),
        *with_bound(uncertain(Column("lowest_stops", "lowest range", "stops", "Lowest range of a frame."),
                              lambda row: row.get("u_lowest_stops")), lambda row: row.get("lowest_bound")),
        Column("lowest_frame", "in frame", "", "The first frame with the lowest range.", decimals=0),
        *with_bound((Column("highest_stops", "highest range", "stops", "Highest range of a frame.", decimals=2),),
                    lambda row: row.get("highest_bound")),
        Column("std_stops", "standard deviation", "stops", "From frame to frame.", 2),
        Column("mean_low", "low end", unit, "Geometric mean of the low ends."),
        Column("lowest_low", "low end, from", unit, "Lowest low end of a frame.", shown=False),
        Column("highest_low", "low end, to", unit, "Highest low end of a frame.", shown=False),
        Column("mean_high", "high end", unit, "Geometric mean of the high ends."),
        Column("lowest_high", "high end, from", unit, "Lowest high end of a frame.", shown=False),
        Column("highest_high", "high end, to", unit, "Highest high end of a frame.", shown=False),
        Column("n_frames", "frames", "", "Frames that have the range.", decimals=0),
    )  # fmt: skip
    rows = [_range_row(dataset.isel(range=at)) for at in range(dataset.sizes["range"])]
    return Table.of_items("dynamic_range_over_frames", "Dynamic range over the frames", columns, rows, _RANGE_NOTE)


def _range_row(of_range: Dataset) -> dict[str, Any]:
    stops = of_range["range_stops"].values
    known = np.isfinite(stops)
    row: dict[str, Any] = {"figure": str(of_range["range"].values), "n_frames": int(known.sum())}
    if not known.any():
        return row
    at, highest = int(np.nanargmin(stops)), int(np.nanargmax(stops))
    is_bound = of_range["range_is_bound"].values == 1
    row |= {
        "mean_stops": float(stops[known].mean()),
        "bound": ">" if is_bound[known].any() else "",
        "lowest_stops": float(stops[at]),
        "u_lowest_stops": float(of_range["u_range_stops"].values[at]),
        "lowest_bound": ">" if is_bound[at] else "",
        "lowest_frame": int(of_range["frame"].values[at]),
        "highest_stops": float(stops[highest]),
        "highest_bound": ">" if is_bound[highest] else "",
        "std_stops": float(stops[known].std(ddof=1)) if known.sum() > 1 else None,
    }
    for end in ("low", "high"):
        levels = of_range[f"range_{end}"].values[known]
        row |= {f"mean_{end}": float(np.exp(np.log(levels).mean())), f"lowest_{end}": float(levels.min()),
                f"highest_{end}": float(levels.max())}  # fmt: skip
    return row


def _pair_table(dataset: Dataset, limit: float) -> Table:
    """Return CDP of patches next to each other over the frames, the brightest ones first."""
    columns = (
        Column("pair", "bright / dark patch"),
        Column("contrast", "target contrast", "%", "Weber contrast to be detected."),
        *(replace(column, shown=column.name not in ("lowest_cdp_low", "lowest_cdp_high", "std_cdp"),
                  low="lowest_cdp_low" if column.name == "lowest_cdp" else "",
                  high="lowest_cdp_high" if column.name == "lowest_cdp" else "") for column in PAIR_COLUMNS),
    )  # fmt: skip
    rows = []
    for pair in map(str, dataset["pair"].values):
        bright, dark = _names(pair, dataset)
        values = dataset.sel(bright=bright, dark=dark)
        contrasts = np.atleast_1d(values["contrast"].values)
        for number, contrast in enumerate(contrasts.tolist()):
            row: dict[str, Any] = {"pair": pair, "contrast": contrast if np.isfinite(contrast) else None}
            for column in PAIR_COLUMNS:
                value = float(np.atleast_1d(values[column.name].values)[number])
                whole = column.decimals == 0 and np.isfinite(value)
                row[column.name] = int(value) if whole else value if np.isfinite(value) else None
            rows.append(row)
    title, note = "CDP of patches next to each other over the frames", _PAIR_NOTE.format(limit=limit)
    return Table.of_items("neighbouring_patches", title, columns, rows, note, detail=len(rows) > 12)


def _names(pair: str, dataset: Dataset) -> tuple[str, str]:
    """Return both patches of a pair; names may hold the text between them."""
    names = [str(name) for name in dataset["patch"].values]
    return next((a, b) for a in names if pair.startswith(f"{a} / ") for b in names if pair == f"{a} / {b}")


def _patch_table(dataset: Dataset) -> Table:
    unit = "cd/m²" if dataset.attrs["unit"] == "cd/m^2" else ""
    columns = (
        Column("patch", "patch", "", "Its name in the chart."),
        *uncertain(
            Column("stated", "stated", _chart_unit(dataset), "Stated luminance."), lambda row: row.get("u_stated")
        ),
        Column("mean", "mean", unit, "Mean over the frames in which it is to be seen."),
        Column("lowest_mean", "lowest mean", unit, "Of a frame."),
        Column("highest_mean", "highest mean", unit, "Of a frame."),
        Column("snr", "SNR", "", "Mean over standard deviation of the pixels of a frame, over the frames."),
        Column("lowest_snr", "lowest SNR", "", "Of a frame."),
        Column("n_saturated", "saturated in", "", "Frames in which it is saturated.", decimals=0),
        Column("n_frames", "frames", "", "Frames in which it is to be seen.", decimals=0),
    )
    return Table.of_items("chart", "Patches over the frames", columns, _patch_rows(dataset), detail=True)


def _patch_rows(dataset: Dataset) -> Iterator[dict[str, Any]]:
    for at in ordered_patches(dataset):
        patch = dataset.isel(patch=at)
        mean, snr = (values[np.isfinite(values)] for values in (patch["mean"].values, patch["snr"].values))
        row: dict[str, Any] = {
            "patch": str(patch["patch"].values), "n_frames": int(mean.size),
            "n_saturated": int((patch["saturated"].values > SATURATED_SHARE).sum()),
        }  # fmt: skip
        stated, u = float(patch["stated"].values), float(patch["u_stated"].values)
        row |= {"stated": stated} if np.isfinite(stated) else {}
        row |= {"u_stated": u} if np.isfinite(u) else {}
        if mean.size:
            row |= {"mean": mean.mean(), "lowest_mean": mean.min(), "highest_mean": mean.max()}
        if snr.size:
            row |= {"snr": snr.mean(), "lowest_snr": snr.min()}
        yield row


def _matrices(dataset: Dataset) -> Iterator[Table]:
    """Yield a table of all patches against all for each quantity, and each contrast if some were given."""
    names = [str(name) for name in dataset["patch"].values]
    if "contrast" not in dataset.dims:
        yield matrix_table("contrast matrix", "target contrast", names, dataset["contrast"].values, False)
    for column in PAIR_COLUMNS:
        probability = "cdp" in column.name and column.name != "std_cdp"
        of_contrasts: list[tuple[str, str, Any]] = [(f"{column.name} matrix", "", dataset[column.name])]
        if "contrast" in dataset.dims:
            of_contrasts = [
                (
                    f"{column.name} {100 * contrast:g}%",
                    f" at {100 * contrast:g} %",
                    dataset[column.name].isel(contrast=at),
                )
                for at, contrast in enumerate(dataset["contrast"].values.tolist())
            ]
        for name, at, values in of_contrasts:
            yield matrix_table(name, f"{column.label}{at}", names, values.values, probability, column.unit)


def frame_sheet(dataset: Dataset) -> Table:
    """Return the ranges, the chart's place and its patches, one row per frame."""
    frame = Column("frame", "frame", meaning="Number in the video, from 0.", decimals=0)
    columns: list[Column] = [frame, TIME]
    data: dict[str, Any] = {"frame": dataset["frame"].values, TIME.name: dataset["time_s"].values}

    def add(column: Column, values: _Array, name: str = "") -> None:
        unit = column.unit if column.unit != "light" else ("cd/m²" if dataset.attrs["unit"] == "cd/m^2" else "")
        named = replace(column, unit=unit)
        if name:
            named = replace(named, name=f"{column.name}[{name}]", label=f"{name}: {column.label}")
        columns.append(named)
        data[named.name] = values.astype(float)

    for column in FRAME_COLUMNS:
        add(column, dataset[column.name].values[:, 0])
    for at, name in enumerate(map(str, dataset["range"].values)):
        for column in RANGE_COLUMNS:
            add(column, dataset[column.name].values[:, at], name)
    for at, name in enumerate(map(str, dataset["patch"].values)):
        for column in PATCH_COLUMNS:
            add(column, dataset[column.name].values[:, at], name)
    columns.append(NOTE)
    data[NOTE.name] = dataset[NOTE.name].values
    return Table("Frames", "Ranges and patches, one row per frame", tuple(columns), data)


def ranges_figure(dataset: Dataset) -> ReportFigure:
    """Draw the dynamic ranges over time, and the CDP of patches next to each other."""
    figure = drawing.new_figure(6.4, 5.6)
    above, below = figure.subplots(2, sharex=True)
    x, label = times_s(dataset), "time in s"
    if not np.isfinite(x).all() or x.size == 1:
        x, label = dataset["frame"].values.astype(np.float64), "frame number"
    colours = (drawing.BLUE, drawing.GREEN, drawing.ORANGE, drawing.VERMILLION)
    drawn = [at for at, name in enumerate(map(str, dataset["range"].values)) if name.startswith("SNR ≥")]
    for colour, at in zip(colours, drawn, strict=False):
        stops, u = (dataset[name].values[:, at] for name in ("range_stops", "u_range_stops"))
        above.fill_between(x, stops - Z_95 * u, stops + Z_95 * u, color=colour, alpha=0.2, linewidth=0)
        above.plot(x, stops, ".-", color=colour, linewidth=1.1, markersize=3, label=str(dataset["range"].values[at]))
    drawing.finish(above, "", "stops", "Dynamic range of each frame", ncols=2)
    _draw_steps(below, dataset, x)
    drawing.label(below, label, "pairs, brightest first", "CDP of patches next to each other")
    return drawing.reported(
        "over-time", figure,
        "Dynamic range of each frame by the SNR of the patches, with its 95 % interval; below, the CDP of patches next "
        "to each other at their target contrast: a row for each pair, the brightest at the top.",
    )  # fmt: skip


def _draw_steps(axes: Axes, dataset: Dataset, x: _Array) -> None:
    cdp = _first(dataset["neighbour_cdp"])
    step = float(np.median(np.diff(x))) if x.size > 1 else 1.0
    ends = (float(x[0]) - step / 2, float(x[-1]) + step / 2, cdp.shape[1] + 0.5, 0.5)
    drawn = axes.imshow(cdp.T, aspect="auto", vmin=0, vmax=1, cmap="viridis", extent=ends, interpolation="nearest")
    axes.figure.colorbar(drawn, ax=axes, label="CDP", pad=0.01)


def _first(values: Any) -> _Array:
    """Return values at the first contrast, where there are several."""
    first = values.isel(contrast=0) if "contrast" in values.dims else values
    return np.asarray(first.values, dtype=np.float64)


def levels_figure(dataset: Dataset) -> ReportFigure:
    """Draw SNR and CDP over luminance: mean of the frames, and from the lowest to the highest of them."""
    figure = drawing.new_figure(6.4, 5.2)
    above, below = figure.subplots(2, sharex=True)
    stated = np.isfinite(dataset["stated"].values).any()
    levels = dataset["stated"].values if stated else patch_means(dataset)
    order = [at for at in ordered_patches(dataset) if levels[at] > 0]
    _band(above, levels[order], dataset["snr"].values[:, order])
    names = [str(name) for name in dataset["patch"].values]
    dark = [names.index(_names(pair, dataset)[1]) for pair in map(str, dataset["pair"].values)]
    lit = [number for number, at in enumerate(dark) if levels[at] > 0]
    _band(below, levels[[dark[number] for number in lit]], _first(dataset["neighbour_cdp"])[:, lit])
    drawing.logarithmic(above.xaxis, above.yaxis)
    drawing.logarithmic(below.xaxis)
    unit = str(dataset.attrs["chart_unit"])
    drawing.finish(above, "", "SNR", "Signal-to-noise ratio of the patches")
    where = "relative luminance" if unit == "relative" else f"luminance in {unit}"
    drawing.finish(below, where, "CDP", "CDP of patches next to each other, at the darker one")
    below.set_ylim(-0.03, 1.03)
    return drawing.reported(
        "over-luminance", figure, "Lines: mean of the frames; bands: from the lowest to the highest value of a frame."
    )


def _band(axes: Axes, levels: _Array, values: _Array) -> None:
    known = np.isfinite(values).any(axis=0)
    levels, values = levels[known], values[:, known]
    axes.fill_between(levels, np.nanmin(values, axis=0), np.nanmax(values, axis=0), alpha=0.25, linewidth=0)
    axes.plot(levels, np.nanmean(values, axis=0), ".-")


def _cards(dataset: Dataset, ranges: Table) -> list[Card]:
    unit = _chart_unit(dataset)
    cards = []
    for row in ranges.rows():
        if not row["n_frames"] or not (row["mean_stops"] or 0) > 0:
            continue
        of_frames = span(fixed(row["lowest_stops"], 2), fixed(row["highest_stops"], 2))
        lines = (
            f"{significant(row['mean_low'])} to {significant(row['mean_high'])}{f' {unit}' if unit else ''}",
            f"lowest in frame {row['lowest_frame']}",
        )
        mean, bound = row["mean_stops"], row["bound"]
        value = bounded(mean, bound, "stops") if bound else f"{fixed(mean, 2)} stops"
        detail = "the chart ends first" if row["bound"] else f"frames: {of_frames} stops"
        cards.append(Card(f"Dynamic range, {row['figure']}", value, detail, lines))
    return cards


def chart_video_page(dataset: Dataset, result: Result, figures: Sequence[ReportFigure]) -> Page:
    """Return the page: dynamic ranges, these over time, matrices of the mean and the lowest CDP, and all numbers."""
    tables: Mapping[str, Table] = {table.name: table for table in result.tables}
    over_time, over_luminance = figures
    order = ordered_patches(dataset)
    first = dataset.isel(contrast=0) if "contrast" in dataset.dims else dataset
    maps = matrix_maps(
        [str(name) for name in dataset["patch"].values[order]],
        {column.name: first[column.name].values[np.ix_(order, order)] for column in PAIR_COLUMNS},
        np.broadcast_to(first["contrast"].values, (len(order),) * 2)[np.ix_(order, order)],
    )
    lost: list[Block] = [tables[name] for name in ("lost", "notes") if name in tables]
    versions = json.loads(dataset.attrs.get("versions", "{}"))
    packages = ("evaluated with", ", ".join(f"{name} {version}" for name, version in versions.items()))
    settings = "\n".join(f"{name}: {value}" for name, value in result.configuration.items() if value is not None)
    sections = [
        Section("All patches against all", [maps]),
        Section("Over luminance", [over_luminance, tables["neighbouring_patches"]]),
        Section("Patches", [tables["chart"]], collapsed=True),
        *([Section("Frames without the chart, and notes", lost, collapsed=True)] if lost else []),
        Section("Provenance and settings", [facts_table([*input_facts(result), packages]), Verbatim(settings)], True),
    ]
    return Page.of(
        result,
        "Chart in a video",
        summary=_summary(dataset),
        cards=_cards(dataset, tables["dynamic_range_over_frames"]),
        lead=(over_time, tables["dynamic_range_over_frames"]),
        sections=sections,
    )


def _summary(dataset: Dataset) -> str:
    numbers, method = dataset["frame"].values, str(dataset.attrs["method"])
    n_lost = int(dataset["lost"].values.sum())
    lost = f" It was lost in {n_lost} of them." if n_lost else ""
    return printable(
        f"Chart “{dataset['region'].values[0]}” of {dataset.sizes['patch']} patches, "
        f"{METHODS.get(method, f'tracked ({method})')}: {numbers.size} frames, number "
        f"{span(str(numbers[0]), str(numbers[-1]))}.{lost}"
    )


def write_chart_video(dataset: Dataset, folder: Destination) -> Result:
    """Write the results: results.nc, results.json, report.html, results.xlsx and figures; return the tables.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    result = chart_video_result(dataset)
    figures = ranges_figure(dataset), levels_figure(dataset)
    with open_results(folder, "video") as files:
        spreadsheet = files.path("results.xlsx")
        with writing(files.folder):
            write_result(spreadsheet, result, datetime.now(UTC), [frame_sheet(dataset)])
        files.add(
            {
                "results.nc": dataset_bytes(dataset, "chart in the video"),
                "results.json": envelope_json(result).encode(),
                "report.html": render_page(chart_video_page(dataset, result, figures)).encode(),
                **{f"figures/{figure.file_name}": figure.png for figure in figures},
            }
        )
    return result
