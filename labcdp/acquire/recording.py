"""Writing of frames in parallel to their acquisition: a writer thread with a bounded queue."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from queue import SimpleQueue
from types import TracebackType
from typing import Any, Self

from ..core.clock import Clock
from ..core.computer import InterruptSafeThread
from ..core.errors import SessionError
from ..core.frame import Frame
from ..drivers.computer import raise_priority
from ..drivers.meter import Meter, require_mode
from ..session import ReadingRecord, Role, Session
from .checks import settling_drift_rel
from .control import Announced, Control, Progress, Report
from .operator import Operator
from .plan import readings_wanted, remaining

#: Bounds of the queue in frames and bytes: two seconds of a 5 megapixel camera at 15 frames/s.
MAX_FRAMES = 32
MAX_BYTES = 512 * 2**20
#: Frames per batch: large enough to share flushes to the disk, small enough to free the queue soon.
_GROUP = 8
#: Readings of one patch that are replaced while they drift; what then remains is left to the check of the patch.
_MOST_REPLACED = 20
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
        # So that the queue does not fill on a busy computer. The thread that makes the hashes inherits it.
        raise_priority(threading.get_native_id())
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


class ReadingRecorder:
    """Takes the readings of a session's plan.

    Parameters
    ----------
    session : Session
        Open for writing.
    meter : Meter
        Open.
    operator : Operator
        Points the meter.
    report : callable
        Called after each reading.
    control : Control
        Polled between readings.
    bench : Announced or None
        Told which reading follows.
    """

    def __init__(
        self,
        session: Session,
        meter: Meter,
        operator: Operator,
        report: Report,
        control: Control,
        bench: Announced | None,
    ) -> None:
        self._session = session
        self._meter = meter
        self._operator = operator
        self._report = report
        self._control = control
        self._bench = bench
        self._begun = False
        self._incidents_noted = len(meter.incidents)

    def point_and_record(self, patch: str, wanted: int) -> bool:
        """Have the meter pointed and call `record`; returns whether readings were missing."""
        if self._recorded(patch) >= wanted:
            return False
        self._operator.point_meter(patch)
        self.record(patch, wanted)
        return True

    def record(self, patch: str, wanted: int) -> None:
        """Read until a patch has the requested number of readings.

        Raises
        ------
        MeterError
            If the meter was in another mode than the configuration's; that reading is not recorded.
        """
        total = sum(readings_wanted(self._session.configuration).values())
        done = total - sum(remaining(self._session).readings.values())
        lacking = wanted - self._recorded(patch)
        if lacking > 0 and not self._begun:
            self._begun = True
            self._report(Progress("meter readings", done, total))
        for _ in range(lacking):
            done += 1
            self._take(patch, done, total)
        # Readings that are typed, or of a file or a recording, are as many as they are.
        if lacking > 0 and getattr(self._meter, "live", True):
            self._settle(patch, done, total)

    def _take(self, patch: str, done: int, total: int) -> None:
        """Take one reading and record it."""
        self._control.checkpoint()
        self._announce(patch)
        try:
            reading = self._meter.measure()
        finally:
            self._note_incidents(patch)
        require_mode(reading, correction=self._session.configuration.meter.correction)
        self._session.add_reading(reading, patch)
        self._report(Progress("meter readings", done, total, reading=(patch, reading)))

    def _settle(self, patch: str, done: int, total: int) -> None:
        """While the readings still drift, let the oldest no longer count and take another; not for ever."""
        plan = self._session.configuration.plan
        for replaced in range(_MOST_REPLACED):
            series = [r for r in self._session.readings() if r.patch == patch][-plan.readings_per_patch :]
            drift_rel = settling_drift_rel([record.reading for record in series], plan.largest_drift_rel)
            if drift_rel is None:
                return
            if replaced == 0:
                note = f"The readings of patch {patch} still change by {drift_rel:+.1%}: waiting until they settle"
                self._report(Progress("meter readings", done, total, note=note))
            self._session.supersede(series[:1], f"the readings still changed by {drift_rel:+.2%}")
            self._take(patch, done, total)

    def _announce(self, patch: str) -> None:
        if self._bench is not None:
            # With those that no longer count: what is taken again has other noise.
            known = [r for r in self._session.records if isinstance(r, ReadingRecord) and r.patch == patch]
            self._bench.announce_reading(f"reading, {patch}", len(known))

    def _note_incidents(self, patch: str) -> None:
        for incident in self._meter.incidents[self._incidents_noted :]:
            self._incidents_noted += 1
            content = {"patch": patch, "reason": incident.reason, "duration_s": incident.duration_s}
            self._session.add_event(f"meter {incident.kind}", content | {"at": incident.at.isoformat()})

    def _recorded(self, patch: str) -> int:
        return sum(record.patch == patch for record in self._session.readings())
