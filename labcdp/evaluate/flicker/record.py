"""Light of regions in each frame of a video."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from itertools import islice
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk.journal import Row
from ...core.errors import InputError
from ...core.result import Finding, InputFile, warning
from ...core.table import Column, attributes_of, values_of
from ...files.video.selection import Position, Selection
from ...files.video.source import VideoSource
from ...metrics.region import SATURATED_SHARE
from ...output import Destination, results_journal
from ...tracking import TrackedRoi
from ..picture.converter import Converter
from ..video.dataset import (
    FINDINGS,
    LIGHT,
    NOTE,
    TIME,
    TRACKING_COLUMNS,
    as_json,
    findings_text,
    note_text,
    recorded,
    restored,
)
from ..video.evaluate import JOURNAL, converter_findings, opened_for, require_regions_in
from ..video.findings import video_findings
from ..video.run import PartRun, TrackedFrame, VideoRun, is_end, region_mean
from ..video.settings import Progress, evaluation_head, video_configuration
from .settings import FlickerSettings, off_frames_error

if TYPE_CHECKING:
    from xarray import Dataset

#: Over frame and region; a row of the journal has a list of each.
FRAME_COLUMNS = (
    Column("mean", "mean", LIGHT, "Mean luminance; missing where the region is lost, saturated or black."),
    Column("saturated", "saturated", "%", "Share of saturated pixels.", 2),
    Column("black", "black", "", "Whether the region has no light: 1 or 0.", decimals=0),
    *TRACKING_COLUMNS,
)


class RegionRun(PartRun):
    """Evaluates frames for any number of regions by themselves."""

    def _row(self, item: TrackedFrame, regions: Sequence[TrackedRoi]) -> Row:
        frame, n = item.frame, len(self.settings.rois)
        row: Row = {"frame": frame.number, "time_s": frame.time_s}
        row |= {column.name: [nan] * n for column in FRAME_COLUMNS} | {"lost": [False] * n, "black": [False] * n}
        findings: list[Finding] = [] if frame.fault is None else [frame.fault]
        if frame.pixels is None or not regions:
            return row | {"findings": recorded(findings)}
        row |= values_of(TRACKING_COLUMNS, regions)
        for index, tracked in enumerate(regions):
            if tracked.lost:
                findings += tracked.reasons
                continue
            try:
                mean, saturated = region_mean(frame, self._converter, tracked.roi)
            except InputError as error:
                findings.append(warning("frame-not-evaluated", reason=" ".join(str(error).split())))
                continue
            row["saturated"][index], row["black"][index] = saturated, not mean > 0
            if saturated <= SATURATED_SHARE and mean > 0:
                row["mean"][index] = mean
        if item.repeats is not None:
            findings.append(warning("frame-repeated", of_frame=item.repeats))
        findings += [] if frame.note is None else [frame.note]
        return row | {"findings": recorded(findings)}


def record_regions(
    path: str | Path,
    settings: FlickerSettings,
    folder: Destination | None = None,
    *,
    progress: Progress | None = None,
) -> Dataset:
    """Measure regions in each frame of a video.

    Parameters
    ----------
    path : str or Path
        A video, as `labcdp.evaluate.video.evaluate.evaluate_video` takes it.
    settings : FlickerSettings
        Regions, light and frames.
    folder : path, ResultsFolder or None
        For the journal, by which an interrupted evaluation is resumed; None for none.
    progress : callable or None
        Called for each frame.

    Returns
    -------
    xarray.Dataset
        Over frame and region: mean, share of saturated pixels, whether it is black, and tracking; nan where there is
        no value, with the reason as ``note``.

    Raises
    ------
    InputError
        If the video or a region cannot be used, no frame has a value, or the frequency of a lamp is given for images
        that state no times.
    CalibrationError
        If the calibration is not for such frames.
    """
    source, converter = opened_for(path, settings)
    require_regions_in(source, settings)
    if settings.frequency_hz is not None and any(finding.code == "image-sequence" for finding in source.findings):
        raise InputError(
            f"{source.path}: the images state no times, which the frequency of the lamp needs: give the frame rate, too"
        )
    _require_off_frames(source, settings)
    head = {"video": source.sha256, "flicker": True, **evaluation_head(settings, None)}
    with results_journal(folder, "video", JOURNAL, head, "evaluation") as journal:
        part = RegionRun(settings, converter, None, journal, None)
        VideoRun(source, converter, [part]).run(progress)
        n_frames = len(journal) - (part.end is not None)
        rows = list(islice(journal.rows(), n_frames))
        rows = [*_earlier_off_frames(source, converter, settings, rows[0]["frame"]), *rows]
        columns = _columns(rows, len(settings.rois))
        if not np.isfinite(columns["mean"]).any():
            journal.discard()
            raise InputError(
                f"{source.path}: no region has a value in any frame: they are lost, saturated or black. Track them "
                "with --method fixed if the camera is at rest, or take an exposure at which they are not saturated"
            )
    about_frames = {"frame": columns["frame"], "findings": columns["findings"], "invalid": np.empty(0, dtype=object)}
    findings = [*source.findings, *converter_findings(converter, source), *video_findings(about_frames, ())]
    files = {"calibration": settings.calibration, "camera": settings.camera}
    attributes = {
        "title": "flicker of a video",
        "file": source.path.name,
        "sha256": source.sha256,
        "inputs": as_json([asdict(InputFile.of(role, file)) for role, file in files.items() if file is not None]),
        "method": settings.method,
        "unit": converter.unit,
        "conversion": converter.description,
        "findings": as_json(recorded(findings)),
        "versions": as_json(head["versions"]),
        "configuration": as_json(flicker_configuration(settings)),
    }
    return _dataset(columns, [roi.name for roi in settings.rois], converter.unit, attributes)


def _earlier_off_frames(source: VideoSource, converter: Converter, settings: FlickerSettings, start: int) -> list[Row]:
    """Measure the frames with the lamp off before the `start`, whose regions are where they are in that frame."""
    if settings.off_frames is None or settings.off_frames[0] >= start:
        return []
    first, stop = settings.off_frames
    before = Selection(Position(frames=first), Position(frames=min(stop, start)))
    with results_journal(None, "video", JOURNAL, {}, "evaluation") as journal:
        part = RegionRun(replace(settings, method="fixed", selection=before), converter, None, journal, None)
        VideoRun(source, converter, [part]).run(None)
        return [row for row in journal.rows() if not is_end(row)]


def _require_off_frames(source: VideoSource, settings: FlickerSettings) -> None:
    """Refuse frames with the lamp off that are none of those evaluated, or all, before the first one."""
    if settings.off_frames is None or source.is_estimate:
        return
    chosen = settings.selection
    stop_before = None if chosen.stop is None else chosen.stop.frames
    ends = [end for end in (source.frame_count, stop_before) if end is not None]
    begin, end = chosen.start.frames or 0, min(ends, default=None)
    first, stop = settings.off_frames
    if end is not None and (first >= end or (first <= begin and stop >= end)):
        raise off_frames_error(first, stop, begin, end - 1)


def flicker_configuration(settings: FlickerSettings) -> dict[str, Any]:
    """Return the settings that determine the results, as values JSON can hold."""
    return {
        **video_configuration(settings, None),
        "off_frames": None if settings.off_frames is None else list(settings.off_frames),
        "threshold": settings.threshold,
        "tolerance": settings.tolerance,
        "frequency_hz": settings.frequency_hz,
    }


def _columns(rows: Sequence[Row], n_regions: int) -> dict[str, NDArray[Any]]:
    """Return the rows of the journal as an array for each key."""
    columns: dict[str, NDArray[Any]] = {
        column.name: np.array([row[column.name] for row in rows], dtype=np.float64).reshape(len(rows), n_regions)
        for column in FRAME_COLUMNS
    }
    columns["frame"] = np.array([row["frame"] for row in rows], dtype=np.int64)
    columns["time_s"] = np.array([row["time_s"] for row in rows], dtype=np.float64)
    findings = np.empty(len(rows), dtype=object)
    findings[:] = [restored(row["findings"]) for row in rows]
    return columns | {"findings": findings}


def _dataset(
    columns: dict[str, NDArray[Any]], regions: Sequence[str], unit: str, attributes: dict[str, Any]
) -> Dataset:
    import xarray as xr

    data: dict[str, Any] = {}
    for column in FRAME_COLUMNS:
        values = columns[column.name]
        values = values.astype(bool) if column.name in ("lost", "black") else values
        with_unit = replace(column, unit=unit) if column.unit == LIGHT else column
        data[column.name] = (("frame", "region"), values, attributes_of(with_unit, values))
    for column, text in ((NOTE, note_text), (FINDINGS, findings_text)):
        texts = np.array([text(findings) for findings in columns["findings"]], dtype=object)
        data[column.name] = ("frame", texts, attributes_of(column, texts))
    times = columns["time_s"]
    data[TIME.name] = ("frame", times, attributes_of(TIME, times))
    coordinates = {"frame": columns["frame"], "region": np.array(regions, dtype=object)}
    return xr.Dataset(data, coordinates, attributes).set_coords(TIME.name)
