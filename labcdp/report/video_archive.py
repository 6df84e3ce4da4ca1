"""An archive of videos as files: one line for each video, and what failed."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..json_text import results_json
from .digits import fixed, printable, share_percent
from .document import Document, Section
from .facts import Fact
from .folder import write_files
from .page import document_page
from .tables import Table
from .video_summary import SEEN_CDP
from .workbook import Cell, Number, Sheet, workbook

if TYPE_CHECKING:
    from ..evaluate.archive import ArchiveResult, VideoOutcome

_TITLE = "Archive of videos"


def write_archive(result: ArchiveResult, folder: str | PathLike[str]) -> list[Path]:
    """Write what became of the videos of an archive; each video's own results are in its folder.

    Parameters
    ----------
    result : ArchiveResult
        Of an archive whose videos were evaluated by `evaluate_videos`.
    folder : path
        Made if it does not exist; files of an earlier run are replaced.

    Returns
    -------
    list of Path
        archive.json, archive.html and archive.xlsx.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    files = {
        "archive.json": results_json(archive_values(result)).encode(),
        "archive.html": document_page(_document(result)).encode(),
        "archive.xlsx": workbook(_sheets(result), _TITLE, datetime.now(UTC)),
    }
    return write_files(Path(folder), files)


def archive_values(result: ArchiveResult) -> dict[str, Any]:
    """Return what became of the videos, for JSON."""
    return {
        "n_videos": len(result.outcomes),
        "n_failed": len(result.failures),
        "videos": [
            {
                "video": str(outcome.task.video),
                "folder": str(outcome.task.folder),
                "error": outcome.error or None,
                "resumed": outcome.resumed,
                "results": outcome.values,
            }
            for outcome in result.outcomes
        ],
        "notes": list(result.notes),
    }


def archive_table(result: ArchiveResult) -> Table:
    """One row for each video that was evaluated."""
    head = ("video", "frames", "contrast (%)", f"frames with CDP ≥ {SEEN_CDP:g}", "mean CDP", "lowest CDP", "lost")
    return Table(
        head, tuple(_row(outcome, outcome.values) for outcome in result.outcomes if outcome.values is not None)
    )


def _main(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the reference contrast of a video, or else the first one asked for."""
    main: Mapping[str, Any] = values["reference"] or values["contrasts"][0]
    return main


def _lost_share(values: Mapping[str, Any]) -> float | None:
    """Share of the frames in which the region that was lost more often was; None from pixel to pixel."""
    return (
        max((one["n_lost"] for one in values["regions"]), default=0) / values["n_frames"] if values["regions"] else None
    )


def _row(outcome: VideoOutcome, values: Mapping[str, Any]) -> tuple[str, ...]:
    main, lost = _main(values), _lost_share(values)
    return (
        printable(outcome.task.folder.name),
        str(values["n_frames"]),
        "changes" if main["contrast"] is None else f"{100 * main['contrast']:.4g}",
        share_percent(main["seen_share"]),
        fixed(main["mean"], 3),
        fixed(main["lowest"], 3),
        "-" if lost is None else share_percent(lost),
    )


def _document(result: ArchiveResult) -> Document:
    done = [outcome for outcome in result.outcomes if outcome.values is not None]
    resumed = sum(outcome.resumed for outcome in done)
    text = f"{len(done)} of {len(result.outcomes)} videos were evaluated"
    text += f", {resumed} of them in an earlier run." if resumed else "."
    about = (
        "For each video: its frames, and of the reference contrast, or else of the first one asked for, the share of "
        f"the frames with a CDP of {SEEN_CDP:g} or more, mean and lowest CDP; and the share of the frames in which a "
        "region was lost."
    )
    sections = [Section(paragraphs=(text, about))]
    if result.failures:
        failures = [Fact(printable(one.task.video.name), printable(one.error)) for one in result.failures]
        sections.append(Section("Failures", facts=failures))
    if done:
        sections.append(Section("Videos", tables=[("One row for each video", archive_table(result))]))
        pages = [(printable(one.task.folder.name), f"{one.task.folder.name}/report.html") for one in done]
        sections.append(Section("Pages of the videos", pages=pages))
    banner = f"{len(result.failures)} of {len(result.outcomes)} videos failed." if result.failures else ""
    return Document(
        "labcdp report: CDP of videos", _TITLE, banner, [printable(note) for note in result.notes], sections
    )


def _sheets(result: ArchiveResult) -> list[Sheet]:
    header = (
        "video",
        "folder",
        "frames",
        "contrast in %",
        f"share of frames with CDP ≥ {SEEN_CDP:g}",
        "evaluated frames",
        "mean CDP",
        "lowest CDP",
        "in frame",
        "share of frames with a lost region",
        "error",
    )
    rows = [_cells(outcome) for outcome in result.outcomes]
    return [Sheet("Videos", header, rows), Sheet("Workers", ("note",), [(note,) for note in result.notes])]


def _cells(outcome: VideoOutcome) -> tuple[Cell, ...]:
    names = (str(outcome.task.video), outcome.task.folder.name)
    values = outcome.values
    if values is None:
        return (*names, *(None,) * 8, outcome.error)
    main = _main(values)
    return (
        *names,
        Number(values["n_frames"], 0),
        _number(main["contrast"], 2, 100.0),
        Number(main["seen_share"], 4),
        Number(main["n_evaluated"], 0),
        _number(main["mean"], 4),
        _number(main["lowest"], 4),
        _number(main["lowest_frame"], 0),
        _number(_lost_share(values), 4),
        None,
    )


def _number(value: float | None, n_decimals: int, factor: float = 1.0) -> Number | None:
    return None if value is None else Number(value * factor, n_decimals)
