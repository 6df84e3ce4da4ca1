"""One pass through a video: following its regions, and evaluating its frames."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk.journal import LineJournal, Row
from ...core.errors import InputError
from ...core.finding import Finding, info, warning
from ...core.frame import Frame
from ...files.video.open import frames_of
from ...files.video.source import VideoFrame, VideoSource
from ...report.findings import finding_text
from ...tracking import TrackedRoi, make_tracker
from ..picture.light.picture import PictureConversion
from .pipeline import ahead, in_order
from .reference import ReferenceContrast
from .rows import MEASURED, FrameRows, is_end, variables
from .settings import Observer, Progress, VideoSettings


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
    journal : LineJournal
        Of this evaluation.
    """

    def __init__(
        self,
        source: VideoSource,
        settings: VideoSettings,
        conversion: PictureConversion,
        reference: ReferenceContrast | None,
        journal: LineJournal,
    ) -> None:
        self._source, self._settings, self._journal = source, settings, journal
        self._rows = FrameRows(settings, conversion, reference)
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
        for row in self._journal.rows():
            self._rows.learn(row.get(MEASURED, nan))
        if self._end is not None and observer is None:
            return
        place = 0
        # Small steps in several threads wait for each other; a whole frame of neighbours does not.
        # Without a contrast the first frame gives it to the others.
        n_workers = 0 if self._settings.rois or self._settings.contrasts is None else 2
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

    @property
    def contrasts(self) -> tuple[float, ...]:
        """Contrasts that were to be detected; a measured one is nan if no frame could be measured."""
        return self._rows.contrasts

    def announced(self) -> tuple[Finding, ...]:
        """Return a finding if the file announces another number of frames than it has."""
        assert self._end is not None
        announced, found = self._source.frame_count, self._end["end"]
        if announced is None or found is None or announced == found:
            return ()
        if found < announced:
            return (warning("video-cut-off", announced=announced, found=found),)
        return (info("video-longer", announced=announced, found=found),)

    def _frames(self, observed: bool) -> Iterator[VideoFrame]:
        """Frames with the pixels that are needed."""
        settings = self._settings
        follows = settings.follows
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
            if self._settings.follows and tracker is None and frame.frame is None:
                unseen = unseen or frame
                continue
            if rois and frame.frame is not None:
                if unseen is not None:
                    raise InputError(
                        f"frame {unseen.number} of {self._source.path}, in which the regions are: {_text(unseen)}; "
                        f"draw them in frame {frame.number}, the first whole one, and give --start {frame.number}"
                    )
                if tracker is None:
                    tracker = make_tracker(self._settings.method, _tracked(frame.frame), rois)
                    regions = tuple(TrackedRoi(roi, 1.0, False) for roi in rois)
                    self._begun = True
                else:
                    regions = tracker.update(_tracked(frame.frame))
            if frame.chosen:
                n_chosen += 1
                repeats = last.number if last is not None and _same_picture(last, frame) else None
                yield _Item(frame, regions, next(rows) if n_chosen <= self._n_done else None, repeats)
                last = frame
        if unseen is not None and tracker is None:
            raise InputError(f"frame {unseen.number} of {self._source.path}: {_text(unseen)}; so are all others")

    def _worked(self, item: _Item) -> Row:
        """Results of a frame."""
        return item.row if item.row is not None else self._rows.row(item.frame, item.regions, item.repeats)


def _tracked(frame: Frame) -> NDArray[Any]:
    """Pixels of a frame for a tracker: all bits; the pattern of a colour filter does not show in them."""
    if frame.colour_filter is None:
        return frame.dn
    import cv2

    return np.asarray(cv2.blur(frame.dn, (2, 2)))


def _same_picture(last: VideoFrame, frame: VideoFrame) -> bool:
    if last.frame is None or frame.frame is None:
        return False
    one, other = last.frame.dn, frame.frame.dn
    # A few rows suffice to distinguish them.
    return np.array_equal(one[::64], other[::64]) and np.array_equal(one, other)


def _text(frame: VideoFrame) -> str:
    return "" if frame.fault is None else finding_text(frame.fault)
