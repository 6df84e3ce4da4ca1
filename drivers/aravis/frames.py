"""Checks that a received frame is complete."""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from typing import Any

from ...core.pixel_format import PixelFormat
from ..camera import CameraSettingError, CameraSettings, IncompleteFrameError
from .library import aravis

_log = logging.getLogger(__name__)

#: Explanation of each failure, by the name of the Aravis buffer status or one of labcdp.
REASONS = {
    "TIMEOUT": "packets stopped coming in the middle of it",
    "MISSING_PACKETS": "packets were lost on the way",
    "WRONG_PACKET_ID": "its packets were numbered wrongly",
    "SIZE_MISMATCH": "its size is not the one announced",
    "FILLING": "it was still being received",
    "ABORTED": "its frame_stream was aborted",
    "WRONG_FRAME_ID": "its number is not after that of the frame before",
}

#: Frame ids of GigE Vision 1 have 16 bits and leave out 0, which is reserved (GigE Vision 2.0, 24.2).
_LARGEST_SHORT_ID = 0xFFFF


class FrameIds:
    """The order of frame ids in a stream.

    Parameters
    ----------
    reserves_zero : bool
        Whether 0 is no frame id, as in GigE Vision.
    """

    def __init__(self, reserves_zero: bool) -> None:
        self._reserves_zero = reserves_zero
        self._last: int | None = None
        self._wrong: list[int] = []

    def left_out(self, frame_id: int) -> int | None:
        """Return the number of skipped ids before this one; None if it does not follow the previous one.

        An id that follows a rejected one is accepted, so that a camera may restart its counter.
        """
        step = self._step(self._last, frame_id)
        if step is None and self._wrong and self._step(self._wrong[-1], frame_id) == 1:
            step = 1
        if step is None:
            self._wrong.append(frame_id)
            return None
        left_out = max(0, step - 1 - len(self._wrong))
        self._last, self._wrong = frame_id, []
        return left_out

    def _step(self, last: int | None, frame_id: int) -> int | None:
        """Return the number of ids from one to another; None if backward."""
        if self._reserves_zero and frame_id == 0:
            return None
        if last is None:
            return 1
        step = frame_id - last
        if self._reserves_zero and max(frame_id, last) <= _LARGEST_SHORT_ID:
            # The shorter way around the counter decides between forward and backward.
            step %= _LARGEST_SHORT_ID
            if step > _LARGEST_SHORT_ID // 2:
                return None
        return step if step > 0 else None


class FrameCheck:
    """Checks frames of one stream for completeness.

    Parameters
    ----------
    settings : CameraSettings
        Settings of the stream.
    layout : PixelFormat
        Pixel format.
    reserves_zero : bool
        As for `FrameIds`.
    """

    def __init__(self, settings: CameraSettings, layout: PixelFormat, reserves_zero: bool) -> None:
        self._success = aravis().BufferStatus.SUCCESS
        self._size = (settings.width, settings.height)
        self._layout = layout
        self._n_bytes = layout.payload_bytes(settings.width * settings.height)
        self._ids = FrameIds(reserves_zero)
        self.n_left_out = 0

    def require_payload(self, payload_bytes: int) -> None:
        """Refuse a camera whose PayloadSize is less than its pixels; raises CameraSettingError."""
        if payload_bytes < self._n_bytes:
            raise CameraSettingError(
                f"PayloadSize is {payload_bytes} bytes, but {self._size[0]} x {self._size[1]} pixels of "
                f"{self._layout.name} are {self._n_bytes}: choose another pixel format or region"
            )

    def fault(self, buffer: Any, received_bytes: int) -> tuple[str, str] | None:
        """Return status and reason for refusing a frame of so many bytes; None for a complete one."""
        status = buffer.get_status()
        left_out = self._ids.left_out(buffer.get_frame_id())
        if left_out:
            self.n_left_out += left_out
            _log.warning("%d missing frames before frame %d", left_out, buffer.get_frame_id())
        if status != self._success:
            name = status.value_nick.upper().replace("-", "_")
            return name, REASONS.get(name, name)
        size = (buffer.get_image_width(), buffer.get_image_height())
        if size != self._size:
            wanted = " x ".join(map(str, self._size))
            return "SIZE_MISMATCH", f"it has {size[0]} x {size[1]} pixels, not {wanted}"
        if received_bytes < self._n_bytes:
            return "SIZE_MISMATCH", f"{received_bytes} bytes of {self._n_bytes} came"
        code = buffer.get_image_pixel_format()
        if code != self._layout.code:
            return (
                "SIZE_MISMATCH",
                f"its pixel format is {code:#010x}, not {self._layout.code:#010x} ({self._layout.name})",
            )
        if left_out is None:
            return "WRONG_FRAME_ID", REASONS["WRONG_FRAME_ID"]
        return None


def refusal(who: object, buffer: Any, fault: tuple[str, str], advice: str) -> IncompleteFrameError:
    """Return the error for a refused frame."""
    status, reason = fault
    frame_id = buffer.get_frame_id()
    return IncompleteFrameError(
        f"frame {frame_id} from {who} is incomplete, {reason}: it is refused; {advice}",
        status=status,
        frame_id=frame_id,
        camera_timestamp_ns=buffer.get_timestamp(),
        timestamp=arrival(buffer),
    )


def arrival(buffer: Any) -> datetime:
    """Host time at which a frame arrived."""
    return datetime.fromtimestamp(buffer.get_system_timestamp() * 1e-9, UTC)
