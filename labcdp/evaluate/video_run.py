"""One pass through a video: following its regions, and evaluating its frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from math import nan
from threading import Lock

import numpy as np

from ..contrast import cdp_neighbours_range
from ..errors import InputError
from ..frame import Frame
from ..roi import Roi
from ..sources.video import VideoFrame, VideoSource, frames_of
from ..tracking import TrackedRoi, make_tracker
from .light import PictureConversion
from .video_dataset import BY_CONTRAST, BY_FRAME, BY_REGION, saturation_note
from .video_journal import Row, VideoJournal
from .video_neighbours import NeighbourTables
from .video_pair import evaluate_frame_pair
from .video_pipeline import ahead, in_order
from .video_reference import ReferenceContrast
from .video_settings import Observer, Progress, VideoSettings
from .video_table import light_by_dn

#: Keys of a row that are no variables.
_FAULT, _INVALID = "fault", "invalid"


@dataclass(frozen=True, eq=False)
class _Item:
    """A frame with where the regions are in it.

    `row` if its results are known from an earlier run, and the number of the frame before if it has the same pixels.
    """

    frame: VideoFrame
    regions: tuple[TrackedRoi, ...]
    row: Row | None
    repeats: int | None


class VideoRun:
    """One pass through a video; what is in the journal already is not evaluated again.

    Parameters
    ----------
    source : VideoSource
        The video.
    settings : VideoSettings
        What is to be evaluated.
    conversion : PictureConversion
        Of its frames to light.
    reference : ReferenceContrast or None
        What each frame is compared with.
    journal : VideoJournal
        Of this evaluation.
    """

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
        if self._n_done and is_end(last := journal.row(self._n_done - 1)):
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
                if not is_end(row):
                    self._reference.learn(row["measured_contrast"])
        place = 0
        # Small steps in several threads wait for each other; a whole frame from pixel to pixel does not.
        n_workers = 0 if self._settings.rois else 2
        with (
            closing(ahead(self._frames(observer is not None))) as frames,
            closing(in_order(self._followed(frames), self._worked, n_workers)) as worked,
        ):
            for place, (item, row) in enumerate(worked, start=1):
                if item.row is None:
                    self._journal.add(row)
                if observer is not None and item.frame.frame is not None:
                    observer(item.frame.number, item.frame.grey, item.regions, variables(row))
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
            # The last one that is done is compared with the next.
            return follows or (chosen and (observed or n_chosen >= self._n_done or not self._begun))

        return frames_of(self._source, settings.selection, needed)

    def _followed(self, frames: Iterator[VideoFrame]) -> Iterator[_Item]:
        """Follow the regions; only chosen frames are passed on."""
        rois = self._settings.rois
        tracker = None
        regions: tuple[TrackedRoi, ...] = ()
        rows = self._journal.rows()
        n_chosen = 0
        last: VideoFrame | None = None
        unseen: VideoFrame | None = None
        for frame in frames:
            if rois and self._settings.method != "fixed" and tracker is None and frame.frame is None:
                unseen = unseen or frame
                continue
            if rois and frame.frame is not None:
                if unseen is not None:
                    raise InputError(
                        f"frame {unseen.number} of {self._source.path}, in which the regions are, {_is(unseen.fault)}; "
                        f"draw them in frame {frame.number}, the first whole one, and give --start {frame.number}"
                    )
                if tracker is None:
                    tracker = make_tracker(self._settings.method, frame.grey, rois)
                    regions = tuple(TrackedRoi(roi, 1.0, False, "") for roi in rois)
                    self._begun = True
                else:
                    regions = tracker.update(frame.grey)
            if frame.chosen:
                n_chosen += 1
                repeats = last.number if last is not None and _same_picture(last, frame) else None
                yield _Item(frame, regions, next(rows) if n_chosen <= self._n_done else None, repeats)
                last = frame
        if unseen is not None and tracker is None:
            raise InputError(f"frame {unseen.number} of {self._source.path} {_is(unseen.fault)}, and so are all others")

    def _worked(self, item: _Item) -> Row:
        """Results of a frame."""
        if item.row is not None:
            return item.row
        frame, settings = item.frame, self._settings
        # What is wrong with these is wrong with every frame.
        tables = None if settings.rois or frame.frame is None else self._neighbour_tables(frame.frame)
        row: Row = {"frame": frame.number, "time_s": frame.time_s, "note": ""}
        row |= {name: [nan] * len(settings.contrasts) for name in BY_CONTRAST}
        if settings.rois:
            row |= _of_regions(item.regions, settings.rois, frame.frame is not None)
        if frame.frame is None:
            return row | {"note": frame.fault, _FAULT: "broken"}
        try:
            if not settings.rois:
                return row | self._of_neighbours(frame.frame, tables) | self._repeated(item)
            lost = [one for one in item.regions if one.lost]
            if lost:
                names = "; ".join(f"{one.roi.name!r} is lost: {one.reason}" for one in lost)
                return row | {"note": f"region {names}", _FAULT: "lost"}
            return row | _joined(self._of_pair(frame, frame.frame, item.regions), self._repeated(item))
        except InputError as error:
            return row | {"note": " ".join(str(error).split()), _FAULT: "unusable"}

    @staticmethod
    def _repeated(item: _Item) -> Row:
        if item.repeats is None:
            return {}
        return {"note": f"the same picture as frame {item.repeats}", _FAULT: "repeated"}

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
            "csnr_standard_uncertainty": found.csnr_standard_uncertainty,
            "mean": found.mean,
            "mean_standard_uncertainty": found.mean_standard_uncertainty,
            "snr": found.snr,
            "snr_standard_uncertainty": found.snr_standard_uncertainty,
            "saturated": [shares.get("saturated", 0.0) for shares in found.invalid_shares],
            _INVALID: found.invalid_shares,
        }
        if asked is not None:
            row |= {
                "reference_contrast": asked,
                "reference_cdp": found.cdp[n],
                "reference_cdp_low": found.low[n],
                "reference_cdp_high": found.high[n],
            }
        row = row | ({_FAULT: "reference"} if note else {})
        return _joined(row, {"note": saturation_note([roi.name for roi in rois], row["saturated"])})

    def _of_neighbours(self, frame: Frame, tables: NeighbourTables | None) -> Row:
        settings = self._settings
        if tables is not None and frame.dn.dtype == np.uint8:
            found = tables.evaluate(frame.dn)
        else:
            light = self._conversion.convert(frame).luminance_cd_m2
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


def _same_picture(last: VideoFrame, frame: VideoFrame) -> bool:
    if last.frame is None or frame.frame is None:
        return False
    one, other = last.frame.dn, frame.frame.dn
    # A few rows tell apart what differs.
    return np.array_equal(one[::64], other[::64]) and np.array_equal(one, other)


def _joined(row: Row, more: Row) -> Row:
    """Row with another one's note behind its own."""
    notes = [one["note"] for one in (row, more) if one.get("note")]
    return {**more, **row, "note": "; ".join(notes)}


def _is(fault: str) -> str:
    return fault if fault.startswith(("has ", "builds ")) else f"is {fault}"


def is_end(row: Row) -> bool:
    """Whether a row of the journal tells where the video ends, and is none of a frame."""
    return "end" in row


def variables(row: Row) -> Row:
    """Return what of a row are variables of the dataset."""
    return {name: value for name, value in row.items() if name not in (_FAULT, _INVALID)}
