"""An archive of videos as files: one row for each video, and what failed."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from ....core.result import Result
from ....output import Destination, write_files
from ....report.envelope import envelope_json
from ....report.html import render_page
from ....report.layout import Card, Links, Page, Section, State
from ....report.sheets import result_workbook


def write_archive(result: Result, folder: Destination) -> list[Path]:
    """Write what became of the videos of an archive, each of which has its own folder.

    Everything is made before the first file is written; InputError is raised if one cannot be written.

    Returns
    -------
    list of Path
        archive.json, archive.html and archive.xlsx.
    """
    files = {
        "archive.json": envelope_json(result).encode(),
        "archive.html": render_page(archive_page(result)).encode(),
        "archive.xlsx": result_workbook(result, datetime.now(UTC)),
    }
    return write_files(folder, "video", files)


def archive_page(result: Result) -> Page:
    """Return the page of an archive."""
    videos = result.table("videos")
    done = [row["video"] for row in videos.rows() if row["error"] is None]
    state: State = "good" if len(done) == len(videos) else "bad"
    details = [table for table in result.tables if table.name not in ("videos", "contrasts")]
    return Page(
        "CDP of videos",
        "Archive of videos",
        cards=[Card("Videos", f"{len(done)} of {len(videos)}", "evaluated", state=state)],
        lead=(videos,),
        findings=result.findings,
        sections=[
            Section("Pages of the videos", [Links([(name, f"{name}/report.html") for name in done])]),
            *(Section(table.title, [table], collapsed=True) for table in details),
        ],
    )
