"""Writing of frames in parallel to their acquisition: a writer thread with a bounded queue."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from queue import SimpleQueue
from types import TracebackType
from typing import Any, Self

from ...core.clock import Clock
from ...core.computer.threads import InterruptSafeThread
from ...core.errors import SessionError
from ...core.frame import Frame
from ...session import Role, Session

#: Bounds of the queue in frames and bytes: two seconds of a 5 megapixel camera at 15 frames/s.
MAX_FRAMES = 32
MAX_BYTES = 512 * 2**20
#: Frames per batch: large enough to share flushes to the disk, small enough to free the queue soon.
_GROUP = 8
#: Share of waiting time above which the disk is the bottleneck.
_LIMITED_SHARE = 0.1


@dataclass(frozen=True)
class Throughput:
    """Writing speed.

    Parameters
    ----------
    frames : int
        Frames written.
    duration_s : float
        Time from the first frame to the end of writing.
    waited_s : float
        Time the acquisition waited for space in the queue.
    """

    frames: int
    duration_s: float
    waited_s: float

    @property
    def limited_by_disk(self) -> bool:
        """Whether the disk was the bottleneck."""
        return self.waited_s > _LIMITED_SHARE * self.duration_s

    @property
    def frames_per_s(self) -> float:
        """Frames written per second; 0 if no time passed."""
        return self.frames / self.duration_s if self.duration_s > 0 else 0.0


_FrameItem = tuple[Frame, Role, str | None]
_Event = tuple[str, Mapping[str, Any]]


class FrameWriter:
    """Context manager that writes to a session in a thread of its own, as the only writer.

    All data is on the disk when the ``with`` block is left, also by an exception.

    Parameters
    ----------
    session : Session
        Open for writing.
    clock : Clock
        Measures the waiting time.
    max_frames, max_bytes : int
        Size of the queue; one frame always fits.
    """

    def __init__(
        self, session: Session, clock: Clock, max_frames: int = MAX_FRAMES, max_bytes: int = MAX_BYTES
    ) -> None:
        self._session = session
        self._clock = clock
        self._limits = max_frames, max_bytes
        # Frames that are queued or being written take room; events take none.
        self._room: threading.Semaphore | None = None
        self._items: SimpleQueue[_FrameItem | _Event | None] = SimpleQueue()
        self._written = 0
        self._waited_s = self._started_s = self._ended_s = 0.0
        self._error: Exception | None = None
        self._thread = InterruptSafeThread(self._write, "labcdp frame writer")

    def __enter__(self) -> Self:
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write all pending data and stop the thread.

        Raises
        ------
        SessionError
            If something could not be written and `put` has not raised it.
        """
        try:
            # Ctrl-C is raised only afterwards, so that no queued frame is lost.
            self._thread.finish(lambda: self._items.put(None))
        finally:
            if self._error is not None and error is not self._error:
                raise self._error

    def put(self, frame: Frame, role: Role, patch: str | None) -> None:
        """Queue a frame; blocks while the queue is full.

        Raises
        ------
        SessionError
            If an earlier frame or event could not be written.
        """
        self._raise_error()
        asked_s = self._clock.monotonic_s()
        if self._room is None:
            # All frames of a recording have one size.
            max_frames, max_bytes = self._limits
            self._started_s = asked_s
            self._room = threading.Semaphore(max(1, min(max_frames, max_bytes // frame.dn.nbytes)))
        self._room.acquire()
        self._waited_s += self._clock.monotonic_s() - asked_s
        self._raise_error()
        self._items.put((frame, role, patch))

    def put_event(self, kind: str, content: Mapping[str, Any]) -> None:
        """Queue an event, recorded after all frames queued before; raises SessionError as `put`."""
        self._raise_error()
        self._items.put((kind, content))

    @property
    def throughput(self) -> Throughput:
        """Writing speed so far."""
        return Throughput(self._written, max(self._ended_s - self._started_s, 0.0), self._waited_s)

    def _raise_error(self) -> None:
        if self._error is not None:
            raise self._error

    def _write(self) -> None:
        try:
            self._write_all()
        except BaseException as error:
            self._error = error if isinstance(error, Exception) else SessionError(f"writing ended: {error!r}")
            if self._room is not None:
                self._room.release()

    def _write_all(self) -> None:
        """Write what is queued, in order, up to the end mark; frames that wait together are written together."""
        group: list[_FrameItem] = []
        item: _FrameItem | _Event | None = None
        while True:
            item = self._items.get()
            if item is not None and len(item) == 3:
                group.append(item)
                if len(group) < _GROUP and not self._items.empty():
                    continue
            if group:
                self._record(group)
                group = []
            if item is None:
                return
            if len(item) == 2:
                self._session.add_event(*item)

    def _record(self, group: list[_FrameItem]) -> None:
        assert self._room is not None
        self._session.add_frames(group)
        self._ended_s = self._clock.monotonic_s()
        self._written += len(group)
        self._room.release(len(group))
