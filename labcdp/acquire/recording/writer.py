"""Writing of frames in parallel to their acquisition: a writer thread with a bounded queue."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
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


@dataclass(frozen=True)
class _Event:
    kind: str
    content: Mapping[str, Any]


_FrameItem = tuple[Frame, Role, str | None]


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
        self._max_frames = max_frames
        self._max_bytes = max_bytes
        self._changed = threading.Condition()
        self._waiting: list[_FrameItem | _Event] = []
        self._held_frames = self._held_bytes = self._written = 0
        self._waited_s = 0.0
        self._started_s: float | None = None
        self._ended_s = 0.0
        self._closing = False
        self._error: BaseException | None = None
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
            self._thread.finish(self._close)
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
        size = frame.dn.nbytes
        with self._changed:
            asked_s = self._clock.monotonic_s()
            if self._started_s is None:
                self._started_s = asked_s
            self._changed.wait_for(lambda: self._error is not None or self._has_room(size))
            self._waited_s += self._clock.monotonic_s() - asked_s
            self._raise_error()
            self._held_frames += 1
            self._held_bytes += size
            self._waiting.append((frame, role, patch))
            self._changed.notify_all()

    def put_event(self, kind: str, content: Mapping[str, Any]) -> None:
        """Queue an event, recorded after all frames queued before; raises SessionError as `put`."""
        with self._changed:
            self._raise_error()
            self._waiting.append(_Event(kind, content))
            self._changed.notify_all()

    @property
    def throughput(self) -> Throughput:
        """Writing speed so far."""
        with self._changed:
            duration_s = 0.0 if self._started_s is None else max(self._ended_s - self._started_s, 0.0)
            return Throughput(self._written, duration_s, self._waited_s)

    def _has_room(self, size: int) -> bool:
        if self._held_frames == 0:
            return True
        return self._held_frames < self._max_frames and self._held_bytes + size <= self._max_bytes

    def _raise_error(self) -> None:
        if self._error is not None:
            raise self._error

    def _close(self) -> None:
        with self._changed:
            self._closing = True
            self._changed.notify_all()

    def _write(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing)
                if not self._waiting:
                    return
                group = self._next_group()
            try:
                self._record(group)
            except BaseException as error:
                with self._changed:
                    self._error = error if isinstance(error, Exception) else SessionError(f"writing ended: {error!r}")
                    self._waiting.clear()
                    self._changed.notify_all()
                return
            with self._changed:
                self._ended_s = self._clock.monotonic_s()
                frames = [item[0] for item in group if not isinstance(item, _Event)]
                self._held_frames -= len(frames)
                self._held_bytes -= sum(frame.dn.nbytes for frame in frames)
                self._written += len(frames)
                self._changed.notify_all()

    def _next_group(self) -> list[_FrameItem | _Event]:
        """Return the next event, or the frames up to it."""
        n = 0
        while n < min(len(self._waiting), _GROUP) and not isinstance(self._waiting[n], _Event):
            n += 1
        group = self._waiting[: max(n, 1)]
        del self._waiting[: len(group)]
        return group

    def _record(self, group: list[_FrameItem | _Event]) -> None:
        if isinstance(group[0], _Event):
            self._session.add_event(group[0].kind, group[0].content)
        else:
            self._session.add_frames([item for item in group if not isinstance(item, _Event)])
