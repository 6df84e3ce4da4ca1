"""The page and the files of the flicker of a video."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...core.result import Result
from ...output import Destination, open_results
from ...output.file import writing
from ...report.files import dataset_bytes, envelope_json
from ...report.html import render_page
from ...report.layout import Block, Card, Page, ReportFigure, Section, Verbatim, facts_table, input_facts
from ...report.sheets import write_result
from ...report.text import fixed, percent, printable, span
from ..video.page import METHODS
from ..video.settings import Progress
from .figures import all_regions, drawn_regions, over_phase, over_time
from .measure import RegionFlicker, measure_flicker
from .record import record_regions
from .settings import FlickerSettings
from .tables import flicker_dataset, flicker_result, frame_sheet, settings_of, unit_of

if TYPE_CHECKING:
    from xarray import Dataset

#: Regions up to which one figure shows them all.
_FEW = 4


def evaluate_flicker(
    path: str | Path,
    settings: FlickerSettings,
    folder: Destination | None = None,
    *,
    progress: Progress | None = None,
) -> tuple[Dataset, list[RegionFlicker]]:
    """Evaluate the flicker of regions of a video.

    Parameters
    ----------
    path, settings, folder, progress
        As of `labcdp.evaluate.flicker.record.record_regions`.

    Returns
    -------
    (xarray.Dataset, list of RegionFlicker)
        Light of the regions over the frames with the indices of each region, and their records.

    Raises
    ------
    InputError, CalibrationError
        As `record_regions`, or if the frames with the lamp off are none of the video's.
    """
    dataset = record_regions(path, settings, folder, progress=progress)
    regions = measure_flicker(dataset, settings_of(dataset))
    return flicker_dataset(dataset, regions), regions


def write_flicker(dataset: Dataset, regions: Sequence[RegionFlicker], folder: Destination) -> Result:
    """Write the results: results.nc, results.json, report.html, results.xlsx and figures; return the tables.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    result, unit = flicker_result(dataset, regions), unit_of(dataset)
    drawn = drawn_regions(regions)
    phase = over_phase(drawn, unit)
    figures = [over_time(drawn, unit), *([] if phase is None else [phase])]
    figures += [all_regions(regions)] if len(regions) > _FEW else []
    with open_results(folder, "video") as files:
        spreadsheet = files.path("results.xlsx")
        with writing(files.folder):
            write_result(spreadsheet, result, datetime.now(UTC), [frame_sheet(dataset)])
        files.add(
            {
                "results.nc": dataset_bytes(dataset, "flicker of the video"),
                "results.json": envelope_json(result).encode(),
                "report.html": render_page(flicker_page(dataset, regions, result, figures)).encode(),
                **{f"figures/{figure.file_name}": figure.png for figure in figures},
            }
        )
    return result


def flicker_page(
    dataset: Dataset, regions: Sequence[RegionFlicker], result: Result, figures: Sequence[ReportFigure]
) -> Page:
    """Return the page: the worst indices, light over time with its histogram, over the phase, and all numbers."""
    time, *others = figures
    tables = {table.name: table for table in result.tables}
    sections = [Section("Light over time", [time]), Section("Regions", [tables["flicker"], _drawn_text(regions)])]
    sections += [Section("Beat between lamp and frames", others)] if others else []
    lost: list[Block] = [tables[name] for name in ("lost", "notes") if name in tables]
    sections += [Section("Frames without a value, and notes", lost, collapsed=True)] if lost else []
    versions = json.loads(dataset.attrs.get("versions", "{}"))
    packages = ("evaluated with", ", ".join(f"{name} {version}" for name, version in versions.items()))
    settings = "\n".join(f"{name}: {value}" for name, value in result.configuration.items() if value is not None)
    sections.append(
        Section("Provenance and settings", [facts_table([*input_facts(result), packages]), Verbatim(settings)], True)
    )
    return Page.of(
        result,
        "Flicker of a video",
        summary=_summary(dataset, regions),
        cards=flicker_cards(regions),
        sections=sections,
    )


def _drawn_text(regions: Sequence[RegionFlicker]) -> str:
    return (
        f"{len(regions)} regions: drawn are those with the largest FMI."
        if len(regions) > _FEW
        else "A lamp and the frame rate beat: how many phases of the lamp were seen decides how well an index is known."
    )


def flicker_section(regions: Sequence[RegionFlicker], result: Result) -> Section:
    """Return the section of the page of a session with the flicker of its patches."""
    drawn = drawn_regions(regions)
    phase = over_phase(drawn, "cd/m²")
    figures = [over_time(drawn, "cd/m²"), *([] if phase is None else [phase])]
    text = f"Patches at each exposure time. {_drawn_text(regions)} No compliance with IEEE 2020 is claimed."
    return Section("Flicker", [*result.tables_named("flicker"), text, *figures])


def _summary(dataset: Dataset, regions: Sequence[RegionFlicker]) -> str:
    numbers, first = dataset["frame"].values, regions[0].flicker
    method = str(dataset.attrs["method"])
    how = METHODS.get(method, f"tracked ({method})")
    name = f"“{regions[0].region}”" if len(regions) == 1 else f"{len(regions)} regions"
    return printable(
        f"Flicker of {name}, {how}: {numbers.size} frames, number {span(str(numbers[0]), str(numbers[-1]))}. MMP "
        f"counts frames within {percent(first.tolerance)} of the mean, FDI those more than {percent(first.threshold)} "
        "above the light with the lamp off. No compliance with IEEE 2020 is claimed."
    )


def flicker_cards(regions: Sequence[RegionFlicker]) -> list[Card]:
    """Make a card for each index, with its worst region."""
    known = [region for region in regions if np.isfinite(region.flicker.mmp.value)]
    cards = []
    for name, title, worst in (
        ("mmp", "Modulation mitigation probability", min),
        ("fmi", "Flicker modulation index", max),
        ("fdi", "Flicker detection index", min),
    ):
        having = [region for region in known if np.isfinite(getattr(region.flicker, name).value)]
        if not having:
            continue
        region = worst(having, key=lambda region: getattr(region.flicker, name).value)
        index = getattr(region.flicker, name)
        low, high = index.interval
        few = region.flicker.few_phases and region.flicker.wave is not None
        cards.append(
            Card(
                title,
                f"{name.upper()} {fixed(index.value, 3)}",
                f"95 %: {span(fixed(low, 3), fixed(high, 3))}",
                (f"{'worst region: ' if len(regions) > 1 else 'region: '}{region.title}",),
                "too few phases" if few else "",
                "open" if few else "plain",
            )
        )
    return cards
