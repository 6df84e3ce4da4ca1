"""Received frames: the buffers that they are received into, and checks that they are complete."""

from __future__ import annotations

import contextlib
import logging
import mmap
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.dn import PixelFormat
from ..camera import CameraSettingError, IncompleteFrameError
from ..camera_settings import FREE_RUN, CameraSettings
from .library import aravis

_log = logging.getLogger(__name__)

#: Time the caller may be busy without losing a frame, in a short and in a long grab, and the memory limit for it.
_SHORT_S, _LONG_S = 0.5, 1.0
_POOL_BYTES = 256 * 2**20
#: Largest frame that is received; those of 150 megapixels in 16 bits have 300 MB.
_MOST_PAYLOAD_BYTES = 2**30
_FEWEST, _MOST = 6, 512
#: Time over which fast frames are gathered: waking for each costs several times as much as a frame that waits already.
_GATHERED_S = 0.05


def pool_size(payload_bytes: int, frame_rate_hz: float | None, n_frames: int) -> int:
    """Return the number of receive buffers for up to a second of frames, within 256 MiB."""
    rate = frame_rate_hz or 0.0
    wanted = min(max(n_frames, round(rate * _SHORT_S)), round(rate * _LONG_S))
    return max(_FEWEST, min(wanted, _MOST, _POOL_BYTES // max(1, payload_bytes)))


def gather_s(settings: CameraSettings, n_frames: int) -> float:
    """Return the time in which several of `n_frames` arrive from a fast camera; 0 to take each as it arrives."""
    rate_hz = settings.frame_rate_hz or 0.0
    n_gathered = min(n_frames, int(rate_hz * _GATHERED_S))
    return n_gathered / rate_hz if n_gathered > 1 and settings.trigger == FREE_RUN else 0.0


class _Slot(NamedTuple):
    """An Aravis buffer, its memory, and how NumPy sees that."""

    buffer: Any
    pages: mmap.mmap
    interface: dict[str, Any]


class Loan:
    """The bytes of one received frame as base of a NumPy array; returned to the pool with the last view."""

    __slots__ = ("__array_interface__", "_pool", "_slot")

    def __init__(self, pool: BufferPool, slot: _Slot) -> None:
        self._pool = pool
        self._slot = slot
        self.__array_interface__ = slot.interface

    def __del__(self) -> None:
        self._pool.give_back(self._slot)


class BufferPool:
    """The buffers of one stream.

    A buffer is either in the stream or lent. Views of a lent buffer may outlive the stream and be dropped by any
    thread. The pool grows while too many are lent, and shrinks when they are returned.

    Parameters
    ----------
    stream : Aravis.Stream
        Stream that receives the buffers.
    n_buffers : int
        Number of buffers in the stream.
    payload_bytes : int
        Size of each.
    typestr : str
        Type of an element, as in NumPy's array interface.
    shape : tuple of int
        Shape of the arrays.
    """

    def __init__(self, stream: Any, n_buffers: int, payload_bytes: int, typestr: str, shape: tuple[int, ...]) -> None:
        self._stream = stream
        self._n_buffers = n_buffers
        self._payload_bytes = payload_bytes
        self._layout = {"version": 3, "typestr": typestr, "shape": shape}
        # Those in the stream, by the address of the Aravis buffer.
        self._inside: dict[int, _Slot] = {}
        # Aravis' thread writes to them until the stream is destroyed, in whatever thread.
        stream.labcdp_memory = self._inside
        for _ in range(n_buffers):
            self._add()

    def _add(self) -> None:
        # Not of the heap, which would keep the memory of former streams in pieces.
        pages = mmap.mmap(-1, self._payload_bytes, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        with contextlib.suppress(OSError):  # not every kernel has them; packets are copied a fifth faster with them
            pages.madvise(mmap.MADV_HUGEPAGE)
        memory = np.frombuffer(pages, dtype=np.uint8)
        # Touch all pages now: page faults would delay Aravis' thread while it receives packets.
        memory[:: mmap.PAGESIZE] = 0
        address = memory.ctypes.data
        buffer = aravis().Buffer.new(self._payload_bytes, address)
        self._push(self._stream, _Slot(buffer, pages, self._layout | {"data": (address, True)}))

    def _push(self, stream: Any, slot: _Slot) -> None:
        self._inside[hash(slot.buffer)] = slot
        stream.push_buffer(slot.buffer)

    def lend(self, buffer: Any) -> NDArray[Any]:
        """Return the data of a buffer popped from the stream as a read-only array without copying them."""
        slot = self._inside.pop(hash(buffer))
        if self._stream is not None and len(self._inside) < self._n_buffers // 2:
            self._add()
        return np.asarray(Loan(self, slot))

    def take_back(self, buffer: Any) -> None:
        """Return an unused buffer to the stream."""
        self.give_back(self._inside.pop(hash(buffer)))

    def give_back(self, slot: _Slot) -> None:
        """Return a buffer to the stream if it still exists and needs one; thread-safe."""
        stream = self._stream
        if stream is not None and len(self._inside) < self._n_buffers:
            self._push(stream, slot)

    def close(self) -> None:
        """Stop supplying the stream and release it; lent buffers stay valid."""
        self._stream = None


#: Explanation of each failure, by the name of the Aravis buffer status or one of labcdp.
REASONS = {
    "TIMEOUT": "packets stopped coming in the middle of it",
    "MISSING_PACKETS": "packets were lost on the way",
    "WRONG_PACKET_ID": "its packets had wrong numbers",
    "SIZE_MISMATCH": "its size is not the announced one",
    "FILLING": "it was still being received",
    "ABORTED": "its stream was aborted",
    "WRONG_FRAME_ID": "its number does not follow that of the previous frame",
}

#: Status of a complete frame that is not as set, by its chunk data.
NOT_AS_SET = "NOT_AS_SET"

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
        self._without_image = aravis().BufferPayloadType.CHUNK_DATA
        self._size = (settings.width, settings.height)
        self._layout = layout
        self.pixel_bytes = layout.payload_bytes(settings.width * settings.height)
        self._ids = FrameIds(reserves_zero)
        self.n_left_out = 0

    def require_payload(self, payload_bytes: int) -> None:
        """Refuse empty or huge frames, and a PayloadSize less than their pixels; raises CameraSettingError."""
        if min(self._size) < 1 or payload_bytes > _MOST_PAYLOAD_BYTES:
            raise CameraSettingError(
                f"it states {self._size[0]} x {self._size[1]} pixels and a PayloadSize of {payload_bytes} bytes",
                "set Width and Height to those of its sensor",
            )
        if payload_bytes < self.pixel_bytes:
            raise CameraSettingError(
                f"PayloadSize is {payload_bytes} bytes, but {self._size[0]} x {self._size[1]} pixels of "
                f"{self._layout.name} are {self.pixel_bytes}",
                "choose another pixel format or region",
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
        # The leader of frames of nothing but chunks says neither size nor format, both of which are locked.
        if buffer.get_payload_type() != self._without_image and (other := self._other_image(buffer)):
            return "SIZE_MISMATCH", other
        if received_bytes < self.pixel_bytes:
            return "SIZE_MISMATCH", f"{received_bytes} bytes of {self.pixel_bytes} came"
        if left_out is None:
            return "WRONG_FRAME_ID", REASONS["WRONG_FRAME_ID"]
        return None

    def _other_image(self, buffer: Any) -> str:
        """Return what of size and format is not as wanted; empty if both are."""
        size = (buffer.get_image_width(), buffer.get_image_height())
        if size != self._size:
            wanted = " x ".join(map(str, self._size))
            return f"it has {size[0]} x {size[1]} pixels, not {wanted}"
        code = buffer.get_image_pixel_format()
        if code != self._layout.code:
            return f"its pixel format is {code:#010x}, not {self._layout.code:#010x} ({self._layout.name})"
        return ""


def refusal(who: object, buffer: Any, fault: tuple[str, str], advice: str) -> IncompleteFrameError:
    """Return the error for a refused frame."""
    status, reason = fault
    frame_id = buffer.get_frame_id()
    state = "not as set" if status == NOT_AS_SET else "incomplete"
    return IncompleteFrameError(
        f"frame {frame_id} from {who} is {state}, {reason}",
        f"it was discarded; {advice}",
        status=status,
        frame_id=frame_id,
        camera_timestamp_ns=buffer.get_timestamp(),
        timestamp=arrival(buffer),
    )


def arrival(buffer: Any) -> datetime:
    """Host time at which a frame arrived."""
    return datetime.fromtimestamp(buffer.get_system_timestamp() * 1e-9, UTC)
