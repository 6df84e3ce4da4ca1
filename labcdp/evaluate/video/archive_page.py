"""Outcomes of the videos of an archive, as tables and as a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from ...core.result import Finding, InputFile, Result, error
from ...core.table import Column, Table
from ...report.files import envelope_json
from ...report.html import render_page
from ...report.layout import Card, Links, Page, Section, State
from ...report.sheets import result_workbook
from ...report.text import fixed
from ..judgement import COLUMNS, requirement_cards
from .archive import ArchiveResult, VideoOutcome
from .findings import LOST
from .result import CONTRASTS, REGIONS

#: Rows of the table of videos that is shown at once, and videos with the lowest share that are named.
_MOST_ROWS = 12
_VIDEO = Column("video", "video", meaning="Name of the folder of its results.")
_VIDEOS = (
    _VIDEO,
    Column("path", "path", meaning="The video.", shown=False),
    Column("folder", "folder", meaning="The folder of its results.", shown=False),
    Column("n_frames", "chosen frames", meaning="Chosen frames, those without a result included.", decimals=0),
    # Of the reference contrast, or else of the first one.
    *(replace(column, shown=column.shown and column.name != "lowest_frame") for column in CONTRASTS),
    Column("lost_share", "lost", "%", "Largest share of the chosen frames in which a region was lost.", decimals=1),
    Column("resumed", "resumed", meaning="Whether the results are from an earlier run.", shown=False),
    Column("error", "error", meaning="Why it failed.", shown=False),
)


def archive_result(archive: ArchiveResult) -> Result:
    """Return a table with one row for each video, and one each with the rows of all videos' tables.

    Parameters
    ----------
    archive : ArchiveResult
        Of an archive whose videos were evaluated by `labcdp video`.
    """
    done = [outcome for outcome in archive.outcomes if outcome.values is not None]
    text = (
        f"{len(done)} of {len(archive.outcomes)} videos were evaluated, {sum(outcome.resumed for outcome in done)} of "
        "them in an earlier run. CDP refers to the reference contrast, otherwise to the first target contrast."
    )
    tables = [Table.of_items("videos", "Videos", _VIDEOS, map(_video, archive.outcomes), text)]
    for name, title, columns in (
        ("requirement", "Requirement", COLUMNS),
        ("contrasts", "CDP over the evaluated frames", CONTRASTS),
        ("regions", "Regions", REGIONS),
        ("lost", "Stretches in which a region was lost", LOST),
    ):
        rows = [{"video": outcome.task.folder.name, **row} for outcome in done for row in outcome_rows(outcome, name)]
        if rows:
            # Rows of results that were written hold the values by name.
            by_name = [replace(column, value="") for column in columns]
            tables.append(Table.of_items(name, title, (_VIDEO, *by_name), rows, detail=True))
    return Result(
        "video",
        f"{len(archive.outcomes)} videos",
        tuple(tables),
        archive_findings(archive),
        tuple(archive_inputs(done)),
        done[0].values["configuration"] if done and done[0].values is not None else {},
    )


def _video(outcome: VideoOutcome) -> Mapping[str, Any]:
    row = {
        "video": outcome.task.folder.name,
        "path": str(outcome.task.video),
        "folder": str(outcome.task.folder),
        "resumed": outcome.resumed,
        "error": outcome.error or None,
    }
    if outcome.values is None:
        return row
    n_frames = next(row["value"] for row in outcome_rows(outcome, "summary"))
    lost = [region["lost_share"] for region in outcome_rows(outcome, "regions")]
    return {**row, "n_frames": n_frames, **outcome_rows(outcome, "contrasts")[0], "lost_share": max(lost, default=None)}


def archive_findings(archive: ArchiveResult) -> tuple[Finding, ...]:
    """Return why videos failed, and the findings about processes that died."""
    # Most reasons name the file.
    failures = (
        error("video-failed", reason=outcome.error if path in outcome.error else f"{path}: {outcome.error}", path=path)
        for outcome in archive.failures
        for path in (str(outcome.task.video),)
    )
    return *failures, *archive.findings


def outcome_rows(outcome: VideoOutcome, table: str) -> list[dict[str, Any]]:
    """Return the rows of a table of a video's result; none if it has no such table."""
    assert outcome.values is not None
    rows: list[dict[str, Any]] = outcome.values["tables"].get(table, {"rows": []})["rows"]
    return rows


