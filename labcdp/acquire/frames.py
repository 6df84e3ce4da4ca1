"""Frames of one setting: in a row or on a schedule, with pauses, and those refused noted."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator
from contextlib import closing
from math import ceil
from typing import Any, cast

from ..clock import Clock
from ..drivers.camera import Camera, IncompleteFrameError
from ..frame import Frame
from .control import Control

_log = logging.getLogger(__name__)

#: So many incomplete frames in a row, and something is broken that patience does not mend.
MAX_REFUSED = 5
#: While waiting for the next frame of a schedule, whether to pause or end is looked at this often.
_NAP_S = 0.5


class Refusals:
    """Notes frames that came incomplete, and gives up after `MAX_REFUSED` in a row.

    Parameters
    ----------
    note : callable
        Records an event, given its kind and content.
    content : dict
        What their events say beside the reason.
    """

    def __init__(self, note: Callable[[str, dict[str, Any]], object], content: dict[str, Any]) -> None:
        self._note = note
        self._content = content
        self._in_a_row = 0

    def refuse(self, error: IncompleteFrameError) -> None:
        """Note a frame; raises the error once there were too many."""
        self._in_a_row += 1
        found = {"reason": str(error), "status": error.status, "frame_id": error.frame_id}
        self._note("refused frame", self._content | found)
        if self._in_a_row == MAX_REFUSED:
            raise error
        _log.warning("%s; taking it again", error)

    def whole(self) -> None:
        """Note that a frame came whole."""
        self._in_a_row = 0


class Schedule:
    """When frames are taken: each an interval after the one before, without adding up delays.

    Parameters
    ----------
    interval_s : float
        From one start to the next.
    clock : Clock
        Tells the time, and waits.
    control : Control
        Looked at while waiting.
    """

    def __init__(self, interval_s: float, clock: Clock, control: Control) -> None:
        self._interval_s = interval_s
        self._clock = clock
        self._control = control
        self._next_s: float | None = None

    def wait(self) -> None:
        """Return when the next frame is due; raises AcquisitionStoppedError."""
        self._control.checkpoint()
        now_s = self._clock.monotonic_s()
        due_s = now_s if self._next_s is None else self._next_s
        if now_s - due_s >= self._interval_s:
            # After a pause or a lost camera the frames that were missed are not made up for in a hurry.
            due_s += ceil((now_s - due_s) / self._interval_s) * self._interval_s
        while now_s < due_s:
            self._clock.sleep(min(due_s - now_s, _NAP_S))
            self._control.checkpoint()
            now_s = self._clock.monotonic_s()
        self._next_s = due_s + self._interval_s


def take_frames(
    camera: Camera, n: int, schedule: Schedule | None, control: Control, refusals: Refusals
) -> Generator[Frame, None, None]:
    """Take `n` whole frames; in a row without a schedule.

    While the acquisition is paused the stream is off: a camera that keeps sending would overrun its buffers.

    Raises
    ------
    AcquisitionStoppedError
        If the acquisition is to end.
    DeviceError
        If the camera fails, or too many frames in a row come incomplete.
    """
    left = n
    while left:
        if schedule is None:
            control.checkpoint()
        else:
            schedule.wait()
        stream = camera.grab(left if schedule is None else 1, on_refused=refusals.refuse)
        # Iterators of drivers are generators: closing one ends its stream.
        with closing(cast(Generator[Frame, None, None], stream)) as frames:
            for frame in frames:
                refusals.whole()
                left -= 1
                yield frame
                if control.interrupts:
                    break
