"""Control and progress of a running acquisition, and the frames of one setting."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Any, Protocol, cast

from ..core.clock import Clock
from ..core.errors import LabcdpError, SessionError
from ..core.frame import Frame
from ..core.reading import Reading
from ..drivers.camera import Camera, IncompleteFrameError, Refused, take_again
from ..session import EventRecord, Session
from ..session.records import REFUSED, SIMULATED_BENCH
from .live import LiveStatistics


@dataclass(frozen=True)
class Progress:
    """State of a run.

    Parameters
    ----------
    step : str
        Current step, for the user.
    done, total : int
        Frames or readings of this kind, including those recorded earlier.
    live : LiveStatistics or None
        Statistics of the current exposure, after each frame.
    note : str or None
        Message to the user.
    reading : (str, Reading) or None
        Patch and reading, after each one.

    Examples
    --------
    >>> from labcdp.acquire import Progress
    >>> Progress("light frames", done=3, total=12).done
    3
    """

    step: str
    done: int
    total: int
    live: LiveStatistics | None = None
    note: str | None = None
    reading: tuple[str, Reading] | None = None


Report = Callable[[Progress], None]

#: How an acquisition ends that was stopped.
STOPPED = "the acquisition was stopped; recorded data are safe"


class AcquisitionStoppedError(LabcdpError):
    """The acquisition was stopped on request; data taken so far is recorded.

    Examples
    --------
    >>> from labcdp.acquire import AcquisitionStoppedError, Control
    >>> control = Control()
    >>> control.stop()
    >>> try:
    ...     control.checkpoint()
    ... except AcquisitionStoppedError:
    ...     print("stopped")
    stopped
    """


class Control:
    """Thread-safe pause and stop requests, polled by the acquisition between frames and readings.

    Examples
    --------
    >>> from labcdp.acquire import Control
    >>> control = Control()
    >>> control.pause()
    >>> control.paused, control.stopped
    (True, False)
    """

    def __init__(self) -> None:
        self._going = threading.Event()
        self._going.set()
        self._stopped = False

    def pause(self) -> None:
        """Pause after the current frame until `resume`."""
        self._going.clear()

    def resume(self) -> None:
        """Continue."""
        self._going.set()

    def stop(self) -> None:
        """Stop after the current frame, also while paused."""
        self._stopped = True
        self._going.set()

    @property
    def stopped(self) -> bool:
        """Whether a stop was requested."""
        return self._stopped

    @property
    def paused(self) -> bool:
        """Whether it is paused, or will be after the current frame."""
        return not self._going.is_set()

    @property
    def interrupts(self) -> bool:
        """Whether the acquisition must stop streaming now, to pause or to end."""
        return self._stopped or self.paused

    def checkpoint(self) -> None:
        """Wait while paused.

        Raises
        ------
        AcquisitionStoppedError
            If a stop is requested.
        """
        self._going.wait()
        if self._stopped:
            raise AcquisitionStoppedError(STOPPED)


#: Interval at which pause and stop are polled while waiting for the next frame of a schedule.
_NAP_S = 0.5


def noted(note: Callable[[str, dict[str, Any]], object], content: dict[str, Any]) -> Refused:
    """Return a function that records incomplete frames, which are taken again.

    Parameters
    ----------
    note : callable
        Records an event of a kind with its content.
    content : dict
        Content of the events in addition to the reason.
    """

    def refuse(error: IncompleteFrameError) -> None:
        refusal = {"reason": str(error), "status": error.status, "frame_id": error.frame_id}
        note(REFUSED, content | refusal)
        take_again(error)

    return refuse


class Schedule:
    """Start times of frames at a fixed interval, without accumulating delays.

    Parameters
    ----------
    interval_s : float
        From one start to the next.
    clock : Clock
        Clock to read and to wait with.
    control : Control
        Polled while waiting.
    """

    def __init__(self, interval_s: float, clock: Clock, control: Control) -> None:
        self._interval_s = interval_s
        self._clock = clock
        self._control = control
        self._next_s: float | None = None

    def wait(self) -> None:
        """Wait until the next frame is due; raises AcquisitionStoppedError."""
        self._control.checkpoint()
        now_s = self._clock.monotonic_s()
        due_s = now_s if self._next_s is None else self._next_s
        if now_s - due_s >= self._interval_s:
            # Frames missed during a pause or a lost connection are not caught up.
            due_s += ceil((now_s - due_s) / self._interval_s) * self._interval_s
        while now_s < due_s:
            self._clock.sleep(min(due_s - now_s, _NAP_S))
            self._control.checkpoint()
            now_s = self._clock.monotonic_s()
        self._next_s = due_s + self._interval_s


def take_frames(
    camera: Camera,
    n: int,
    schedule: Schedule | None,
    control: Control,
    on_refused: Refused,
    discard: int = 0,
    on_start: Callable[[int], None] = lambda _taken: None,
) -> Generator[Frame, None, None]:
    """Yield `n` complete frames, consecutive without a schedule.

    The stream is off during a pause: otherwise the buffers would overrun. The first `discard` frames after each start
    of the stream are dropped. `on_start` is told before each start how many frames were taken.

    Raises
    ------
    AcquisitionStoppedError
        If a stop is requested.
    DeviceError
        If the camera fails, or too many consecutive frames are incomplete.
    """
    left = n
    while left:
        if schedule is None:
            control.checkpoint()
        else:
            schedule.wait()
        on_start(n - left)
        stream = camera.grab(discard + (left if schedule is None else 1), on_refused=on_refused)
        # Iterators of drivers are generators: closing one stops its stream.
        with closing(cast(Generator[Frame, None, None], stream)) as frames:
            for taken, frame in enumerate(frames):
                if taken < discard:
                    continue
                left -= 1
                yield frame
                if control.interrupts:
                    break


class Announced(Protocol):
    """A simulated bench that is told what is recorded next.

    With that, an acquisition that was interrupted and resumed has the same noise as an uninterrupted one.

    Examples
    --------
    >>> from labcdp.acquire import Announced
    >>> class Quiet:
    ...     def announce_frames(self, series: str, first: int, n_before: int) -> None: ...
    ...     def announce_reading(self, series: str, number: int) -> None: ...
    >>> bench: Announced = Quiet()
    """

    def announce_frames(self, series: str, first: int, n_before: int) -> None:
        """Let the next frames be those of a series from number `first` on, after `n_before` that are dropped."""

    def announce_reading(self, series: str, number: int) -> None:
        """Let the next reading be the one with a number in a series."""


#: Records with which every session begins.
_OF_A_NEW_SESSION = ("session", "readme", SIMULATED_BENCH)


@contextmanager
def no_bare_session(path: Path) -> Iterator[None]:
    """Remove a session that failed before its first record, unless it was there before.

    Parameters
    ----------
    path : Path
        Folder of the session, which the block creates or resumes, and closes.
    """
    new = not holds_something(path)
    try:
        yield
    except LabcdpError:
        # Another process that has begun the session meanwhile holds it: it is that one's to remove.
        with suppress(SessionError):
            if new and holds_something(path):
                with Session.open(path, writable=True) as session:
                    if all(
                        isinstance(record, EventRecord) and record.kind in _OF_A_NEW_SESSION
                        for record in session.records
                    ):
                        session.remove()
        raise


def holds_something(path: Path) -> bool:
    """Whether there is anything at a path but an empty folder."""
    return path.exists() and not (path.is_dir() and not any(path.iterdir()))


@contextmanager
def warnings_to(tell: Callable[[str], None]) -> Iterator[None]:
    """Pass on warnings logged inside the block, such as a lost device; each kind of warning only once."""
    logged: set[str] = set()

    def emit(record: logging.LogRecord) -> None:
        if record.msg not in logged:
            logged.add(record.msg)
            tell(record.getMessage())

    handler = logging.Handler(logging.WARNING)
    handler.emit = emit  # type: ignore[method-assign]
    library = logging.getLogger("labcdp")
    library.addHandler(handler)
    try:
        yield
    finally:
        library.removeHandler(handler)