def archive_inputs(done: Sequence[VideoOutcome]) -> Iterator[InputFile]:
    """Yield the files that results were made from, each once."""
    inputs = {}
    for outcome in done:
        assert outcome.values is not None
        for file in outcome.values["inputs"]:
            path = str(outcome.task.video) if file["role"] == "video" else file["path"]
            inputs[file["role"], path] = InputFile(file["role"], path, file["sha256"])
    yield from inputs.values()


def archive_files(result: Result, page: Page | None = None) -> dict[str, bytes]:
    """Return the files about all videos of an archive; each video has a folder of its own.

    Parameters
    ----------
    result : Result
        Of the archive.
    page : Page or None
        Its page; None for that of CDP.

    Returns
    -------
    dict of str to bytes
        archive.json, archive.html and archive.xlsx.
    """
    return {
        "archive.json": envelope_json(result).encode(),
        "archive.html": render_page(page or archive_page(result)).encode(),
        "archive.xlsx": result_workbook(result, datetime.now(UTC)),
    }


def archive_page(result: Result) -> Page:
    """Return the page of an archive."""
    videos = result.table("videos")
    done = [row["video"] for row in videos.rows() if row["error"] is None]
    pages = [(name, f"{name}/report.html") for name in done]
    state: State = "good" if len(done) == len(videos) else "bad"
    first = Card("Videos", f"{len(done)} of {len(videos)}", "evaluated", state=state)
    is_long = len(videos) > _MOST_ROWS
    details = [table for table in result.tables if table.name not in ("videos", "contrasts")]
    return Page(
        "CDP of videos",
        "Archive of videos",
        cards=[first, *requirement_cards(result), *_over_all(videos)],
        lead=() if is_long else (videos,),
        findings=result.findings,
        sections=[
            *([Section("Videos with the lowest share", [Links(_worst(videos))])] if is_long else []),
            *([Section("All videos", [videos], collapsed=True)] if is_long else []),
            Section("Pages of the videos", [Links(pages)], collapsed=is_long),
            *(Section(table.title, [table], collapsed=True) for table in details),
        ],
    )


def _over_all(videos: Table) -> Iterator[Card]:
    """Yield the card of the shares of frames in which the contrast is detected: mean, spread and worst video."""
    rows = [row for row in videos.sorted_by("detected_share").rows() if row["detected_share"] is not None]
    if not rows:
        return
    shares = np.array([row["detected_share"] for row in rows])
    spread = f", standard deviation {fixed(100 * float(shares.std(ddof=1)), 1)} %" if len(rows) > 1 else ""
    n_lost, n_frames = (sum(row[name] for row in rows) for name in ("n_lost", "n_frames"))
    yield Card(
        "Detected",
        f"{fixed(100 * float(shares.mean()), 1)} %",
        f"mean share of the evaluated frames of a video{spread}",
        (
            f"lowest {fixed(100 * rows[0]['detected_share'], 1)} %: {rows[0]['video']}",
            f"{n_lost} of {n_frames} chosen frames lost to tracking",
            f"detected if CDP ≥ {rows[0]['cdp_limit']:g}",
        ),
    )


def _worst(videos: Table) -> list[tuple[str, str]]:
    """Return the pages of the videos with the lowest share."""
    rows = [row for row in videos.sorted_by("detected_share").rows() if row["detected_share"] is not None]
    return [
        (f"{row['video']}: detected in {fixed(100 * row['detected_share'], 1)} %", f"{row['video']}/report.html")
        for row in rows[:_MOST_ROWS]
    ]
