"""Pool of receive buffers, which are reused when no frame refers to them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .library import aravis

#: Time the caller may be busy without losing a frame, in a short and in a long grab, and the memory limit for it.
_SHORT_S, _LONG_S = 0.5, 1.0
_POOL_BYTES = 256 * 2**20
_FEWEST, _MOST = 6, 512
_PAGE_BYTES = 4096


def pool_size(payload_bytes: int, frame_rate_hz: float | None, n_frames: int) -> int:
    """Return the number of receive buffers for up to a second of frames, within 256 MiB."""
    rate = frame_rate_hz or 0.0
    wanted = min(max(n_frames, round(rate * _SHORT_S)), round(rate * _LONG_S))
    return max(_FEWEST, min(wanted, _MOST, _POOL_BYTES // max(1, payload_bytes)))


class Loan:
    """The bytes of one received frame as base of a NumPy array; returned to the pool with the last view."""

    __slots__ = ("__array_interface__", "_buffer", "_memory", "_pool")

    def __init__(
        self, pool: BufferPool, buffer: Any, memory: NDArray[np.uint8], typestr: str, shape: tuple[int, ...]
    ) -> None:
        self._pool = pool
        self._buffer = buffer
        self._memory = memory
        self.__array_interface__ = {
            "version": 3,
            "typestr": typestr,
            "shape": shape,
            "data": (memory.ctypes.data, True),
        }

    def __del__(self) -> None:
        self._pool.give_back(self._buffer, self._memory)


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
    """

    def __init__(self, stream: Any, n_buffers: int, payload_bytes: int) -> None:
        self._arv = aravis()
        self._stream = stream
        self._n_buffers = n_buffers
        self._payload_bytes = payload_bytes
        # Memory of the buffers in the stream, by the address of the Aravis buffer.
        self._memory: dict[int, tuple[Any, NDArray[np.uint8]]] = {}
        # Aravis' thread writes to it until the stream is destroyed, in whatever thread.
        stream.labcdp_memory = self._memory
        for _ in range(n_buffers):
            self._add()

    def _add(self) -> None:
        memory = np.empty(self._payload_bytes, dtype=np.uint8)
        # Touch all pages now: page faults would delay Aravis' thread while it receives packets.
        memory[::_PAGE_BYTES] = 0
        self._push(self._stream, self._arv.Buffer.new(memory.nbytes, memory.ctypes.data), memory)

    def _push(self, stream: Any, buffer: Any, memory: NDArray[np.uint8]) -> None:
        self._memory[hash(buffer)] = (buffer, memory)
        stream.push_buffer(buffer)

    def lend(self, buffer: Any, typestr: str, shape: tuple[int, ...]) -> NDArray[Any]:
        """Return a received buffer's data as a read-only array without copying them.

        Parameters
        ----------
        buffer : Aravis.Buffer
            Buffer popped from the stream.
        typestr : str
            Type of an element, as in NumPy's array interface.
        shape : tuple of int
            Shape of the array.
        """
        _, memory = self._memory.pop(hash(buffer))
        stream = self._stream
        # One more is being filled and is in neither queue.
        if stream is not None and sum(stream.get_n_buffers()) < self._n_buffers // 2:
            self._add()
        return np.asarray(Loan(self, buffer, memory, typestr, shape))

    def take_back(self, buffer: Any) -> None:
        """Return an unused buffer to the stream."""
        _, memory = self._memory.pop(hash(buffer))
        self.give_back(buffer, memory)

    def give_back(self, buffer: Any, memory: NDArray[np.uint8]) -> None:
        """Return a buffer to the stream if it still exists and needs one; thread-safe."""
        stream = self._stream
        if stream is not None and sum(stream.get_n_buffers()) < self._n_buffers:
            self._push(stream, buffer, memory)

    def close(self) -> None:
        """Stop supplying the stream and release it; lent buffers stay valid."""
        self._stream = None
