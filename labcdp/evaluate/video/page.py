"""A video's results as a page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.result import Result
from ...core.table import Column, Table
from ...metrics.pair import bound_of_contrast
from ...metrics.region import SATURATED_SHARE
from ...output import Destination, open_results
from ...output.file import writing
from ...report.files import dataset_bytes, envelope_json
from ...report.html import render_page
from ...report.layout import Block, Card, Page, ReportFigure, Section, State, Verbatim, facts_table, input_facts
from ...report.sheets import MOST_COLUMNS, write_result
from ...report.text import cell_text, fixed, percent, printable, significant, span
from ..judgement import requirement_cards
from ..verdict import changes_of
from .dataset import (
    COLOUR_COLUMNS,
    CONTRAST_COLUMNS,
    CORNER_COLUMNS,
    FRAME_COLUMNS,
    LIGHT,
    NOTE,
    REGION_COLUMNS,
    TIME,
)
from .figure import drawn_contrasts, frames_of_a_point, video_figure
from .result import answer_of, contrast_name, is_neighbours, limit_of, unit_of, video_result

if TYPE_CHECKING:
    from xarray import Dataset


#: Contrasts that get a card, beside the measured one.
_MOST_CARDS = 3
#: Description of each tracking method.
METHODS = {"follow": "tracked", "homography": "tracked by the homography of a plane target", "fixed": "at rest"}


def video_page(dataset: Dataset, result: Result, figure: ReportFigure) -> Page:
    """Return the page: how often contrasts were detected, curves over time, then regions, notes and provenance."""
    tables = {table.name: table for table in result.tables}
    sections = [Section("Requirement", [table]) for table in result.tables_named("requirement")]
    if "colours" in tables:
        from .colours import colours_figure

        sections.append(Section("Colours", [colours_figure(dataset), tables["colours"]]))
    if "regions" in tables:
        text = "A region that cannot be found is lost: these frames have no CDP."
        blocks: list[Block] = [tables["regions"], *([tables["lost"]] if "lost" in tables else []), text]
        sections.append(Section("Regions", blocks))
    if "notes" in tables:
        sections.append(Section("Notes on frames", [tables["notes"]], collapsed=True))
    sections.append(Section("Provenance and settings", _provenance(dataset, result), collapsed=True))
    contrast_cards = (_card(row, tables["contrasts"]) for row in _chosen(tables["contrasts"]))
    cards = [*requirement_cards(result), *_measured(dataset), *contrast_cards]
    return Page.of(
        result,
        "CDP of a video",
        summary=_summary(dataset),
        cards=cards,
        lead=(figure, tables["contrasts"]),
        sections=sections,
    )


def over_time(dataset: Dataset, result: Result) -> ReportFigure:
    """Draw the figure, with its caption."""
    number = frames_of_a_point(dataset)
    n_evaluated = [row["n_evaluated"] for row in result.table("contrasts").rows()]
    parts = {
        f"CDP with its 95 % interval; the dotted line is the limit of {limit_of(dataset):g}.": True,
        f"Of the {dataset.sizes['contrast']} contrasts some are drawn.": (
            len(drawn_contrasts(dataset, result)) + 1 < dataset.sizes["contrast"]
        ),
        "Below: Weber contrast of the regions' means with its 95 % interval.": "measured_contrast" in dataset,
        "At the bottom: tracking quality of each region, from 0 to 1.": "quality" in dataset,
        "Shaded: frames without a result.": min(n_evaluated) < dataset.sizes["frame"],
        f"Each drawn point stands for {number} frames: the line is their mean, the band reaches from the lowest to the "
        "highest end of their intervals.": number > 1,
    }
    caption = " ".join(text for text, shown in parts.items() if shown)
    alternative = "Curves of CDP, measured contrast and quality over time."
    return ReportFigure("over-time.png", video_figure(dataset, result), caption, alternative)


def _chosen(contrasts: Table) -> list[dict[str, Any]]:
    """Return the reference, and the contrasts where the answer changes."""
    rows = list(contrasts.rows())
    reference = [row for row in rows if row["kind"] == "reference"]
    others = [row for row in rows if row["kind"] != "reference"]
    places = changes_of([*map(answer_of, others)], _MOST_CARDS - len(reference))
    return [*reference, *(others[index] for index in places)]


def _measured(dataset: Dataset) -> Iterator[Card]:
    """Yield the card of the measured contrast, with which target contrasts are to be compared."""
    if "measured_contrast" not in dataset:
        return
    contrasts = dataset["measured_contrast"].to_numpy()
    contrasts = contrasts[np.isfinite(contrasts)]
    if contrasts.size:
        low, middle, high = (f"{significant(100 * contrast)} %" for contrast in np.quantile(contrasts, (0, 0.5, 1)))
        yield Card("Measured contrast", middle, "median of the frames", (span(low, high),))


def _card(row: Mapping[str, Any], contrasts: Table) -> Card:
    name = contrast_name(row)
    title = name[0].upper() + name[1:]
    reasons = {"n_lost": "lost to tracking", "n_other": "without a CDP"}
    without = [f"{row[key]} {text}" for key, text in reasons.items() if row[key]]
    left_out = (", ".join(without),) if without else ()
    if not row["n_evaluated"]:
        return Card(title, "no result", "No frame has a CDP of this contrast.", left_out)
    state: State = "good" if row["detected_share"] == 1 else "open" if row["detected_share"] else "bad"
    return Card(
        title,
        f"{cell_text(contrasts.column('detected_share'), row)} %",
        f"of {row['n_evaluated']} evaluated frames have CDP ≥ {row['cdp_limit']:g}",
        (
            *left_out,
            f"mean CDP {fixed(row['mean_cdp'], 3)}",
            f"lowest CDP {fixed(row['lowest_cdp'], 3)}, in frame {row['lowest_frame']}",
        ),
        {"good": "detected in all", "open": "detected in some", "bad": "detected in none"}[state],
        state,
    )


def _summary(dataset: Dataset) -> str:
    numbers = dataset["frame"].values
    frames = f"{numbers.size} frames, number {span(str(numbers[0]), str(numbers[-1]))}"
    tolerance = dataset.attrs.get("epsilon", "")
    within = f" Detected: within {percent(tolerance)} of the contrast." if isinstance(tolerance, float) else ""
    if is_neighbours(dataset):
        return f"CDP between each pixel and its right and lower neighbour: {frames}.{within}"
    names = " and ".join(f"“{name}”" for name in map(str, dataset["region"].values))
    method = str(dataset.attrs.get("method", ""))
    method = METHODS.get(method, f"tracked ({method})")
    return printable(f"CDP between the regions {names}, {method}: {frames}.{within}")


def _provenance(dataset: Dataset, result: Result) -> list[Block]:
    versions = json.loads(dataset.attrs.get("versions", "{}"))
    packages = ("evaluated with", ", ".join(f"{name} {version}" for name, version in versions.items()))
    settings = "\n".join(
        f"{name}: {value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)}"
        for name, value in result.configuration.items()
        if value is not None
    )
    return [facts_table([*input_facts(result), packages]), Verbatim(settings)]


def write_video(dataset: Dataset, folder: Destination) -> Result:
    """Write the results of a video: results.nc, results.json, report.html, figures/over-time.png and results.xlsx.

    Parameters
    ----------
    dataset : xarray.Dataset
        Results of a video.
    folder : path or ResultsFolder
        New, empty, or with unfinished results of the same kind; or a folder of results that is open.

    Returns
    -------
    Result
        Result as in results.json.

    Raises
    ------
    InputError
        If the dataset is no result of a video, or a file cannot be written.
    """
    result = video_result(dataset)
    figure = over_time(dataset, result)
    with open_results(folder, "video") as files:
        spreadsheet = files.path("results.xlsx")
        with writing(files.folder):
            write_result(spreadsheet, result, datetime.now(UTC), frame_sheets(dataset))
        files.add(
            {
                "results.nc": dataset_bytes(dataset, "results of the video"),
                "results.json": envelope_json(result).encode(),
                "report.html": render_page(video_page(dataset, result, figure)).encode(),
                f"figures/{figure.file_name}": figure.png,
            }
        )
    return result


_FRAME = Column("frame", "frame", meaning="Number in the video, from 0.", decimals=0)
_CONTRAST = Column("contrast", "contrast", "%", "Weber contrast to be detected.", decimals=2)


def frame_sheets(dataset: Dataset) -> list[Table]:
    """Return the tables of all frames; what exceeds the columns of a sheet continues in a further one."""
    n, most = dataset.sizes["frame"], MOST_COLUMNS - 1
    return [
        *(_frame_columns(dataset, slice(start, min(start + most, n))) for start in range(0, n, most)),
        _frame_rows(dataset),
    ]


def _frame_columns(dataset: Dataset, frames: slice) -> Table:
    """CDP of each contrast, one column per frame."""
    numbers, cdp = dataset["frame"].values[frames].tolist(), dataset["cdp"].values[frames]
    columns = [Column(f"frame_{number}", f"Frame number {number}", "", "CDP.", decimals=4) for number in numbers]
    data = {"contrast": dataset["contrast"].values} | dict(zip((column.name for column in columns), cdp, strict=True))
    heads = (replace(_CONTRAST, label="Contrasts"), *columns)
    return Table("CDP", "CDP of each contrast, one column per frame", heads, data, matrix=True)


def _frame_rows(dataset: Dataset) -> Table:
    """All numbers, one row per frame and contrast; the contrast changes fastest."""
    variables = [
        (column, dataset.get(column.name))
        for column in (_FRAME, TIME, _CONTRAST, *CONTRAST_COLUMNS, *FRAME_COLUMNS, *COLOUR_COLUMNS)
    ]
    for region in range(dataset.sizes.get("region", 0)):
        name = str(dataset["region"].values[region])
        for column in REGION_COLUMNS:
            unit = unit_of(dataset) if column.unit == LIGHT else column.unit
            named = replace(column, name=f"{column.name}[{name}]", label=f"{name}: {column.label}", unit=unit)
            variables.append((named, dataset[column.name].isel(region=region) if column.name in dataset else None))
        for corner in range(dataset.sizes.get("corner", 0)):
            for column in CORNER_COLUMNS:
                label = f"{name}: corner {corner + 1} {column.label}"
                named = replace(column, name=f"{column.name}[{name}, {corner}]", label=label)
                variables.append((named, dataset[column.name].isel(region=region, corner=corner)))
    variables.append((NOTE, dataset.get(NOTE.name)))
    cdp = dataset["cdp"]
    columns: list[Column] = []
    data: dict[str, Any] = {}
    for column, values in variables:
        if values is not None:
            # One number of decimals for all rows.
            decimals = column.decimals if column.decimals is not None else 2 if column.unit == "%" else 4
            columns.append(replace(column, decimals=decimals))
            values = values.astype(float) if values.dtype == bool else values
            data[column.name] = values.broadcast_like(cdp).transpose(*cdp.dims).values.ravel()
    return _with_bounds(Table("Frames", "All numbers, one row per frame and contrast", tuple(columns), data), dataset)


def _with_bounds(table: Table, dataset: Dataset) -> Table:
    """Return the table of frames with whether means and contrasts are bounds, if pixels of a region are saturated."""
    if "saturated" not in dataset or not (full := dataset["saturated"].values > SATURATED_SHARE).any():
        return table
    regions = [str(name) for name in dataset["region"].values]
    bounds = {f"mean[{name}]": np.where(full[:, region], ">", "") for region, name in enumerate(regions)}
    if len(regions) == 2:
        first_is_darker = dataset["mean"].values[:, 0] <= dataset["mean"].values[:, 1]
        sides = zip(first_is_darker, full, strict=True)
        contrasts = [bound_of_contrast(bool(pair[int(darker)]), bool(pair[1 - int(darker)])) for darker, pair in sides]
        bounds["measured_contrast"] = np.array(contrasts, dtype=object)
    n_contrasts = dataset.sizes["contrast"]
    meaning = "Whether the true value is larger (>), smaller (<) or unknown (?), as pixels are saturated."
    columns = [
        replace(column, bound=f"{column.name}_bound") if column.name in bounds else column for column in table.columns
    ]
    columns += [Column(f"{name}_bound", f"{table.column(name).label}, bound", "", meaning) for name in bounds]
    data: dict[str, Any] = dict(table.data)
    data |= {f"{name}_bound": np.repeat(values, n_contrasts) for name, values in bounds.items()}
    return replace(table, columns=tuple(columns), data=data)
