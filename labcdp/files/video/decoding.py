"""Frames of a video file in the order they are shown: their times, and what is missing or damaged.

Packets that are not to be shown count for nothing, as in other programs that decode with FFmpeg: those before the start
of an edit list, frames of VP8 and VP9 that others only refer to, placeholders of MPEG-4, and frames before the first
key frame of a file that was cut from a longer one.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain
from typing import Any

from av import FFmpegError
from av import logging as av_logging
from av.codec.context import Flags
from av.stream import Disposition

from ...core.result import Finding, warning
from .source import size_differs

#: Codecs whose decoder marks frames that it patched up; of others its messages count.
_MARKING = ("flv", "h261", "h263", "h264", "mjpeg", "mpeg1video", "mpeg2video", "mpeg4", "vc1", "wmv1", "wmv2", "wmv3")
#: What counts as an error: for decoders that give up at the first wrong bit, as each packet is a frame of its own and a
#: broken one a lost one; and what no encoder does, which of MPEG-4 some encoders do.
_STRICT = {"mjpeg": "crccheck+bitstream+buffer+explode", "h264": "crccheck+aggressive"}
#: Frames that wait at least, as decoders reorder by more than they say at first.
_HELD = 3
#: Packets of which the place is known; no codec reorders by more. The first key frame is among as many.
_REMEMBERED = 1000
#: Size of a packet of MPEG-4 from which it holds a picture; encoders fill up with smaller ones, which give no frame
#: (FFmpeg's filter mpeg4_unpack_bframes).
_LEAST_MPEG4_BYTES = 20


def video_stream(container: Any) -> Any:
    """Return the first video stream of an opened file that is no picture of its cover; None if there is none."""
    return next(iter(video_streams(container)), None)


def video_streams(container: Any) -> list[Any]:
    """All video streams of an opened file that are no picture of its cover."""
    return [stream for stream in container.streams.video if not stream.disposition & Disposition.attached_pic]


def shown_frames(
    container: Any, shape: tuple[int, int] | None, frame_rate: float | None
) -> Iterator[tuple[int, float, Any, Finding | None]]:
    """Decode all frames of the video stream.

    Parameters
    ----------
    container : av.container.InputContainer
        The file; nothing read from it.
    shape : (int, int) or None
        Height and width the frames should have.
    frame_rate : float or None
        For files without time stamps.

    Yields
    ------
    (int, float, av.VideoFrame or None, Finding or None)
        Number in the video, of which lost frames are part; time since the first frame in seconds; what was decoded; and
        why that is not to be trusted.
    """
    stream = video_stream(container)
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
        yield number, time_s, frame, fault


def _is_shown(packet: Any, codec: str) -> bool:
    """Whether a packet should give a frame."""
    if packet.is_discard:
        return False
    data = memoryview(packet)
    if codec == "vp8":
        # A frame that is only referred to (RFC 6386, 9.1).
        return bool(data[0] & 0x10)
    if codec == "vp9":
        return _is_shown_vp9(data)
    return not (codec == "mpeg4" and len(data) < _LEAST_MPEG4_BYTES)


def _is_shown_vp9(data: memoryview) -> bool:
    """Whether a packet of VP9 shows a frame (VP9 Bitstream Specification 0.6, 6.2 and annex B); a superframe does."""
    if data[-1] & 0xE0 == 0xC0:
        return True
    bits = f"{int.from_bytes(data[:2].tobytes().ljust(2, bytes(1)), 'big'):016b}"
    # Behind marker and profile, of which the last has one bit more: show_existing_frame, frame_type, show_frame.
    at = 5 if bits[2:4] == "11" else 4
    return bits[at] == "1" or bits[at + 2] == "1"


class _Packets:
    """Packets in the order of decoding: which of them gave no frame, and which frames are damaged by others.

    Parameters
    ----------
    context : av.CodecContext
        Their decoder.
    first_key : (int, int or None)
        Place and time of the first key frame; (0, None) if there is nothing before it.
    """

    def __init__(self, context: Any, first_key: tuple[int, int | None]) -> None:
        self._context = context
        self._first_key = first_key
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
        if at is not None and _is_shown(packet, self._context.codec.name):
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
        position = self._place.get(frame.pts, self._count - 1)
        if frame.key_frame:
            self._keys.append((position, frame.pts or 0))
        if frame.is_corrupt and not self.is_before_first_key(frame.pts, position):
            self._damage.append(position)
        self.ordered = self.ordered and frame.pts is not None and (self._last is None or frame.pts > self._last)
        self._last = frame.pts
        return position

    def time(self) -> int | None:
        """Take the next time."""
        return heapq.heappop(self._waiting) if self._waiting else None

    def time_of(self, frame: Any) -> int | None:
        """Take the time of a frame, before which there is none left."""
        if not self.ordered or (self._waiting and self._waiting[0] <= frame.pts):
            return self.time()
        # A packet that was not expected to give one.
        return int(frame.pts)

    def lost_before(self, frame: Any) -> Iterator[int]:
        """Take the times before that of a frame: packets that gave none."""
        while self.ordered and self._waiting and self._waiting[0] < frame.pts:
            at = heapq.heappop(self._waiting)
            position = self._place.get(at, 0)
            if not self.is_before_first_key(at, position):
                self._damage.append(position)
                yield at

    def is_before_first_key(self, at: int | None, position: int) -> bool:
        """Whether a packet was to be shown, or decoded, before the first key frame: what it refers to was cut off."""
        key_place, key_at = self._first_key
        return position < key_place or (None not in (at, key_at) and at < key_at)  # type: ignore[operator]

    def damage_of(self, frame: Any, position: int) -> str:
        """Code of what is wrong with a frame, empty for nothing."""
        before = [key for key in self._keys if key[0] <= position]
        since = before[-1][0] if before else 0
        if len(before) > 1 and (frame.pts or 0) < before[-1][1]:
            # Shown before the key frame that it was decoded after, it builds on frames before that one too.
            since = before[-2][0]
        if len(before) > 2:
            self._keys = self._keys[-3:]
            self._damage = [damaged for damaged in self._damage if damaged >= self._keys[0][0]]
        if position in self._damage:
            return "frame-damaged"
        if position < self._first_key[0]:
            return "frame-builds-on-broken"
        return "frame-builds-on-broken" if any(since <= damaged < position for damaged in self._damage) else ""


def _in_order(container: Any, stream: Any) -> Iterator[tuple[int | None, Any, str]]:
    """Time stamp, frame and code of the damage of each frame; no frame where a packet gave none."""
    is_marking = stream.codec_context.codec.name in _MARKING
    begin, first_key = _until_first_key(demuxed := container.demux(stream))
    if not is_marking and first_key[0]:
        # These decoders give nothing before a key frame but messages, which would count for it.
        begin, first_key = begin[-1:], (0, first_key[1])
    packets = _Packets(stream.codec_context, first_key)
    held: deque[tuple[Any, int]] = deque()

    def released() -> Iterator[tuple[int | None, Any, str]]:
        frame, position = held.popleft()
        yield from ((at, None, "frame-not-decoded") for at in packets.lost_before(frame))
        at = packets.time_of(frame)
        if not (frame.is_corrupt and packets.is_before_first_key(frame.pts, position)):
            yield at, frame, packets.damage_of(frame, position)

    with _messages(not is_marking) as n_messages:
        for packet in chain(begin, demuxed):
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


def _until_first_key(packets: Iterator[Any]) -> tuple[list[Any], tuple[int, int | None]]:
    """Take packets up to the first key frame; return them, and its place and time, (0, None) if none is a key frame."""
    begin: list[Any] = []
    for packet in packets:
        begin.append(packet)
        if packet.is_keyframe:
            return begin, (sum(1 for earlier in begin if earlier.size) - 1, packet.pts)
        if len(begin) == _REMEMBERED:
            break
    return begin, (0, None)


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
