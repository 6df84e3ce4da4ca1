"""Flicker of several videos: each has its results, and all together have a table and a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...core.errors import LabcdpError
from ...core.result import Result
from ...core.table import Column, Table
from ...output import ResultsFolder
from ...report.files import envelope
from ...report.layout import Card, Links, Page, Section
from ...report.text import fixed
from ..video.archive import ArchiveResult, VideoOutcome
from ..video.archive_page import archive_findings, archive_inputs, outcome_rows
from .page import evaluate_flicker, write_flicker
from .settings import FlickerSettings
from .tables import region_columns

_VIDEO = Column("video", "video", meaning="Name of the folder of its results.")
_VIDEOS = (
    _VIDEO,
    Column("path", "path", meaning="The video.", shown=False),
    Column("n_regions", "regions", meaning="Regions that have a value.", decimals=0),
    Column("mmp", "lowest MMP", meaning="Of the regions.", decimals=4),
    Column("fmi", "highest FMI", meaning="Of the regions.", decimals=4),
    Column("fdi", "lowest FDI", meaning="Of the regions that have one.", decimals=4),
    Column("n_few_phases", "too few phases", meaning="Regions of which too few phases were seen.", decimals=0),
    Column("resumed", "resumed", meaning="Whether the results are from an earlier run.", shown=False),
    Column("error", "error", meaning="Why it failed.", shown=False),
)


def flicker_values(
    settings: FlickerSettings, path: Path, folders: Mapping[str, ResultsFolder]
) -> dict[str, dict[str, Any] | LabcdpError]:
    """Evaluate a video of an archive and write its results; return them as JSON values, which other processes take."""
    (folder,) = folders.values()
    return {"": envelope(write_flicker(*evaluate_flicker(path, settings, folder), folder))}


def flicker_archive(archive: ArchiveResult) -> Result:
    """Return a table with a row for each video, and one with the regions of all."""
    done = [outcome for outcome in archive.outcomes if outcome.values is not None]
    text = (
        f"{len(done)} of {len(archive.outcomes)} videos were evaluated, {sum(o.resumed for o in done)} of them earlier."
    )
    videos = Table.of_items("videos", "Videos", _VIDEOS, map(_video, archive.outcomes), text)
    rows = [{"video": outcome.task.folder.name, **row} for outcome in done for row in outcome_rows(outcome, "flicker")]
    columns = [replace(column, value="") for column in region_columns("")]
    regions = Table.of_items("flicker", "Flicker of the regions", (_VIDEO, *columns), rows, detail=True)
    configuration = done[0].values["configuration"] if done and done[0].values is not None else {}
    return Result(
        "video",
        f"{len(archive.outcomes)} videos",
        (videos, *((regions,) if rows else ())),
        archive_findings(archive),
        tuple(archive_inputs(done)),
        configuration,
    )


def _video(outcome: VideoOutcome) -> dict[str, Any]:
    row: dict[str, Any] = {
        "video": outcome.task.folder.name,
        "path": str(outcome.task.video),
        "resumed": outcome.resumed,
        "error": outcome.error or None,
    }
    regions = [] if outcome.values is None else outcome_rows(outcome, "flicker")
    known = [region for region in regions if region["mmp"] is not None]
    if known:
        row |= {"n_regions": len(known), "n_few_phases": sum(region["few_phases"] for region in known)}
        for name, worst in (("mmp", min), ("fmi", max), ("fdi", min)):
            row[name] = worst((region[name] for region in known if region[name] is not None), default=None)
    return row


def flicker_archive_page(result: Result) -> Page:
    """Return the page of the flicker of several videos."""
    videos = result.table("videos")
    done = [row for row in videos.rows() if row["error"] is None]
    cards = [
        Card(
            "Videos", f"{len(done)} of {len(videos)}", "evaluated", state="good" if len(done) == len(videos) else "bad"
        )
    ]
    for name, title, worst in (
        ("mmp", "Modulation mitigation probability", min),
        ("fmi", "Flicker modulation index", max),
    ):
        known = [row for row in done if row[name] is not None]
        if known:
            row = worst(known, key=lambda row: row[name])
            cards.append(Card(title, f"{name.upper()} {fixed(row[name], 3)}", f"worst video: {row['video']}"))
    links = [(row["video"], f"{row['video']}/report.html") for row in done]
    return Page(
        "Flicker of videos",
        "Archive of videos",
        cards=cards,
        lead=(videos,),
        findings=result.findings,
        sections=[
            Section("Pages of the videos", [Links(links)]),
            *(Section(table.title, [table], collapsed=True) for table in result.tables_named("flicker")),
        ],
    )
