"""Evaluation of a video, frame by frame."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from itertools import islice, zip_longest
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...core.companding import Companding
from ...core.disk.files import shown
from ...core.disk.journal import recorded_head, stored_values
from ...core.errors import InputError, LabcdpError
from ...core.result import Finding, InputFile, info, warning
from ...core.roi import Roi
from ...files.doubts import MOSAIC
from ...files.frame import no_exposure
from ...files.video.open import open_video
from ...files.video.source import VideoSource
from ...metrics.detection import size_findings
from ...metrics.pair import require_apart, vignetting_findings
from ...output import Destination, results_journal
from ...report.text import finding_text
from ..picture.converter import Converter, encoding_findings, make_converter
from .dataset import as_json, frame_columns, recorded, video_dataset
from .findings import (
    first_finding,
    first_measured,
    period_s,
    reading_findings,
    second_is_brighter,
    varying_light_findings,
    video_findings,
)
from .run import PartRun, VideoRun
from .settings import Observer, Progress, VideoSettings, evaluation_head, load_reference

if TYPE_CHECKING:
    from xarray import Dataset

#: By how much earlier than a stated end the last frame may begin: in seconds and in frames, as lengths are rounded.
_LATEST_S, _LATEST_FRAMES = 0.5, 2
#: Name of the journal in the folder of the results.
JOURNAL = "video.jsonl"


def evaluate_video(
    path: str | Path,
    settings: VideoSettings,
    folder: Destination | None = None,
    *,
    progress: Progress | None = None,
    observer: Observer | None = None,
) -> Dataset:
    """Evaluate a video frame by frame.

    Parameters
    ----------
    path : str or Path
        A file that FFmpeg reads, a TIFF of several pages, a folder of images, or a recorded session.
    settings : VideoSettings
        Settings of the evaluation.
    folder : path, ResultsFolder or None
        For the journal, in which each frame's results are as soon as they are known: the same evaluation resumes an
        interrupted one with the same result. None for none.
    progress : callable or None
        Called for each frame.
    observer : callable or None
        Given each frame whose pixels are there, with its results, in order and in the same pass.

    Returns
    -------
    xarray.Dataset
        Over frame, contrast and region; nan where a region is lost or a frame is broken, with the reason as ``note``.
        The attribute ``findings`` holds what there is to know about the video, as JSON.

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
    have moved far are not found again. It is deterministic: when an evaluation is resumed, the frames before are
    followed again and not evaluated again.
    """
    (dataset,) = evaluate_parts(path, [settings], [folder], [observer], progress=progress)
    if isinstance(dataset, LabcdpError):
        raise dataset
    return dataset


def evaluate_parts(
    path: str | Path,
    settings: Sequence[VideoSettings],
    folders: Sequence[Destination | None] = (),
    observers: Sequence[Observer | None] = (),
    *,
    progress: Progress | None = None,
) -> list[Dataset | LabcdpError]:
    """Evaluate any number of pairs of regions of a video in one pass of decoding and following.

    All regions are followed together, so that those that move alike help each other.

    Parameters
    ----------
    path : str or Path
        As for `evaluate_video`.
    settings : sequence of VideoSettings
        One for each pair, or for nearest neighbours; they differ in regions, contrasts and reference only.
    folders, observers : sequence
        For each of them, as for `evaluate_video`; none by default.
    progress : callable or None
        Called for each frame.

    Returns
    -------
    list of Dataset or LabcdpError
        For each of the settings the results, or why there are none: no frame could be evaluated, or a region cannot be
        followed, which costs no other part.

    Raises
    ------
    InputError, CalibrationError
        As `evaluate_video`, if there are no results at all.
    """
    source, converter = opened_for(path, settings[0])
    together = sorted({roi.name for part_settings in settings for roi in part_settings.rois})
    with ExitStack() as stack:
        parts = []
        for part_settings, folder, observer in zip_longest(settings, folders, observers):
            reference = load_reference(part_settings)
            head = {"video": source.sha256, **evaluation_head(part_settings, reference)}
            if len(together) > len(part_settings.rois) > 0:
                head["followed_together"] = together
            journal = stack.enter_context(results_journal(folder, "video", JOURNAL, head, "evaluation"))
            part = PartRun(part_settings, converter, reference, journal, observer)
            try:
                _require_regions(source, part_settings)
            except InputError as error:
                part.failure = error
            parts.append(part)
        VideoRun(source, converter, parts).run(progress)
        return [_dataset_or_error(source, converter, part) for part in parts]


def _dataset_or_error(source: VideoSource, converter: Converter, part: PartRun) -> Dataset | LabcdpError:
    try:
        return _dataset(source, converter, part)
    except LabcdpError as error:
        return error


def opened_for(path: str | Path, settings: VideoSettings) -> tuple[VideoSource, Converter]:
    """Open a video, with the conversion of its frames that settings state; raises InputError."""
    if not isinstance(path, str | Path):
        raise InputError(f"the video is {shown(path)}: give the path of a file")
    converter = make_converter(settings.calibration, settings.camera, settings.encoding, **settings.stated)
    converter = replace(converter, options=replace(converter.options, damaged=settings.damaged))
    return opened_video(Path(path), converter)


def _dataset(source: VideoSource, converter: Converter, part: PartRun) -> Dataset:
    """Results of a part; raises InputError if there are none."""
    if part.failure is not None:
        raise part.failure
    settings, journal, regions = part.settings, part.journal, [roi.name for roi in part.settings.rois]
    n_frames = len(journal) - (part.end is not None)
    rows = islice(journal.rows(), n_frames)
    columns = frame_columns(
        rows, n_frames, len(part.contrasts), settings.rois, colours=settings.colours and bool(regions)
    )
    measured = first_measured(columns)
    if measured is None or np.isnan(part.contrasts).all():
        journal.discard()
        number, finding = first_finding(columns) or (0, None)
        why = f"; frame {number}: {finding_text(finding)}" if finding is not None else ""
        if measured is not None:
            why += "; no target contrast was given, and a saturated region gives none: specify a contrast"
        raise InputError(f"{source.path}: no frame could be evaluated{why}")
    relative = bool(regions) and converter.unit == "relative"
    readings = [*reading_findings(columns, regions, converter, source.doubts)] if relative else None
    n_pixels = {roi.name: int(roi.mask(source.shape).sum()) for roi in settings.rois}
    findings = [
        *source.findings,
        *converter_findings(converter, source, readings),
        *_length_findings(source, part),
        *video_findings(columns, regions),
        *varying_light_findings(columns, n_pixels, period_s(columns["time_s"])),
        *_vignetting_findings(source, converter, settings.rois),
    ]
    for name, size in n_pixels.items():
        findings += size_findings(name, size)
    if settings.contrasts is None:
        code = "contrast-measured" if settings.rois else "neighbour-contrast-measured"
        findings.insert(0, info(code, frame=measured, contrast=part.contrasts[0]))
    epsilon, head = settings.epsilon, evaluation_head(settings, part.reference)
    files = {"calibration": settings.calibration, "camera": settings.camera, "reference": settings.reference}
    inputs = [InputFile.of(role, path) for role, path in files.items() if isinstance(path, Path)]
    attributes = {
        "title": "contrast detection probability of a video",
        "file": source.path.name,
        "sha256": source.sha256,
        "inputs": as_json([asdict(file) for file in inputs]),
        "mode": settings.mode,
        "method": settings.method if settings.rois else "none",
        "unit": converter.unit,
        "epsilon": epsilon if isinstance(epsilon, float) else as_json(asdict(epsilon)),
        "conversion": converter.description,
        "findings": as_json(recorded(findings)),
        "versions": as_json(head["versions"]),
        "configuration": as_json(head["settings"]),
    }
    # The region that is brighter in the first frame that was measured comes first.
    brighter = second_is_brighter(columns)
    order = (1, 0) if brighter.size and brighter[0] else range(len(regions))
    return video_dataset(columns, part.contrasts, regions, order, converter.unit, attributes)


def _vignetting_findings(source: VideoSource, converter: Converter, rois: Sequence[Roi]) -> tuple[Finding, ...]:
    """Return a finding if the vignetting between the places of the regions in the first frame matters."""
    vignetting = converter.vignetting(source.shape, source.readout)
    if vignetting is None or not rois:
        return ()
    x_px, y_px = (np.array(centres) for centres in zip(*(roi.centre for roi in rois), strict=True))
    errors = (pattern.diagonal() for pattern in vignetting.patterns_at(source.shape, y_px, x_px))
    return vignetting_findings(rois[0].name, rois[1].name, hypot(*(first - second for first, second in errors)))


def _length_findings(source: VideoSource, part: PartRun) -> tuple[Finding, ...]:
    """Return a finding if the file announces another number of frames, or a greater length, than it has."""
    end = part.end or {}
    if source.length_s is not None and (last_s := end.get("last_s")) is not None:
        if source.length_s - last_s > _LATEST_S + _LATEST_FRAMES / (source.frame_rate or 1):
            return (warning("video-ends-early", length_s=source.length_s, found_s=last_s),)
        return ()
    announced, n_frames = None if source.is_estimate else source.frame_count, end.get("end")
    if announced is None or n_frames is None or announced == n_frames:
        return ()
    if n_frames < announced:
        return (warning("video-cut-off", announced=announced, found=n_frames),)
    return (info("video-longer", announced=announced, found=n_frames),)


def require_same_evaluation(folders: Iterable[Path], settings: VideoSettings) -> None:
    """Refuse folders for the videos of an archive that hold results of other settings, before any of them is touched.

    Raises
    ------
    InputError
        If one does.
    """
    head = stored_values(evaluation_head(settings, load_reference(settings)))
    for folder in folders:
        recorded = recorded_head(folder / JOURNAL)
        if recorded is not None and any(recorded.get(name) != value for name, value in head.items()):
            raise InputError(
                f"{folder} holds the results of another evaluation: choose another folder, or remove {folder.parent}"
            )


def opened_video(path: Path, converter: Converter) -> tuple[VideoSource, Converter]:
    """Open a video, with the conversion of its frames.

    Raises
    ------
    InputError
        If it cannot be opened, or does not state an exposure that is needed.
    """
    source = open_video(path, converter.options)
    if converter.unit == "cd/m^2" and converter.options.exposure_s is None and not source.exposure_stated:
        raise InputError(no_exposure(path))
    options = replace(converter.options, encoding=source.encoding)
    return source, replace(converter, options=options).with_lens(source.lens)


def _require_regions(source: VideoSource, settings: VideoSettings) -> None:
    """Refuse regions that cannot be those of any frame, before the first one."""
    if not settings.rois:
        return
    require_regions_in(source, settings)
    first, second = ((roi, roi.window(source.shape), roi.mask(source.shape)) for roi in settings.rois)
    require_apart(first, second)


def require_regions_in(source: VideoSource, settings: VideoSettings) -> None:
    """Refuse regions that were drawn on an image of another size, lie outside the frames or hold no pixel.

    Raises
    ------
    InputError
        If one does.
    """
    height, width = source.shape
    drawn_on = settings.image_size
    if drawn_on is not None and drawn_on != (width, height):
        raise InputError(
            f"the regions were drawn on an image of {drawn_on[0]} x {drawn_on[1]} pixels, {source.path} has {width} x "
            f"{height}: draw them in its first frame"
        )
    for roi in settings.rois:
        roi.window(source.shape)
        roi.mask(source.shape)


def converter_findings(
    converter: Converter, source: VideoSource, readings: Sequence[Finding] | None = None
) -> tuple[Finding, ...]:
    """Return the findings about the luminance of a video's frames.

    `readings` is what is known of the regions in all frames by other readings of the values, as `reading_findings`;
    None if they are not known.
    """
    findings = [*converter.vignetting_findings(converter.vignetting(source.shape, source.readout))]
    doubts = converter.doubt_findings(source.doubts)
    if readings is not None:
        # What is said of the values of the first frame is said of the regions in all frames.
        doubts = (*(finding for finding in doubts if finding.code == MOSAIC), *readings)
    findings += doubts
    was_srgb = any(finding.code == "srgb-colour-to-grey" for finding in source.findings)
    encoding = "srgb" if was_srgb and source.encoding == "linear" else source.encoding
    if converter.calibration is None or isinstance(encoding, Companding):
        findings += encoding_findings(encoding)
    elif encoding != "linear":
        findings.append(warning("srgb-taken-as-dn"))
    return tuple(findings)
