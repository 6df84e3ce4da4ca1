"""One pass through a video: following its regions, and evaluating its frames."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk.journal import LineJournal, Row
from ...core.errors import InputError
from ...core.frame import Frame
from ...core.result import Finding, info, warning
from ...core.roi import Roi
from ...files.video.open import frames_of
from ...files.video.source import VideoFrame, VideoSource
from ...report.text import finding_text
from ...tracking import NotFollowedError, TrackedRoi, Tracker, make_tracker
from ..picture.conversion import PictureConversion
from .pipeline import ahead, in_order
from .rows import MEASURED, FrameRows, is_end, variables
from .settings import Observer, Progress, ReferenceContrast, VideoSettings


@dataclass(frozen=True, eq=False)
class _Item:
    """A chosen frame, its place among them, and where the regions are in it.

    `repeats` is the number of the frame before if it has the same pixels.
    """

    frame: VideoFrame
    place: int
    regions: Mapping[Roi, TrackedRoi]
    repeats: int | None


class PartRun:
    """What a pair of regions, or nearest neighbours, make of the frames; what is in the journal is not done again.

    Parameters
    ----------
    settings : VideoSettings
        What is to be evaluated.
    conversion : PictureConversion
        Of frames to light.
    reference : ReferenceContrast or None
        What each frame is compared with.
    journal : LineJournal
        Of this evaluation.
    observer : callable or None
        Given each frame.
    """

    def __init__(
        self,
        settings: VideoSettings,
        conversion: PictureConversion,
        reference: ReferenceContrast | None,
        journal: LineJournal,
        observer: Observer | None,
    ) -> None:
        self.settings, self.journal, self.observer = settings, journal, observer
        #: Why it cannot be evaluated, whatever the frames show.
        self.failure: InputError | None = None
        self._rows = FrameRows(settings, conversion, reference)
        self.n_done = len(journal)
        self.end: Row | None = None
        if self.n_done and is_end(last := journal.row(self.n_done - 1)):
            self.end = last
            self.n_done -= 1
        for row in journal.rows():
            self._rows.learn(row.get(MEASURED, nan))

    @property
    def contrasts(self) -> tuple[float, ...]:
        """Contrasts that were to be detected; a measured one is nan if no frame could be measured."""
        return self._rows.contrasts

    @property
    def done(self) -> bool:
        """Whether no frame is needed any more."""
        return self.end is not None and self.observer is None

    def worked(self, item: _Item) -> Row | None:
        """Results of a frame; None for one that is done."""
        return None if item.place < self.n_done else self._rows.row(item.frame, self._regions(item), item.repeats)

    def take(self, item: _Item, row: Row | None) -> None:
        """Record the results of a frame, and show it."""
        if row is not None:
            self.journal.add(row)
        frame = item.frame
        if self.observer is not None and frame.frame is not None:
            known = self.journal.row(item.place) if row is None else row
            self.observer(frame.number, frame.grey, self._regions(item), variables(known))

    def finish(self, n_frames: int | None) -> None:
        """Record that the video has ended, after a number of frames if that is its end."""
        if self.end is None:
            self.end = {"end": n_frames}
            self.journal.add(self.end)

    def announced(self, announced: int | None) -> tuple[Finding, ...]:
        """Return a finding if the file announces another number of frames than it has."""
        found = None if self.end is None else self.end["end"]
        if announced is None or found is None or announced == found:
            return ()
        if found < announced:
            return (warning("video-cut-off", announced=announced, found=found),)
        return (info("video-longer", announced=announced, found=found),)

    def _regions(self, item: _Item) -> tuple[TrackedRoi, ...]:
        return tuple(item.regions[roi] for roi in self.settings.rois if roi in item.regions)


class VideoRun:
    """One pass through a video for any number of pairs of regions.

    Parameters
    ----------
    source : VideoSource
        The video.
    parts : sequence of PartRun
        With the same selection of frames.
    """

    def __init__(self, source: VideoSource, parts: Sequence[PartRun]) -> None:
        self._source, self._parts = source, parts
        self._selection = parts[0].settings.selection
        self._n_frames = 0
        self._choose_regions()
        self._begun = not self._rois

    def _choose_regions(self) -> None:
        """Keep the parts that can be evaluated, and their regions; raises InputError if none can."""
        failures = [part.failure for part in self._parts if part.failure is not None]
        if len(failures) == len(self._parts):
            raise failures[0]
        self._parts = [part for part in self._parts if part.failure is None]
        self._methods: dict[Roi, str] = {}
        for part in self._parts:
            self._methods |= zip(part.settings.rois, part.settings.methods, strict=True)
        self._rois = tuple(self._methods)
        self._follows = any(method != "fixed" for method in self._methods.values())

    def go(self, progress: Progress | None) -> None:
        """Evaluate what is not in the journals yet."""
        if all(part.done for part in self._parts):
            return
        expected = self._selection.expected(self._source.frame_count, self._source.frame_rate)
        place = 0
        # Small steps in several threads wait for each other; a whole frame of neighbours does not.
        # Without a contrast the first frame gives it to the others.
        n_workers = 0 if self._rois or any(part.settings.contrasts is None for part in self._parts) else 2
        with (
            closing(ahead(self._frames())) as frames,
            closing(in_order(self._followed(frames), self._worked, n_workers)) as worked,
        ):
            for place, (item, rows) in enumerate(worked, start=1):
                for part, row in zip(self._parts, rows, strict=True):
                    part.take(item, row)
                if progress is not None:
                    progress(place, None if expected is None else max(expected, place))
        if place == 0:
            first, stop = self._selection.start, self._selection.stop
            raise InputError(
                f"{self._source.path} has no frame from {first} to {stop or 'its end'}: give an earlier start"
            )
        for part in self._parts:
            part.finish(self._n_frames if self._selection.stop is None else None)

    def _frames(self) -> Generator[VideoFrame, None, None]:
        """Frames with the pixels that are needed."""
        observed = any(part.observer is not None for part in self._parts)
        n_done = min(part.n_done for part in self._parts)
        n_chosen = 0

        def needed(number: int, chosen: bool) -> bool:
            nonlocal n_chosen
            n_chosen += chosen
            self._n_frames = number + 1
            # Regions that stay are compared with the first frame, and with no other one.
            # The last one that is done is compared with the next.
            return self._follows or (chosen and (observed or n_chosen >= n_done or not self._begun))

        return frames_of(self._source, self._selection, needed)

    def _followed(self, frames: Iterator[VideoFrame]) -> Iterator[_Item]:
        """Follow the regions; only chosen frames are passed on."""
        tracker = None
        regions: tuple[TrackedRoi, ...] = ()
        place = 0
        last: VideoFrame | None = None
        unseen: VideoFrame | None = None
        for frame in frames:
            if self._follows and tracker is None and frame.frame is None:
                unseen = unseen or frame
                continue
            if self._rois and frame.frame is not None:
                if unseen is not None:
                    raise InputError(
                        f"frame {unseen.number} of {self._source.path}, in which the regions are: {_text(unseen)}; "
                        f"draw them in frame {frame.number}, the first whole one, and give --start {frame.number}"
                    )
                if tracker is None:
                    tracker = self._tracker(_tracked(frame.frame))
                    regions = tuple(TrackedRoi(roi, 1.0, False) for roi in self._rois)
                    self._begun = True
                else:
                    regions = tracker.update(_tracked(frame.frame))
            if frame.chosen:
                repeats = last.number if last is not None and _same_picture(last, frame) else None
                # Before the first whole frame there is no region.
                yield _Item(frame, place, dict(zip(self._rois, regions, strict=False)), repeats)
                place, last = place + 1, frame
        if unseen is not None and tracker is None:
            raise InputError(f"frame {unseen.number} of {self._source.path}: {_text(unseen)}; so are all others")

    def _tracker(self, first: NDArray[Any]) -> Tracker:
        """Make a tracker; a region that cannot be followed costs only its own pairs."""
        while True:
            try:
                return make_tracker(tuple(self._methods.values()), first, self._rois)
            except NotFollowedError as error:
                for part in self._parts:
                    if any(roi.name == error.region for roi in part.settings.rois):
                        part.failure = error
                self._choose_regions()

    def _worked(self, item: _Item) -> list[Row | None]:
        """Results of a frame, part by part."""
        return [part.worked(item) for part in self._parts]


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
