"""Evaluation of a video, frame by frame."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..sources.video import open_video
from .light import picture_conversion
from .video_checks import evaluation_head, require_regions
from .video_configuration import conversion_warnings
from .video_dataset import DatasetFrame, Findings, as_json, video_dataset
from .video_journal import VideoJournal
from .video_reference import make_reference
from .video_run import VideoRun, is_end, variables
from .video_settings import Observer, Progress, VideoSettings

if TYPE_CHECKING:
    from xarray import Dataset


def evaluate_video(
    path: Path,
    settings: VideoSettings,
    folder: Path | None = None,
    *,
    progress: Progress | None = None,
    observer: Observer | None = None,
) -> Dataset:
    """Evaluate a video frame by frame.

    Parameters
    ----------
    path : Path
        A file that OpenCV opens, a folder of images, or a recorded session.
    settings : VideoSettings
        What is to be evaluated.
    folder : Path or None
        For the journal, in which each frame's results are as soon as they are known: an evaluation that was broken off
        goes on with the same result. None for none.
    progress : callable or None
        Told of each frame.
    observer : callable or None
        Given each frame whose pixels are there, with its results, in order and in the same pass.

    Returns
    -------
    xarray.Dataset
        Over frame, contrast and region; nan where a region is lost or a frame is broken, with the reason as ``note``.

    Raises
    ------
    InputError
        If the video or a setting cannot be used, or the folder holds the journal of another evaluation or cannot be
        written.
    CalibrationError
        If the calibration is not for such frames.

    Notes
    -----
    A tracker sees every frame from the start of the selection on, also those that are not evaluated, as regions that
    have moved far are not found again. It is deterministic: when an evaluation goes on, the frames before are followed
    again and not evaluated again.
    """
    conversion = picture_conversion(settings.calibration, settings.camera, settings.encoding)
    told = {name: getattr(settings, name) for name in ("exposure_s", "gain_db", "bit_depth")}
    given: dict[str, Any] = {name: value for name, value in told.items() if value is not None}
    options = replace(conversion.options, **given, told=conversion.options.told | given.keys())
    source = open_video(path, options)
    if conversion.unit == "cd/m^2" and options.exposure_s is None and not source.exposure_stated:
        raise InputError(f"{path} does not say its exposure time: give it with --exposure")
    reference = make_reference(settings)
    head = {"video": source.sha256, **evaluation_head(settings, reference)}
    require_regions(source, settings)
    with ExitStack() as stack:
        where = folder or Path(stack.enter_context(TemporaryDirectory(prefix="labcdp-")))
        journal = VideoJournal.open(where, head)
        stack.callback(journal.close)
        run = VideoRun(source, settings, conversion, reference, journal)
        run.go(progress, observer)
        findings = Findings([roi.name for roi in settings.rois])
        for row in journal.rows():
            if not is_end(row):
                findings.add(row)
        if not findings.n_measured:
            # There is nothing to go on with: other settings may have the folder.
            journal.discard()
            raise InputError(f"{path}: no frame could be evaluated; {findings.first_note}")
        warnings = [*source.warnings, *conversion_warnings(conversion, source), *run.announced(), *findings.warnings]
        attrs = {
            "title": "contrast detection probability of a video",
            "file": path.name,
            "sha256": source.sha256,
            "mode": settings.mode,
            "method": settings.method if settings.rois else "none",
            "unit": conversion.unit,
            "epsilon": settings.epsilon if isinstance(settings.epsilon, float) else as_json(asdict(settings.epsilon)),
            "conversion": conversion.description,
            "notes": as_json(list(source.notes)),
            "warnings": as_json(warnings),
            "versions": as_json(head["versions"]),
            "configuration": as_json(head["settings"]),
        }
        about = DatasetFrame(settings.contrasts, tuple(roi.name for roi in settings.rois), conversion.unit, attrs)
        return video_dataset((variables(row) for row in journal.rows() if not is_end(row)), about)
