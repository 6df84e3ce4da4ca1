"""Evaluation of a chart in a video."""

from __future__ import annotations

import hashlib
import json
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...core.disk.text import json_values
from ...core.errors import InputError
from ...core.result import InputFile, warning
from ...core.roi import Roi
from ...files.video.source import VideoSource, frames_of
from ...output import Destination, results_journal
from ...regions.chart import Chart
from ..picture.converter import Converter
from ..video.dataset import as_json, recorded
from ..video.evaluate import JOURNAL, converter_findings, opened_for, require_regions_in
from ..video.findings import video_findings
from ..video.run import VideoRun
from ..video.settings import Progress, evaluation_head
from .over_frames import chart_dataset
from .run import ChartRun
from .settings import ChartVideoSettings

if TYPE_CHECKING:
    from xarray import Dataset


def evaluate_chart_video(
    path: str | Path,
    settings: ChartVideoSettings,
    folder: Destination | None = None,
    *,
    progress: Progress | None = None,
) -> Dataset:
    """Evaluate a chart in each frame of a video.

    Parameters
    ----------
    path : str or Path
        A video, as `labcdp.evaluate.video.evaluate.evaluate_video` takes it.
    settings : ChartVideoSettings
        Chart, light and frames.
    folder : path, ResultsFolder or None
        For the journal, by which an interrupted evaluation is resumed; None for none.
    progress : callable or None
        Called for each frame.

    Returns
    -------
    xarray.Dataset
        As of `labcdp.evaluate.chart_video.over_frames.chart_dataset`.

    Raises
    ------
    InputError
        If the video or the chart cannot be used, the chart is not found in the first frame, or it is measured in none.
    CalibrationError
        If the calibration is not for such frames.
    """
    source, converter = opened_for(path, settings)
    settings = _with_regions(source, converter, settings)
    require_regions_in(source, settings)
    chart = settings.patches
    head = {"video": source.sha256, "chart": _sha256(chart), **evaluation_head(settings, None)}
    with results_journal(folder, "video", JOURNAL, head, "evaluation") as journal:
        part = ChartRun(settings, converter, journal)
        VideoRun(source, converter, [part]).run(progress)
        if part.failure is not None:
            raise part.failure
        n_frames = len(journal) - (part.end is not None)
        dataset = chart_dataset(journal.rows(), n_frames, settings, part.contrast_of_pairs(), converter.unit)
        if not dataset["n_frames"].values.any():
            journal.discard()
            why = next((text for text in dataset["note"].values.tolist() if text), "")
            raise InputError(f"{source.path}: the chart could not be measured in any frame{why and f': {why}'}")
    about_frames = {
        "frame": dataset["frame"].values, "findings": dataset.attrs.pop("frame_findings"),
        "invalid": np.empty(0, dtype=object),
    }  # fmt: skip
    findings = [*source.findings, *converter_findings(converter, source), *video_findings(about_frames, ())]
    if not chart.is_stated:
        findings.append(warning("chart-not-stated"))
    # Of single frames it is in their notes; of most it says that the corners or the chart are wrong.
    in_wrong_order = [each for of_frame in about_frames["findings"] for each in of_frame if each.code == "chart-order"]
    if 2 * len(in_wrong_order) > int(np.isfinite(dataset["mean"].values).any(axis=1).sum()):
        findings.append(in_wrong_order[0])
    files = {"calibration": settings.calibration, "camera": settings.camera}
    inputs = [*settings.inputs, *(InputFile.of(role, file) for role, file in files.items() if file is not None)]
    return dataset.assign_attrs(
        title="chart in a video",
        file=source.path.name,
        sha256=source.sha256,
        inputs=as_json([asdict(file) for file in inputs]),
        method=settings.method,
        conversion=converter.description,
        findings=as_json(recorded(findings)),
        versions=as_json(head["versions"]),
        configuration=as_json({**head["settings"], "chart": chart.name}),
    )


def _sha256(chart: Chart) -> str:
    """Hash of all that a chart states."""
    return hashlib.sha256(json.dumps(json_values(asdict(chart)), sort_keys=True).encode()).hexdigest()


def _with_regions(source: VideoSource, converter: Converter, settings: ChartVideoSettings) -> ChartVideoSettings:
    """Return the settings with the patches where the marks of the chart are in the first frame; raises InputError."""
    if settings.rois:
        return settings
    with closing(frames_of(source, settings.selection)) as frames:
        frame = next((frame.frame for frame in frames if frame.frame is not None), None)
    if frame is None:
        raise InputError(f"{source.path} has no frame that can be read from {settings.selection.start} on")
    luminance = converter.convert(frame)
    rois = settings.patches.found(luminance.luminance_cd_m2)
    scaled = [Roi(roi.name, tuple((x * luminance.step, y * luminance.step) for x, y in roi.corners)) for roi in rois]
    return replace(settings, rois=tuple(scaled))
