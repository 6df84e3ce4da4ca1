"""One pass through a video: decoding, following its regions and evaluating its frames, at the same time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import closing
from dataclasses import replace
from functools import cache, partial
from itertools import islice, repeat
from typing import Any, TypeVar

from ...core.errors import InputError
from ...core.roi import Roi
from ...files.video.source import StoredPixels, VideoFrame, VideoSource, frames_of
from ...report.text import finding_text
from ...tracking import NotFollowedError, TrackedRoi, Tracker, make_tracker
from ..picture.converter import Converter
from .rows import FollowedFrame, PartRun, region_pixels
from .settings import Progress

_Result = TypeVar("_Result")

#: Frames that wait between two steps: enough to keep both busy, few enough to keep memory small.
_WAITING = 4


class VideoRun:
    """One pass through a video for any number of pairs of regions.

    Parameters
    ----------
    source : VideoSource
        The video.
    converter : Converter
        Of its frames to light.
    parts : sequence of PartRun
        With the same selection of frames.
    """

    def __init__(self, source: VideoSource, converter: Converter, parts: Sequence[PartRun]) -> None:
        self._source, self._converter, self._parts = source, converter, parts
        self._selection = parts[0].settings.selection
        self._n_frames, self._last_s = 0, 0.0
        self._choose_regions()
        self._begun = not self._methods

    def _choose_regions(self) -> None:
        """Keep the parts that can be evaluated, and their regions; raises InputError if none can."""
        failures = [part.failure for part in self._parts if part.failure is not None]
        if len(failures) == len(self._parts):
            raise failures[0]
        self._parts = [part for part in self._parts if part.failure is None]
        self._methods: dict[Roi, str] = {}
        for part in self._parts:
            self._methods |= zip(part.settings.rois, part.settings.methods, strict=True)
        self._follows = any(method != "fixed" for method in self._methods.values())

    def go(self, progress: Progress | None) -> None:
        """Evaluate what is not in the journals yet."""
        if all(part.done for part in self._parts):
            return
        expected = self._selection.expected(self._source.frame_count, self._source.frame_rate)
        n_done = 0
        # Small steps in several threads wait for each other; a whole frame of neighbours does not.
        # Without a contrast the first frame gives it to the others.
        alone = self._methods or any(part.settings.contrasts is None for part in self._parts)
        with closing(ahead(self._frames())) as frames, closing(self._worked(frames, 0 if alone else 2)) as worked:
            for n_done, (item, rows) in enumerate(worked, start=1):
                for part, row in zip(self._parts, rows, strict=True):
                    part.take(item, row)
                if progress is not None:
                    progress(n_done, None if expected is None else max(expected, n_done))
        if n_done == 0:
            first, stop = self._selection.start, self._selection.stop
            raise InputError(
                f"{self._source.path} has no frame from {first} to {stop or 'its end'}: give an earlier start"
            )
        to_end = self._selection.stop is None
        for part in self._parts:
            part.finish(self._n_frames if to_end else None, self._last_s if to_end else None)

    def _frames(self) -> Generator[VideoFrame, None, None]:
        """Frames with the pixels that are needed."""
        observed = any(part.observer is not None for part in self._parts)
        n_done = min(part.n_done for part in self._parts)
        n_chosen = 0

        def needed(number: int, chosen: bool) -> bool:
            nonlocal n_chosen
            n_chosen += chosen
            # Regions that stay are compared with the first frame, and with no other one.
            # The last one that is done is compared with the next.
            return self._follows or (chosen and (observed or n_chosen >= n_done or not self._begun))

        def entries() -> Iterator[VideoFrame]:
            for entry in self._source.entries():
                self._n_frames, self._last_s = entry.number + 1, entry.time_s
                yield entry

        return frames_of(replace(self._source, entries=entries), self._selection, needed)

    def _worked(
        self, frames: Iterator[VideoFrame], n_workers: int
    ) -> Generator[tuple[FollowedFrame, list[dict[str, Any] | None]], None, None]:
        """Go through the chosen frames, each with its results for each part."""

        def work(item: FollowedFrame) -> tuple[FollowedFrame, list[dict[str, Any] | None]]:
            return item, [part.worked(item) for part in self._parts]

        return in_order((partial(work, item) for item in self._followed(frames)), n_workers)

    def _followed(self, frames: Iterator[VideoFrame]) -> Iterator[FollowedFrame]:
        """Follow the regions; only chosen frames are passed on."""
        tracker: Tracker | None = None
        regions: dict[Roi, TrackedRoi] = {}
        index = 0
        last: VideoFrame | None = None
        unseen: VideoFrame | None = None
        for frame in frames:
            if self._follows and tracker is None and frame.pixels is None:
                unseen = unseen or frame
                continue
            if self._methods and frame.pixels is not None:
                if unseen is not None:
                    remedy = f"draw them in frame {frame.number}, the first complete one, and start there"
                    raise InputError(f"{self._why(unseen)}; {remedy}")
                if tracker is None:
                    tracker = self._tracker(frame.pixels)
                    regions = {roi: TrackedRoi(roi, 1.0, False) for roi in self._methods}
                    self._begun = True
                else:
                    regions = dict(zip(self._methods, tracker.update(frame.pixels.followed), strict=True))
            if frame.chosen:
                repeats = last.number if last is not None and _same_picture(last, frame) else None
                # Before the first whole frame there is no region.
                light = cache(partial(region_pixels, frame, self._converter))
                yield FollowedFrame(frame, index, regions, repeats, light)
                index, last = index + 1, frame
        if unseen is not None and tracker is None:
            raise InputError(f"{self._why(unseen)}; the same applies to all others")

    def _why(self, frame: VideoFrame) -> str:
        """Say why a frame is lost, in which the regions were drawn."""
        text = "" if frame.fault is None else finding_text(frame.fault)
        return f"frame {frame.number} of {self._source.path}, in which the regions are: {text}"

    def _tracker(self, first: StoredPixels) -> Tracker:
        """Make a tracker; a region that cannot be followed costs only its own pairs."""
        while True:
            try:
                return make_tracker(tuple(self._methods.values()), first.followed, tuple(self._methods), first.levels)
            except NotFollowedError as error:
                for part in self._parts:
                    if any(roi.name == error.region for roi in part.settings.rois):
                        part.failure = error
                self._choose_regions()


def _same_picture(last: VideoFrame, frame: VideoFrame) -> bool:
    return last.pixels is not None and frame.pixels is not None and frame.pixels.same_as(last.pixels)


def ahead(items: Generator[_Result, None, None]) -> Generator[_Result, None, None]:
    """Go through items that are made in a thread of their own, a few ahead."""
    with closing(items), closing(in_order(repeat(lambda: tuple(islice(items, 1))), 1)) as made:
        for items_ahead in made:
            if not items_ahead:
                return
            yield from items_ahead


def in_order(tasks: Iterable[Callable[[], _Result]], n_workers: int) -> Generator[_Result, None, None]:
    """Call functions in threads, or in this one if there are none, and yield what they return, in order.

    Close the iterator (`contextlib.closing`) if it is not used up: its threads end then.
    """
    if not n_workers:
        for task in tasks:
            yield task()
        return
    waiting: deque[Future[_Result]] = deque()
    with ThreadPoolExecutor(n_workers, thread_name_prefix="labcdp video") as pool:
        try:
            for task in tasks:
                waiting.append(pool.submit(task))
                if len(waiting) >= n_workers + _WAITING:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()
            wait(waiting)
