"""Control and progress of a running acquisition, and the frames of one setting."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from math import ceil
from typing import Any, Literal, Protocol, cast

from ..core.clock import Clock
from ..core.errors import DeviceError, LabcdpError
from ..core.frame import Frame
from ..core.reading import Reading
from ..drivers.camera import Camera, IncompleteFrameError, Refused
from .checks import CheckFinding
from .live import Live


@dataclass(frozen=True)
class Progress:
    """State of a run.

    Parameters
    ----------
    step : str
        Current step, for the user.
    done, total : int
        Frames or readings of this kind, including those recorded earlier.
    live : Live or None
        Statistics of the current exposure, after each frame.
    note : str or None
        Message to the user.
    reading : (str, Reading) or None
        Patch and reading, after each one.
    """

    step: str
    done: int
    total: int
    live: Live | None = None
    note: str | None = None
    reading: tuple[str, Reading] | None = None


Report = Callable[[Progress], None]


class AcquisitionStoppedError(LabcdpError):
    """The acquisition was stopped on request; data taken so far is recorded."""


class Control:
    """Thread-safe pause and stop requests, polled by the acquisition between frames and readings."""

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
            raise AcquisitionStoppedError("the acquisition was stopped; recorded data are safe")


_log = logging.getLogger(__name__)

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
        found = {"reason": str(error), "status": error.status, "frame_id": error.frame_id}
        note("refused frame", content | found)
        _log.warning("%s; taking it again", error)

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
    camera: Camera, n: int, schedule: Schedule | None, control: Control, on_refused: Refused, discard: int = 0
) -> Generator[Frame, None, None]:
    """Yield `n` complete frames, consecutive without a schedule.

    The stream is off during a pause: otherwise the buffers would overrun. The first `discard` frames after each start
    of the stream are dropped.

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


class Operator(Protocol):
    """Performs manual steps; each method returns when its step is done."""

    def cover_lens(self) -> None:
        """Cover the lens."""

    def uncover_lens(self) -> None:
        """Uncover the lens."""

    def point_meter(self, patch: str) -> None:
        """Point the luminance meter at the centre of a patch."""

    def show_patch(self, patch: str) -> None:
        """Place a patch in front of camera and meter, where patches are shown one by one."""

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Decide whether to repeat a unit because of its problems."""


class AskedOperator:
    """A person who is asked for each manual step; `request` and `repeat` say how.

    Parameters
    ----------
    hands : Operator or None
        The simulated bench, which then does what the person confirmed.
    """

    def __init__(self, hands: Operator | None = None) -> None:
        self._hands = hands

    def request(self, step: str, patch: str = "") -> None:
        """Ask for a step, which is about a patch or none, and return when it is done."""
        raise NotImplementedError

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Ask whether to repeat a unit."""
        raise NotImplementedError

    def cover_lens(self) -> None:
        """Ask for the cap."""
        self.request("Cover the lens")
        if self._hands is not None:
            self._hands.cover_lens()

    def uncover_lens(self) -> None:
        """Ask for a free lens."""
        self.request("Uncover the lens and light the target")
        if self._hands is not None:
            self._hands.uncover_lens()

    def point_meter(self, patch: str) -> None:
        """Ask for the meter to be pointed."""
        self.request(f"Point the luminance meter at the centre of patch {patch}", patch)
        if self._hands is not None:
            self._hands.point_meter(patch)

    def show_patch(self, patch: str) -> None:
        """Ask for the next patch."""
        self.request(f"Place patch {patch} in front of camera and luminance meter", patch)
        if self._hands is not None:
            self._hands.show_patch(patch)


class HandNeededError(DeviceError):
    """A manual step is required, but no operator is present."""


class Unattended:
    """Unattended bench: manual steps are refused, so that an acquisition skips them.

    Parameters
    ----------
    lens : {'uncovered', 'covered'}
        State of the lens cap.
    """

    def __init__(self, lens: Literal["uncovered", "covered"] = "uncovered") -> None:
        self._lens = lens
        self._repeated: set[str] = set()

    def cover_lens(self) -> None:
        """Refuse, unless the cap is on the lens."""
        if self._lens != "covered":
            raise HandNeededError("cover the lens")

    def uncover_lens(self) -> None:
        """Refuse, unless the lens is free."""
        if self._lens != "uncovered":
            raise HandNeededError("uncover the lens and light the target")

    def point_meter(self, patch: str) -> None:
        """Refuse."""
        raise HandNeededError("point the luminance meter at each patch")

    def show_patch(self, patch: str) -> None:
        """Refuse."""
        raise HandNeededError("put each patch before camera and meter")

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Repeat a unit once if that may solve the problem without a manual step."""
        again = what not in self._repeated and any(finding.passing for finding in findings)
        self._repeated.add(what)
        return again


class LensCap:
    """State of the lens cap, which an operator moves.

    Parameters
    ----------
    operator : Operator
        Moves the cap.
    """

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._is: Literal["unknown", "on", "off"] = "unknown"

    def on(self) -> None:
        """Ensure that the lens is covered; raises HandNeededError."""
        if self._is != "on":
            self._operator.cover_lens()
            self._is = "on"

    def off(self) -> None:
        """Ensure that the lens is uncovered; raises HandNeededError."""
        if self._is != "off":
            self._operator.uncover_lens()
            self._is = "off"

    def leave_off(self) -> None:
        """Remove the cap at the end if it was put on and an operator is present."""
        if self._is == "on":
            with suppress(HandNeededError):
                self.off()
