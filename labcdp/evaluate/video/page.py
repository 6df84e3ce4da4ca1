"""A video's results as a page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.disk.files import named_plainly
from ...core.result import Result
from ...core.table import Column, Table
from ...metrics.pair import bound_of_contrast
from ...metrics.region import SATURATED_SHARE
from ...output import Destination, open_results
from ...output.file import writing
from ...report.files import envelope_json, write_blocks
from ...report.html import render_page
from ...report.layout import Block, Card, Page, ReportFigure, Section, State, Verbatim, facts_table, input_facts
from ...report.sheets import MOST_COLUMNS, LongTable, write_result
from ...report.text import cell_text, fixed, percent, printable, significant, span
from ..requirement import requirement_cards
from ..verdict import changes_of
from .dataset import LIGHT, NOTE, OF_CONTRAST, OF_CORNER, OF_FRAME, OF_REGION, TIME, VideoRows, blocks_of, check_video
from .figure import drawn_contrasts, frames_of_a_point, video_figure
from .result import answer_of, contrast_name, is_neighbours, limit_of, unit_of, video_result

if TYPE_CHECKING:
    from xarray import Dataset


#: Contrasts that get a card, beside the measured one.
_MOST_CARDS = 3
#: How regions are followed, by the method's name.
METHODS = {"follow": "tracked", "homography": "tracked by the homography of a plane target", "fixed": "at rest"}


def video_page(dataset: Dataset, result: Result, figure: ReportFigure) -> Page:
    """Return the page: how often contrasts were detected, curves over time, then regions, notes and provenance."""
    tables = {table.name: table for table in result.tables}
    sections = [Section("Requirement", [tables[name]]) for name in ("requirement",) if name in tables]
    if "regions" in tables:
        text = "A region that cannot be found is lost: these frames have no CDP."
        blocks: list[Block] = [tables["regions"], *([tables["lost"]] if "lost" in tables else []), text]
        sections.append(Section("Regions", blocks))
    if "notes" in tables:
        sections.append(Section("Notes on frames", [tables["notes"]], collapsed=True))
    sections.append(Section("Provenance and settings", _provenance(dataset, result), collapsed=True))
    of_contrasts = (_card(row, tables["contrasts"]) for row in _chosen(tables["contrasts"]))
    cards = [*requirement_cards(result), *_measured(dataset), *of_contrasts]
    return Page.of(
        result,
        "CDP of a video",
        summary=_summary(dataset, result),
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
    caption = " ".join(text for text, said in parts.items() if said)
    alternative = "Curves of CDP, measured contrast and quality over time."
    return ReportFigure("over-time.png", video_figure(dataset, result), caption, alternative)


def _chosen(contrasts: Table) -> list[dict[str, Any]]:
    """Return the reference, and the contrasts where the answer changes."""
    rows = list(contrasts.rows())
    reference = [row for row in rows if row["kind"] == "reference"]
    others = [row for row in rows if row["kind"] != "reference"]
    places = changes_of([*map(answer_of, others)], _MOST_CARDS - len(reference))
    return [*reference, *(others[place] for place in places)]


def _measured(dataset: Dataset) -> Iterator[Card]:
    """Yield the card of the measured contrast: what contrasts asked for are to be compared with."""
    if "measured_contrast" not in dataset:
        return
    found = dataset["measured_contrast"].to_numpy()
    found = found[np.isfinite(found)]
    if found.size:
        low, middle, high = (f"{significant(100 * one)} %" for one in np.quantile(found, (0, 0.5, 1)))
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


def _summary(dataset: Dataset, result: Result) -> str:
    values = {row["quantity"]: row["value"] for row in result.table("summary").rows()}
    frames = f"{values['chosen frames']} frames, number {span(str(values['first frame']), str(values['last frame']))}"
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


def write_video(results: Dataset | VideoRows, folder: Destination) -> Result:
    """Write the results of a video: results.nc, results.json, report.html, figures/over-time.png and results.xlsx.

    Memory does not grow with the video but by one number a frame.

    Parameters
    ----------
    results : xarray.Dataset or VideoRows
        Results of a video.
    folder : path or ResultsFolder
        New, empty, or with unfinished results of the same kind; or a folder of results that is open.

    Returns
    -------
    Result
        What results.json says.

    Raises
    ------
    InputError
        If the dataset is no result of a video, or a file cannot be written.
    """
    import xarray as xr

    if not isinstance(results, VideoRows):
        check_video(results)
    blocks = results.blocks() if isinstance(results, VideoRows) else blocks_of(results)
    with open_results(folder, "video") as files:
        netcdf, spreadsheet = files.path("results.nc"), files.path("results.xlsx")
        with writing(files.folder):
            write_blocks(netcdf, blocks, "frame")
            with named_plainly(netcdf) as name, xr.open_dataset(name, engine="netcdf4", cache=False) as dataset:
                result = video_result(dataset)
                figure = over_time(dataset, result)
                page = render_page(video_page(dataset, result, figure))
                write_result(spreadsheet, result, datetime.now(UTC), long_tables(dataset))
        files.add(
            {
                "results.json": envelope_json(result).encode(),
                "report.html": page.encode(),
                f"figures/{figure.file_name}": figure.png,
            }
        )
    return result


_FRAME = Column("frame", "frame", meaning="Number in the video, from 0.", decimals=0)
_CONTRAST = Column("contrast", "contrast", "%", "Weber contrast to be detected.", decimals=2)


def long_tables(dataset: Dataset) -> list[LongTable]:
    """Return the tables of all frames; what exceeds the columns of a sheet continues in a further one."""
    n, most = dataset.sizes["frame"], MOST_COLUMNS - 1
    return [
        *(_frame_columns(dataset, range(start, min(start + most, n))) for start in range(0, n, most)),
        _frame_rows(dataset),
    ]


def _frame_columns(dataset: Dataset, frames: range) -> LongTable:
    """CDP of each contrast, one column per frame."""
    part = slice(frames.start, frames.stop)
    numbers = dataset["frame"].values[part].tolist()
    columns = [Column(f"frame_{number}", f"Frame number {number}", "", "CDP.", decimals=4) for number in numbers]

    def rows() -> Iterator[dict[str, Any]]:
        for place, contrast in enumerate(dataset["contrast"].values.tolist()):
            cdp = dataset["cdp"].isel(contrast=place, frame=part).values.tolist()
            yield {"contrast": contrast, **{column.name: value for column, value in zip(columns, cdp, strict=True)}}

    heads = (replace(_CONTRAST, label="Contrasts"), *columns)
    return LongTable("CDP", "CDP of each contrast, one column per frame", heads, rows, matrix=True)


def _bounds(row: Mapping[str, Any], regions: Sequence[str]) -> dict[str, str]:
    """Return of means and contrast of a frame whether they are bounds."""
    full = {name: row.get(f"saturated[{name}]", 0.0) > SATURATED_SHARE for name in regions}
    found = {f"bound[mean[{name}]]": ">" if saturated else "" for name, saturated in full.items()}
    if len(regions) == 2:
        dark, bright = sorted(regions, key=lambda name: float(row.get(f"mean[{name}]", nan)))
        found["bound[measured_contrast]"] = bound_of_contrast(full[bright], full[dark])
    return found


def _frame_rows(dataset: Dataset) -> LongTable:
    """All numbers, one row per frame and contrast; the contrast changes fastest."""
    own = (_FRAME, TIME, _CONTRAST, *OF_CONTRAST, *OF_FRAME)
    found: list[tuple[Column, str, dict[str, int]]] = [(one, one.name, {}) for one in own]
    for region in range(dataset.sizes.get("region", 0)):
        name = str(dataset["region"].values[region])
        for one in OF_REGION:
            unit = unit_of(dataset) if one.unit == LIGHT else one.unit
            named = replace(one, name=f"{one.name}[{name}]", label=f"{name}: {one.label}", unit=unit)
            found.append((named, one.name, {"region": region}))
        for corner in range(dataset.sizes.get("corner", 0)):
            for one in OF_CORNER:
                label = f"{name}: corner {corner + 1} {one.label}"
                named = replace(one, name=f"{one.name}[{name}, {corner}]", label=label)
                found.append((named, one.name, {"region": region, "corner": corner}))
    # One number of decimals for all rows.
    found = [
        (one if one.decimals is not None else replace(one, decimals=2 if one.unit == "%" else 4), name, index)
        for one, name, index in (*found, (NOTE, NOTE.name, {}))
        if name in dataset.variables
    ]

    regions = [str(name) for name in dataset["region"].values] if "region" in dataset.dims else []

    def rows() -> Iterator[dict[str, Any]]:
        for block in blocks_of(dataset):
            each = block["cdp"]
            values = [block[name].isel(index).broadcast_like(each).transpose(*each.dims) for _, name, index in found]
            lists = [(one.astype(float) if one.dtype == bool else one).values.ravel().tolist() for one in values]
            for row in zip(*lists, strict=True):
                values_of_row = {column.name: value for (column, _, _), value in zip(found, row, strict=True)}
                yield values_of_row | _bounds(values_of_row, regions)

    columns = tuple(
        replace(column, bound=f"bound[{column.name}]") if name in ("mean", "measured_contrast") else column
        for column, name, _ in found
    )
    return LongTable("Frames", "All numbers, one row per frame and contrast", columns, rows)
