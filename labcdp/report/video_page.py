"""A video's results as a page."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from .digits import fixed, percent, printable, share_percent, significant
from .document import Document, Section
from .figures import ReportFigure
from .page import document_page
from .tables import Table
from .video_figure import drawn_contrasts, frames_of_a_point, video_figure
from .video_summary import SEEN_CDP, ContrastSummary, VideoSummary
from .video_wording import (
    configuration,
    contrast_name,
    measured,
    of_neighbours,
    provenance,
    results,
    seconds,
    title,
    unit_text,
)

if TYPE_CHECKING:
    from xarray import Dataset

#: More rows than this are left to the spreadsheet.
_MOST_ROWS = 60


def video_page(dataset: Dataset, summary: VideoSummary, figure: ReportFigure) -> str:
    """Write the page, with its figure inside; all text is escaped."""
    sections = [
        Section(paragraphs=(measured(dataset, summary), " ".join(results(dataset, summary)).replace(" %", "\u00a0%"))),
        Section("Over time", figures=(figure,)),
        Section("Contrasts", _about_contrasts(dataset), [("CDP over all frames", contrasts_table(summary))]),
        *_following(dataset, summary),
        *_without_result(summary),
        Section("Provenance", facts=provenance(dataset)),
        Section("Settings", text=configuration(dataset)),
    ]
    warnings = [printable(text) for text in summary.warnings]
    return document_page(Document("labcdp report: CDP of a video", title(dataset), "", warnings, sections))


def over_time(dataset: Dataset) -> ReportFigure:
    """Draw the figure, with its caption."""
    parts = [f"CDP with its 95\u00a0% interval; the dotted line is {SEEN_CDP:g}."]
    if len(drawn_contrasts(dataset)) + 1 < dataset.sizes["contrast"]:
        parts.append(f"Of the {dataset.sizes['contrast']} contrasts some are drawn.")
    if "measured_contrast" in dataset:
        parts.append("Below: Weber contrast of the regions' means with its 95\u00a0% interval.")
    if "quality" in dataset:
        parts.append("At the bottom: how well each region was found again, from 0 to 1.")
    if not dataset["cdp"].notnull().any("contrast").all():
        parts.append("Shaded: frames without a result.")
    if (number := frames_of_a_point(dataset)) > 1:
        parts.append(
            f"Each drawn point stands for {number} frames: the line is their mean, the band reaches from the lowest "
            "to the highest end of their intervals."
        )
    alternative = "Curves of CDP, measured contrast and quality over time."
    return ReportFigure("over-time.png", video_figure(dataset), " ".join(parts), alternative)


def contrasts_table(summary: VideoSummary) -> Table:
    """CDP of each contrast over all frames."""
    main = [] if summary.reference is None else [_contrast_row(summary.reference, True)]
    return Table(
        ("contrast", f"frames with CDP ≥ {SEEN_CDP:g}", "evaluated frames", "mean CDP", "lowest CDP", "in frame"),
        (*main, *(_contrast_row(one, False) for one in summary.contrasts)),
    )


def _contrast_row(one: ContrastSummary, is_reference: bool) -> tuple[str, ...]:
    name = contrast_name(one, True) if is_reference or one.contrast is None else percent(one.contrast)
    if one.lowest_frame is None:
        return name, "-", "0", "-", "-", "-"
    share = f"{one.n_seen} ({share_percent(one.seen_share)})"
    return name, share, str(one.n_evaluated), fixed(one.mean, 4), fixed(one.lowest, 4), str(one.lowest_frame)


def _about_contrasts(dataset: Dataset) -> tuple[str, ...]:
    pairs = "all pairs of neighbouring pixels" if of_neighbours(dataset) else "all pairs of a bright and a dark pixel"
    return (
        f"CDP is the share of {pairs} whose Weber contrast lies within the tolerance around the contrast asked for. "
        "Shares are of all frames; one without a result counts as not seen. Mean and lowest are of the others.",
    )


def _following(dataset: Dataset, summary: VideoSummary) -> Iterable[Section]:
    if not summary.regions:
        return
    regions = Table(
        (
            "region",
            f"mean ({unit_text(dataset)})",
            "SNR (mean / standard deviation)",
            "mean quality",
            "lowest quality",
            "frames in which it was lost",
        ),
        tuple(
            (
                printable(one.name),
                significant(one.mean),
                significant(one.mean_snr),
                fixed(one.mean_quality, 3),
                fixed(one.lowest_quality, 3),
                f"{one.n_lost} ({share_percent(one.n_lost / summary.n_frames)})",
            )
            for one in summary.regions
        ),
    )
    tables = [("Regions, over the frames in which they were found", regions)]
    text = ["A region that cannot be found again is lost: its frames have no CDP, rather than one of a wrong place."]
    if summary.lost:
        tables.append(("Stretches in which a region was lost", lost_table(summary)))
        if len(summary.lost) > _MOST_ROWS:
            text.append(f"The first {_MOST_ROWS} of {len(summary.lost)} stretches are shown; the spreadsheet has all.")
    yield Section("Regions", text, tables)


def lost_table(summary: VideoSummary) -> Table:
    """Where regions were lost, and for how long."""
    return Table(
        ("region and reason", "first frame", "last frame", "frames", "from", "for"),
        tuple(
            (
                printable(f"{one.region}: {one.reason}" if one.reason else one.region),
                str(one.first),
                str(one.last),
                str(one.n_frames),
                seconds(one.start_s),
                seconds(one.duration_s),
            )
            for one in summary.lost[:_MOST_ROWS]
        ),
    )


def _without_result(summary: VideoSummary) -> Iterable[Section]:
    if summary.notes:
        rows = tuple((printable(note), str(number)) for note, number in summary.notes[:_MOST_ROWS])
        reasons = Table(("note, of the first such frame", "frames"), rows)
        yield Section("Notes on frames", tables=[("Why values are missing, and what to mind", reasons)])
