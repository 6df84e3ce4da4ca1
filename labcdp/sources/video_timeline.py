"""When the frames of a video file are shown, by its packets: so that a frame the decoder loses leaves a gap."""

from __future__ import annotations

import heapq
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Packets read ahead. They lie in the order of decoding; H.264 and HEVC reorder by 16 frames at the most.
_AHEAD = 33
#: Time stamps closer than this are equal, milliseconds.
_TOLERANCE_MS = 0.05
#: Markers of JPEG frame headers, which hold the size (ITU-T T.81, table B.1).
_FRAME_HEADERS = (*range(0xC0, 0xC4), *range(0xC5, 0xC8), *range(0xC9, 0xCC), *range(0xCD, 0xD0))


class Timeline:
    """Time stamps of a file's packets in the order they are shown.

    Parameters
    ----------
    capture : cv2.VideoCapture
        Of the same file, set to packets (CAP_PROP_FORMAT -1); nothing read from it.
    motion_jpeg : bool
        Whether each packet is a JPEG image, which says its own size: OpenCV scales it to that of the first without a
        word.
    """

    def __init__(self, capture: Any, motion_jpeg: bool) -> None:
        self._capture, self._motion_jpeg = capture, motion_jpeg
        self._waiting: list[tuple[float, int, bool, tuple[int, int] | None]] = []
        self._read = 0
        self._more = True

    def lost_before(self, time_ms: float) -> list[float] | None:
        """Take the times of the packets before a decoded frame, and its own.

        Returns
        -------
        list of float or None
            Times of packets that gave no frame, milliseconds; None if no packet has this time, so that the packets do
            not tell.
        """
        lost: list[float] = []
        while True:
            self._fill()
            if not self._waiting or self._waiting[0][0] > time_ms + _TOLERANCE_MS:
                return None
            time, _, self.key, self.size = heapq.heappop(self._waiting)
            if time >= time_ms - _TOLERANCE_MS:
                return lost
            lost.append(time)

    def rest(self) -> list[float]:
        """Take the times of the packets that are left when the decoder gives no more frame."""
        left: list[float] = []
        while True:
            self._fill()
            if not self._waiting:
                return left
            left.append(heapq.heappop(self._waiting)[0])

    #: Whether the last frame builds on no other one.
    key: bool = False
    #: Height and width that the packet of the last frame states, None if it does not.
    size: tuple[int, int] | None = None

    def _fill(self) -> None:
        import cv2

        while self._more and len(self._waiting) < _AHEAD:
            self._more = self._capture.grab()
            if self._more:
                size = None
                if self._motion_jpeg:
                    _, packet = self._capture.retrieve()
                    size = None if packet is None else jpeg_size(packet.ravel())
                time_ms = self._capture.get(cv2.CAP_PROP_POS_MSEC)
                key = bool(self._capture.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME))
                heapq.heappush(self._waiting, (time_ms, self._read, key, size))
                self._read += 1


def jpeg_size(data: NDArray[np.uint8]) -> tuple[int, int] | None:
    """Height and width of a JPEG image by its frame header (ITU-T T.81, B.2.2); None if it has none."""
    at = 2
    while at + 9 < data.size and data[at] == 0xFF:
        if data[at + 1] in _FRAME_HEADERS:
            high_y, low_y, high_x, low_x = (int(v) for v in data[at + 5 : at + 9])
            return 256 * high_y + low_y, 256 * high_x + low_x
        at += 2 + 256 * int(data[at + 2]) + int(data[at + 3])
    return None
