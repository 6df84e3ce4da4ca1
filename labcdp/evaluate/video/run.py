"""One pass through a video: decoding, following its regions and evaluating its frames, at the same time.

A pair of regions, or nearest neighbours, makes a row of its journal of each frame.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import closing
from functools import cache, lru_cache, partial
from itertools import islice, repeat
from math import isfinite, isnan, nan
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.disk.journal import LineJournal, Row
from ...core.errors import InputError
from ...core.frame import Frame
from ...core.luminance import WHOLE, LuminanceMap, Window
from ...core.result import Finding, warning
from ...core.roi import Roi
from ...core.table import array_values_of, values_of
from ...core.vignetting import Cos4Vignetting
from ...files.video.source import StoredPixels, VideoFrame, VideoSource, frames_of
from ...metrics.pair import evaluate_regions, require_apart
from ...metrics.region import SATURATED_SHARE, RegionPixels, mean_light
from ...report.text import finding_text
from ...tracking import NotFollowedError, TrackedRoi, Tracker, make_tracker
from ..picture.converter import Converter
from ..picture.neighbours import neighbours_of_frame
from .dataset import (
    COLOUR_COLUMNS,
    CONTRAST_COLUMNS,
    CORNER_COLUMNS,
    FINDINGS,
    FRAME_COLUMNS,
    LIGHT_COLUMNS,
    NOTE,
    PAIR_COLUMNS,
    REFERENCE_COLUMNS,
    REGION_COLUMNS,
    TRACKING_COLUMNS,
    findings_text,
    names,
    note_text,
    recorded,
    restored,
)
from .settings import Observer, Progress, VideoReference, VideoSettings

#: Keys of a row that are no variables, and that of the contrast that is measured in a frame; for nearest neighbours in
#: the first one only, if none was given.
_FINDINGS, _INVALID, _MEASURED = "findings", "invalid", "measured_contrast"


_Result = TypeVar("_Result")

#: Masks of regions that are kept.
_MOST_MASKS = 256
#: Frames that wait between two steps: enough to keep both busy, few enough to keep memory small.
_WAITING = 4


class TrackedFrame(NamedTuple):
    """A chosen frame, the index of its row, and where the regions are in it.

    `repeats` is the number of the frame before if it has the same pixels. `light` gives the pixels of a region, which
    are taken once for all its pairs.
    """

    frame: VideoFrame
    row_index: int
    regions: Mapping[Roi, TrackedRoi]
    repeats: int | None
    light: Callable[[Roi], RegionPixels]


class PartRun:
    """Evaluates frames for a pair of regions, or nearest neighbours; what is in the journal is not done again.

    The first frame may measure the contrast that is to be detected in the others.

    Parameters
    ----------
    settings : VideoSettings
        Settings of the evaluation.
    converter : Converter
        Of frames to light.
    reference : VideoReference or None
        Results of another video, if frames are compared with those.
    journal : LineJournal
        Of this evaluation.
    observer : callable or None
        Given each frame.
    """

    def __init__(
        self,
        settings: VideoSettings,
        converter: Converter,
        reference: VideoReference | None,
        journal: LineJournal,
        observer: Observer | None,
    ) -> None:
        self.settings, self.journal, self.observer = settings, journal, observer
        #: Reason why the part cannot be evaluated, independent of its frames.
        self.failure: InputError | None = None
        self._converter, self.reference = converter, reference
        #: Contrast of the first frame that was measured: to be detected if none is given, or the reference.
        self._first_contrast: float | None = None
        self.n_done = len(journal)
        self.end: Row | None = None
        if self.n_done and is_end(last := journal.row(self.n_done - 1)):
            self.end = last
            self.n_done -= 1
        for row in journal.rows():
            self._note_measured_contrast(row.get(_MEASURED, nan), _has_saturated_region(row))

    @property
    def contrasts(self) -> tuple[float, ...]:
        """Contrasts that were to be detected; a measured one is nan if no frame could be measured."""
        if self.settings.contrasts is not None:
            return self.settings.contrasts
        return (nan if self._first_contrast is None else self._first_contrast,)

    @property
    def methods(self) -> dict[Roi, str]:
        """The regions that are followed, and how."""
        return dict(zip(self.settings.rois, self.settings.methods, strict=True))

    def cannot_follow(self, error: NotFollowedError) -> None:
        """Take note that a region cannot be followed."""
        self.failure = error

    @property
    def done(self) -> bool:
        """Whether no frame is needed any more."""
        return self.end is not None and self.observer is None

    def evaluated(self, item: TrackedFrame) -> Row | None:
        """Results of a frame; None for one that is done."""
        return None if item.row_index < self.n_done else self._row(item, self._regions(item))

    def record(self, item: TrackedFrame, row: Row | None) -> None:
        """Record the results of a frame, and show it."""
        if row is not None:
            self.journal.add(row)
        frame = item.frame
        if self.observer is not None and frame.pixels is not None:
            known = self.journal.row(item.row_index) if row is None else row
            self.observer(frame.number, frame.grey, self._regions(item), variables(known))

    def finish(self, n_frames: int | None, last_s: float | None) -> None:
        """Record that the video has ended; if that is its end, after how many frames, and when the last one begins."""
        if self.end is None:
            self.end = {"end": n_frames, "last_s": last_s}
            self.journal.add(self.end)

    def _regions(self, item: TrackedFrame) -> tuple[TrackedRoi, ...]:
        return tuple(item.regions[roi] for roi in self.settings.rois if roi in item.regions)

    def _note_measured_contrast(self, contrast: float, saturated: bool = False) -> bool:
        """Store the contrast measured in a frame; returns whether that changes the contrasts to be detected.

        That of a saturated region is a bound, and no target.
        """
        if saturated or self._first_contrast is not None or not (isfinite(contrast) and contrast > 0):
            return False
        self._first_contrast = contrast
        return self.settings.contrasts is None or self.settings.reference == "first"

    def _reference_contrast(self, frame: VideoFrame) -> tuple[float | None, Finding | None]:
        """Return the contrast that a frame is compared with, or why there is none."""
        if self.reference is not None:
            return self.reference.contrast(frame.number, frame.time_s)
        reference = self.settings.reference
        return (reference if isinstance(reference, float) else self._first_contrast if reference else None), None

    def _row(self, item: TrackedFrame, regions: Sequence[TrackedRoi]) -> Row:
        settings, frame, pixels = self.settings, item.frame, item.frame.pixels
        row: Row = {"frame": frame.number, "time_s": frame.time_s}
        row |= {name: [nan] * settings.n_contrasts for name in names(CONTRAST_COLUMNS)}
        row |= dict.fromkeys(names(COLOUR_COLUMNS), nan) if settings.colours and settings.rois else {}
        if settings.rois:
            row |= _region_corners(regions if pixels is not None else (), settings.rois)
        if pixels is None:
            return row | _with_findings([] if frame.fault is None else [frame.fault])
        lost = [tracked for tracked in regions if tracked.lost]
        if lost:
            return row | _with_findings(reason for tracked in lost for reason in tracked.reasons)
        try:
            values, findings = (
                self._pair_row(item, [tracked.roi for tracked in regions])
                if settings.rois
                else (self._neighbour_row(pixels.frame), [])
            )
        except InputError as error:
            return row | _with_findings([warning("frame-not-evaluated", reason=" ".join(str(error).split()))])
        if "cdp" not in values and not _has_saturated_region(values):
            findings.append(warning("frame-without-contrast"))
        for region, share in zip(settings.rois, values.get("saturated", ()), strict=False):
            if share > SATURATED_SHARE:
                findings.append(warning("frame-region-saturated", region.name, share=share))
        if item.repeats is not None:
            findings.append(warning("frame-repeated", of_frame=item.repeats))
        return row | values | _with_findings([*findings, *([] if frame.note is None else [frame.note])])

    def _pair_row(self, item: TrackedFrame, rois: Sequence[Roi]) -> tuple[Row, list[Finding]]:
        frame, (first, second) = item.frame, map(item.light, rois)
        require_apart(first.placed, second.placed)
        while True:
            contrasts = [contrast for contrast in self.contrasts if not isnan(contrast)]
            reference, why = self._reference_contrast(frame)
            targets = contrasts if reference is None else [*contrasts, reference]
            # Contrasts of the first frame have the vignetting of this one.
            measured = [self.settings.contrasts is None] * len(contrasts) + [self.settings.reference == "first"]
            pair = evaluate_regions(first, second, targets, self.settings.epsilon, measured[: len(targets)])
            # The first frame that is measured gives what was not given.
            if not self._note_measured_contrast(pair.contrast.value, bool(pair.bound)):
                break
        n, both = len(contrasts), (pair.a, pair.b)
        row: Row = {name: values[0] for name, values in values_of(PAIR_COLUMNS, [pair]).items()}
        row |= values_of(LIGHT_COLUMNS, both) | {_INVALID: [region.invalid_shares for region in both]}
        row |= array_values_of(CONTRAST_COLUMNS, pair.cdp[:n]) if n else {}
        row |= {name: values[0] for name, values in array_values_of(REFERENCE_COLUMNS, pair.cdp[n:]).items() if values}
        findings = [] if why is None else [why]
        if self.settings.colours and isinstance(self.settings.epsilon, int | float):
            from .colours import frame_separation

            colours, doubts = frame_separation(item.frame, self._converter, rois, self.settings.epsilon)
            row |= colours
            findings += doubts
        return row, findings

    def _neighbour_row(self, frame: Frame) -> Row:
        given = None if isnan(self.contrasts[0]) else self.contrasts
        pair = neighbours_of_frame(frame, self._converter, given, self.settings.epsilon)
        row: Row = {**array_values_of(CONTRAST_COLUMNS, pair.cdp)} if len(pair.cdp) else {}
        if given is None:
            row[_MEASURED] = pair.contrast.value
            self._note_measured_contrast(pair.contrast.value)
        return row


def _region_corners(regions: Sequence[TrackedRoi], rois: Sequence[Roi]) -> Row:
    """Where the regions are; nan in a damaged frame."""
    row: Row = dict.fromkeys(names(FRAME_COLUMNS), nan) | {name: [nan, nan] for name in names(REGION_COLUMNS)}
    if regions:
        return row | values_of((*TRACKING_COLUMNS, *CORNER_COLUMNS), regions)
    nothing = [[nan] * len(roi.corners) for roi in rois]
    return row | {"lost": [False, False]} | dict.fromkeys(names(CORNER_COLUMNS), nothing)


def _has_saturated_region(row: Row) -> bool:
    return any(share > SATURATED_SHARE for share in row.get("saturated", ()))


def _with_findings(findings: Iterable[Finding]) -> Row:
    return {_FINDINGS: recorded(findings)}


def is_end(row: Row) -> bool:
    """Whether a row of the journal marks the end of the video instead of a frame."""
    return "end" in row


def variables(row: Row) -> Row:
    """Return the values of a row that are variables of the Dataset."""
    values = {name: value for name, value in row.items() if name not in (_FINDINGS, _INVALID)}
    findings = restored(row[_FINDINGS])
    return {**values, NOTE.name: note_text(findings), FINDINGS.name: findings_text(findings)}


class _ConvertedRegion(NamedTuple):
    """A region of a frame: its luminance map with what lies around it, its pixels, and their DN if 8-bit."""

    luminance: LuminanceMap
    window: Window
    mask: NDArray[np.bool_]
    dn: NDArray[np.uint8] | None


def region_pixels(frame: VideoFrame, converter: Converter, roi: Roi) -> RegionPixels:
    """Convert a region of a frame and what lies around it, as `RegionPixels.from_map` takes it from a whole map.

    Raises
    ------
    InputError
        If it lies outside the frame or holds no pixel.
    CalibrationError
        If the conversion is not for such frames.
    """
    converted = _converted_region(frame, converter, roi)
    assert frame.pixels is not None
    # Where the place decides too, DN are no levels of light.
    by_place = isinstance(converter.vignetting(frame.pixels.shape, frame.pixels.frame.readout), Cos4Vignetting)
    levels = None if by_place else converted.dn
    return RegionPixels.from_part(converted.luminance, roi, converted.window, converted.mask, dn=levels)


def region_mean(frame: VideoFrame, converter: Converter, roi: Roi) -> tuple[float, float]:
    """Return the mean light of a region of a frame, and the share of its saturated pixels.

    Raises
    ------
    InputError, CalibrationError
        As `region_pixels`, or if a pixel is not finite.
    """
    converted = _converted_region(frame, converter, roi)
    return mean_light(converted.luminance, roi, converted.mask)


def _converted_region(frame: VideoFrame, converter: Converter, roi: Roi) -> _ConvertedRegion:
    assert frame.pixels is not None
    pixels = frame.pixels
    # Of relative light nothing but the pixel itself and its place decide.
    in_part = pixels.part if converter.unit == "relative" and converter.options.bayer is None else None
    # A pixel of the map stands for a group of the colour filter.
    group = 2 if in_part is None and pixels.frame.colour_filter is not None else 1
    shape = pixels.shape[0] // group, pixels.shape[1] // group
    region = roi.divided(group)
    window = region.window(shape)
    part, inner = (pixels.frame, window) if in_part is None else (in_part(window), WHOLE)
    dn = part.dn[inner] if group == 1 and part.dn.dtype == np.uint8 and part.black_pattern is None else None
    position_px = None if in_part is None else (window[1].start, window[0].start, pixels.shape)
    light = converter.convert(part, inner, position_px)
    return _ConvertedRegion(light, window, _mask(region, shape), dn)


@lru_cache(maxsize=_MOST_MASKS)
def _mask(roi: Roi, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask of a region; that of one that stays is kept."""
    mask = roi.mask(shape)
    mask.flags.writeable = False
    return mask


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
            self._methods |= part.methods
        self._follows = any(method != "fixed" for method in self._methods.values())

    def run(self, progress: Progress | None) -> None:
        """Evaluate what is not in the journals yet."""
        if all(part.done for part in self._parts):
            return
        expected = self._selection.expected(self._source.frame_count, self._source.frame_rate)
        n_done = 0
        # Small steps in several threads wait for each other; a whole frame of neighbours does not.
        # Without a contrast the first frame gives it to the others.
        alone = self._methods or any(part.settings.contrasts is None for part in self._parts)
        with (
            closing(ahead(self._frames())) as frames,
            closing(self._evaluated_frames(frames, 0 if alone else 2)) as worked,
        ):
            for n_done, (item, rows) in enumerate(worked, start=1):
                for part, row in zip(self._parts, rows, strict=True):
                    part.record(item, row)
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

        return frames_of(self._source, self._selection, needed, entries())

    def _evaluated_frames(
        self, frames: Iterator[VideoFrame], n_workers: int
    ) -> Generator[tuple[TrackedFrame, list[dict[str, Any] | None]], None, None]:
        """Go through the chosen frames, each with its results for each part."""

        def work(item: TrackedFrame) -> tuple[TrackedFrame, list[dict[str, Any] | None]]:
            return item, [part.evaluated(item) for part in self._parts]

        return in_order((partial(work, item) for item in self._tracked_frames(frames)), n_workers)

    def _tracked_frames(self, frames: Iterator[VideoFrame]) -> Iterator[TrackedFrame]:
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
                    raise InputError(f"{self._unusable_text(unseen)}; {remedy}")
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
                yield TrackedFrame(frame, index, regions, repeats, light)
                index, last = index + 1, frame
        if unseen is not None and tracker is None:
            raise InputError(f"{self._unusable_text(unseen)}; the same applies to all others")

    def _unusable_text(self, frame: VideoFrame) -> str:
        """Return why the frame in which the regions were drawn cannot be used."""
        text = "" if frame.fault is None else finding_text(frame.fault)
        return f"frame {frame.number} of {self._source.path}, in which the regions are: {text}"

    def _tracker(self, first: StoredPixels) -> Tracker:
        """Make a tracker; a region that cannot be followed costs only its own pairs."""
        while True:
            try:
                return make_tracker(tuple(self._methods.values()), first.followed, tuple(self._methods), first.levels)
            except NotFollowedError as error:
                for part in self._parts:
                    if any(roi.name == error.region for roi in part.methods):
                        part.cannot_follow(error)
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
