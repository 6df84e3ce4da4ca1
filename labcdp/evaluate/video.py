"""Evaluation of a video, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from ..contrast import cdp_neighbours_range
from ..errors import InputError
from ..frame import Frame
from ..roi import Roi
from ..sources.video import VideoFrame, VideoSource, frames_of, open_video
from ..tracking import TrackedRoi, make_tracker
from .light import PictureConversion, picture_conversion
from .video_configuration import conversion_warnings, video_configuration
from .video_dataset import BY_CONTRAST, BY_FRAME, BY_REGION, DatasetFrame, Findings, as_json, video_dataset
from .video_journal import Row, VideoJournal
from .video_neighbours import NeighbourTables
from .video_pair import evaluate_frame_pair
from .video_pipeline import ahead, in_order
from .video_reference import ReferenceContrast, make_reference
from .video_settings import Observer, Progress, VideoSettings
from .video_table import light_by_dn, proportional_light

if TYPE_CHECKING:
    from xarray import Dataset

#: Format of the journal, and packages on which results depend to the last bit.
_FORMAT = 1
_PACKAGES = ("labcdp", "numpy", "scipy", "opencv-contrib-python-headless")
#: Keys of a row that are no variables.
_FAULT, _INVALID = "fault", "invalid"


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
    options = replace(conversion.options, **{name: value for name, value in told.items() if value is not None})
    source = open_video(path, options)
    if conversion.unit == "cd/m^2" and options.exposure_s is None and not source.exposure_stated:
        raise InputError(f"{path} does not say its exposure time: give it with --exposure")
    reference = make_reference(settings)
    configuration = video_configuration(settings, reference)
    versions = {name: version(name) for name in _PACKAGES}
    head = {"format": _FORMAT, "video": source.sha256, "settings": configuration, "versions": versions}
    with ExitStack() as stack:
        where = folder or Path(stack.enter_context(TemporaryDirectory(prefix="labcdp-")))
        journal = VideoJournal.open(where, head)
        stack.callback(journal.close)
        run = _Run(source, settings, conversion, reference, journal)
        run.go(progress, observer)
        findings = Findings([roi.name for roi in settings.rois])
        for row in journal.rows():
            if not _is_end(row):
                findings.add(row)
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
            "versions": as_json(versions),
            "configuration": as_json(configuration),
        }
        about = DatasetFrame(settings.contrasts, tuple(roi.name for roi in settings.rois), conversion.unit, attrs)
        return video_dataset((_variables(row) for row in journal.rows() if not _is_end(row)), about)


@dataclass(frozen=True, eq=False)
class _Item:
    """A frame with where the regions are in it; `row` if its results are known from an earlier run."""

    frame: VideoFrame
    regions: tuple[TrackedRoi, ...]
    row: Row | None


class _Run:
    """One pass through a video."""

    def __init__(
        self,
        source: VideoSource,
        settings: VideoSettings,
        conversion: PictureConversion,
        reference: ReferenceContrast | None,
        journal: VideoJournal,
    ) -> None:
        self._source, self._settings, self._conversion = source, settings, conversion
        self._reference, self._journal = reference, journal
        self._tables: NeighbourTables | None = None
        self._setting: tuple[float | None, ...] | None = None
        self._lock = Lock()
        self._begun = not settings.rois
        self._n_done, self._n_frames = len(journal), 0
        self._end: Row | None = None
        if self._n_done and _is_end(last := journal.row(self._n_done - 1)):
            self._end = last
            self._n_done -= 1

    def go(self, progress: Progress | None, observer: Observer | None) -> None:
        """Evaluate what is not in the journal yet."""
        total = self._source.frame_count
        expected = self._settings.selection.expected(total, self._source.frame_rate)
        if self._end is not None and observer is None:
            return
        if self._reference is not None:
            for row in self._journal.rows():
                if not _is_end(row):
                    self._reference.learn(row["measured_contrast"])
        place = 0
        n_workers = 1 if self._settings.rois else 2
        with (
            closing(ahead(self._frames(observer is not None))) as frames,
            closing(in_order(self._followed(frames), self._worked, n_workers)) as worked,
        ):
            for place, (item, row) in enumerate(worked, start=1):
                if item.row is None:
                    self._journal.add(row)
                if observer is not None and item.frame.frame is not None:
                    observer(item.frame.number, item.frame.grey, item.regions, _variables(row))
                if progress is not None:
                    progress(place, None if expected is None else max(expected, place))
        if place == 0:
            first, stop = self._settings.selection.start, self._settings.selection.stop
            raise InputError(
                f"{self._source.path} has no frame from {first} to {stop or 'its end'}: give an earlier start"
            )
        if self._end is None:
            self._end = {"end": self._n_frames if self._settings.selection.stop is None else None}
            self._journal.add(self._end)

    def announced(self) -> list[str]:
        """Warn if the file announces another number of frames than it has."""
        assert self._end is not None
        announced, found = self._source.frame_count, self._end["end"]
        if announced is None or found is None or announced == found:
            return []
        return [
            f"the file announces {announced} frames, {found} were found"
            + (": it may be cut off" if found < announced else "")
        ]

    def _frames(self, observed: bool) -> Iterator[VideoFrame]:
        """Frames with the pixels that are needed."""
        settings = self._settings
        follows = bool(settings.rois) and settings.method != "fixed"
        n_chosen = 0

        def needed(number: int, chosen: bool) -> bool:
            nonlocal n_chosen
            n_chosen += chosen
            self._n_frames = number + 1
            # Regions that stay are compared with the first frame, and with no other one.
            return follows or (chosen and (observed or n_chosen > self._n_done or not self._begun))

        return frames_of(self._source, settings.selection, needed)

    def _followed(self, frames: Iterator[VideoFrame]) -> Iterator[_Item]:
        """Follow the regions; only chosen frames are passed on."""
        rois = self._settings.rois
        tracker = None
        regions: tuple[TrackedRoi, ...] = ()
        rows = self._journal.rows()
        n_chosen = 0
        for frame in frames:
            if rois and frame.frame is not None:
                if tracker is None:
                    tracker = make_tracker(self._settings.method, frame.grey, rois)
                    regions = tuple(TrackedRoi(roi, 1.0, False, "") for roi in rois)
                    self._begun = True
                else:
                    regions = tracker.update(frame.grey)
            if frame.chosen:
                n_chosen += 1
                yield _Item(frame, regions, next(rows) if n_chosen <= self._n_done else None)

    def _worked(self, item: _Item) -> Row:
        """Results of a frame."""
        if item.row is not None:
            return item.row
        frame, settings = item.frame, self._settings
        row: Row = {"frame": frame.number, "time_s": frame.time_s, "note": ""}
        row |= {name: [nan] * len(settings.contrasts) for name in BY_CONTRAST}
        if settings.rois:
            row |= _of_regions(item.regions, settings.rois, frame.frame is not None)
        if frame.frame is None:
            return row | {"note": frame.fault, _FAULT: "broken"}
        try:
            if not settings.rois:
                return row | self._of_neighbours(frame.frame)
            lost = [one for one in item.regions if one.lost]
            if lost:
                names = "; ".join(f"{one.roi.name!r} is lost: {one.reason}" for one in lost)
                return row | {"note": f"region {names}", _FAULT: "lost"}
            return row | self._of_pair(frame, frame.frame, item.regions)
        except InputError as error:
            return row | {"note": " ".join(str(error).split()), _FAULT: "unusable"}

    def _of_pair(self, frame: VideoFrame, pixels: Frame, regions: Sequence[TrackedRoi]) -> Row:
        settings, reference = self._settings, self._reference
        asked, note = (None, "") if reference is None else reference.of(frame.number, frame.time_s)
        contrasts = [*settings.contrasts, *([] if asked is None else [asked])]
        rois = [one.roi for one in regions]
        found = evaluate_frame_pair(pixels, self._conversion, rois, contrasts, settings.epsilon)
        if reference is not None and asked is None and not note:
            # The first frame that was measured is its own reference.
            reference.learn(found.contrast)
            asked, note = reference.of(frame.number, frame.time_s)
            if asked is not None:
                contrasts.append(asked)
                found = evaluate_frame_pair(pixels, self._conversion, rois, contrasts, settings.epsilon)
        n = len(settings.contrasts)
        row: Row = {
            "note": note,
            "cdp": found.cdp[:n],
            "cdp_standard_uncertainty": found.standard_uncertainty[:n],
            "cdp_low": found.low[:n],
            "cdp_high": found.high[:n],
            "below": found.below[:n],
            "above": found.above[:n],
            "measured_contrast": found.contrast,
            "measured_contrast_standard_uncertainty": found.contrast_standard_uncertainty,
            "csnr": found.csnr,
            "mean": found.mean,
            "mean_standard_uncertainty": found.mean_standard_uncertainty,
            "snr": found.snr,
            _INVALID: found.invalid_shares,
        }
        if asked is not None:
            row |= {
                "reference_contrast": asked,
                "reference_cdp": found.cdp[n],
                "reference_cdp_low": found.low[n],
                "reference_cdp_high": found.high[n],
            }
        return row | ({_FAULT: "reference"} if note else {})

    def _of_neighbours(self, frame: Frame) -> Row:
        settings = self._settings
        tables = self._neighbour_tables(frame)
        if tables is not None and frame.dn.dtype == np.uint8:
            found = tables.evaluate(frame.dn)
        else:
            exact = proportional_light(frame.dn, frame, self._conversion)
            light = self._conversion.convert(frame).luminance_cd_m2 if exact is None else exact
            found = cdp_neighbours_range(light, settings.contrasts, settings.epsilon)
        return {
            "cdp": [one.cdp for one in found],
            "cdp_standard_uncertainty": [one.standard_error for one in found],
            "cdp_low": [one.confidence_interval[0] for one in found],
            "cdp_high": [one.confidence_interval[1] for one in found],
            "below": [one.below for one in found],
            "above": [one.above for one in found],
        }

    def _neighbour_tables(self, frame: Frame) -> NeighbourTables | None:
        """Tables for frames of this setting, made once for each; None if more than the DN decides."""
        setting = (frame.exposure_s, frame.gain_db, frame.black_level_dn, frame.saturation_dn, frame.temperature_c)
        with self._lock:
            if setting != self._setting:
                light = light_by_dn(frame, self._conversion)
                settings = self._settings
                self._tables = None if light is None else NeighbourTables(light, settings.contrasts, settings.epsilon)
                self._setting = setting
            return self._tables


def _of_regions(regions: Sequence[TrackedRoi], rois: Sequence[Roi], seen: bool) -> Row:
    """Where the regions are; nan in a frame in which nobody looked, as it is broken."""
    row: Row = dict.fromkeys(BY_FRAME, nan) | {name: [nan, nan] for name in BY_REGION}
    if not seen or not regions:
        nothing = [[nan] * len(roi.corners) for roi in rois]
        return row | {"lost": [False, False], "corner_x": nothing, "corner_y": nothing}
    return row | {
        "quality": [float(one.quality) for one in regions],
        "lost": [bool(one.lost) for one in regions],
        "centre_x": [one.roi.centre[0] for one in regions],
        "centre_y": [one.roi.centre[1] for one in regions],
        "corner_x": [[x for x, _ in one.roi.corners] for one in regions],
        "corner_y": [[y for _, y in one.roi.corners] for one in regions],
    }


def _is_end(row: Row) -> bool:
    return "end" in row


def _variables(row: Row) -> Row:
    """Return what of a row are variables of the dataset."""
    return {name: value for name, value in row.items() if name not in (_FAULT, _INVALID)}
