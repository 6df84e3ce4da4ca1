"""Frames of a video file in the order they are shown: their times, and what is missing or damaged."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from av import FFmpegError
from av import logging as av_logging
from av.codec.context import Flags

from ...core.result import Finding, warning
from .source import size_differs

#: Codecs whose decoder marks frames that it patched up; of others its messages count.
_MARKING = ("flv", "h261", "h263", "h264", "mjpeg", "mpeg1video", "mpeg2video", "mpeg4", "vc1", "wmv1", "wmv2", "wmv3")
#: What counts as an error: for decoders that give up at the first wrong bit, as each packet is a frame of its own and a
#: broken one a lost one; and what no encoder does, which of MPEG-4 some encoders do.
_STRICT = {"mjpeg": "crccheck+bitstream+buffer+explode", "h264": "crccheck+aggressive"}
#: Frames that wait at least, as decoders reorder by more than they say at first.
_HELD = 3
#: Packets of which the place is known; no codec reorders by more.
_REMEMBERED = 1000


@dataclass(frozen=True, eq=False)
class Shown:
    """A frame.

    Parameters
    ----------
    number : int
        Number in the video; lost ones count.
    time_s : float
        Time since the first frame.
    frame : av.VideoFrame or None
        What was decoded.
    fault : Finding or None
        Why it is not to be trusted.
    """

    number: int
    time_s: float
    frame: Any
    fault: Finding | None


def shown_frames(container: Any, shape: tuple[int, int] | None, frame_rate: float | None) -> Iterator[Shown]:
    """Decode all frames of the first video stream.

    Parameters
    ----------
    container : av.container.InputContainer
        The file; nothing read from it.
    shape : (int, int) or None
        Height and width the frames should have.
    frame_rate : float or None
        For files without time stamps.
    """
    stream = container.streams.video[0]
    context = stream.codec_context
    if context.codec.name in _STRICT:
        context.options = {**context.options, "err_detect": _STRICT[context.codec.name]}
    if context.codec.name not in _MARKING:
        # A message of another thread may come too late for its frame, and waits for this thread, which may wait for it.
        context.thread_count = 1
    elif context.codec.name != "mjpeg":
        context.thread_type = "AUTO"
    # Frames that build on missing ones come too, with a mark.
    context.flags |= Flags.output_corrupt
    first = None
    for number, (pts, frame, damage) in enumerate(_in_order(container, stream)):
        if pts is None:
            # Without time stamps the frames are counted.
            time_s = number / frame_rate if frame_rate else float(number)
        else:
            first = pts if first is None else first
            time_s = float((pts - first) * stream.time_base)
        fault = warning(damage) if damage else None
        if frame is not None and shape is not None:
            if (frame.height, frame.width) != shape:
                fault, frame = size_differs((frame.height, frame.width), shape), None
            elif frame.interlaced_frame:
                fault, frame = warning("frame-interlaced"), None
        yield Shown(number, time_s, frame, fault)


class _Packets:
    """Packets in the order of decoding: which of them gave no frame, and which frames are damaged by others."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._waiting: list[int] = []
        self._place: dict[int, int] = {}
        self._keys: list[tuple[int, int]] = []
        self._damage: list[int] = []
        self._count = 0
        self._last: int | None = None
        #: Whether frames come with rising time stamps; else the n-th one has the n-th time of all packets.
        self.ordered = True

    def sent(self, packet: Any) -> None:
        """Take note of a packet."""
        at = packet.dts if packet.pts is None else packet.pts
        self.ordered = self.ordered and packet.pts is not None
        if packet.is_corrupt:
            self._damage.append(self._count)
        # A frame of VP8 that is only referred to is never shown (RFC 6386, 9.1).
        if at is not None and not (self._context.codec.name == "vp8" and not bytes(packet)[0] & 0x10):
            heapq.heappush(self._waiting, at)
            self._place[at] = self._count
            if len(self._place) > _REMEMBERED:
                del self._place[next(iter(self._place))]
        self._count += 1

    def reported(self) -> None:
        """Take note of a message of the decoder: what is wrong with a packet may show only in the one after it."""
        self._damage.extend(range(max(self._count - 2, 0), self._count))

    def decoded(self, frame: Any) -> int:
        """Take note of a frame that came out; return its place in the order of decoding."""
        place = self._place.get(frame.pts, self._count - 1)
        if frame.key_frame:
            self._keys.append((place, frame.pts or 0))
        if frame.is_corrupt:
            self._damage.append(place)
        self.ordered = self.ordered and frame.pts is not None and (self._last is None or frame.pts > self._last)
        self._last = frame.pts
        return place

    def time(self) -> int | None:
        """Take the next time."""
        return heapq.heappop(self._waiting) if self._waiting else None

    def lost_before(self, frame: Any) -> Iterator[int]:
        """Take the times before that of a frame: packets that gave none."""
        while self.ordered and self._waiting and self._waiting[0] < frame.pts:
            at = heapq.heappop(self._waiting)
            self._damage.append(self._place.get(at, 0))
            yield at

    def damage_of(self, frame: Any, place: int) -> str:
        """Code of what is wrong with a frame, empty for nothing."""
        before = [key for key in self._keys if key[0] <= place]
        since = before[-1][0] if before else 0
        if len(before) > 1 and (frame.pts or 0) < before[-1][1]:
            # Shown before the key frame that it was decoded after, it builds on frames before that one too.
            since = before[-2][0]
        if len(before) > 2:
            self._keys = self._keys[-3:]
            self._damage = [one for one in self._damage if one >= self._keys[0][0]]
        if place in self._damage:
            return "frame-damaged"
        return "frame-builds-on-broken" if any(since <= one < place for one in self._damage) else ""


def _in_order(container: Any, stream: Any) -> Iterator[tuple[int | None, Any, str]]:
    """Time stamp, frame and code of the damage of each frame; no frame where a packet gave none."""
    packets = _Packets(stream.codec_context)
    held: deque[tuple[Any, int]] = deque()

    def released() -> Iterator[tuple[int | None, Any, str]]:
        frame, place = held.popleft()
        yield from ((at, None, "frame-not-decoded") for at in packets.lost_before(frame))
        yield packets.time(), frame, packets.damage_of(frame, place)

    with _messages(stream.codec_context.codec.name not in _MARKING) as n_messages:
        for packet in container.demux(stream):
            before = n_messages()
            if packet.size:
                packets.sent(packet)
            try:
                held.extend((frame, packets.decoded(frame)) for frame in packet.decode())
            except FFmpegError:
                if not packets.ordered:
                    yield packets.time(), None, "frame-not-decoded"
            if n_messages() > before:
                packets.reported()
            # That a frame is damaged shows only when it comes, after some that build on it.
            while len(held) > max(stream.codec_context.has_b_frames, _HELD):
                yield from released()
        while held:
            yield from released()
        while (at := packets.time()) is not None:
            yield at, None, "frame-not-decoded"


@contextmanager
def _messages(count: bool) -> Iterator[Callable[[], int]]:
    """Count the errors that decoders report; always 0 if they are not to be counted."""
    if not count:
        yield lambda: 0
        return
    level = av_logging.get_level()
    # At any other level messages would be printed; errors are counted at this one too.
    av_logging.set_level(av_logging.PANIC if level is None else level)
    try:
        yield lambda: int(av_logging.get_last_error()[0])
    finally:
        av_logging.set_level(level)
