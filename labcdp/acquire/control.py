"""Control: pause, go on and stop a running acquisition from another thread."""

from __future__ import annotations

import threading

from ..errors import LabcdpError


class AcquisitionStoppedError(LabcdpError):
    """Somebody asked the acquisition to end; what was taken is recorded."""


class Control:
    """Asked by the acquisition between frames and readings; set by anyone, from any thread."""

    def __init__(self) -> None:
        self._going = threading.Event()
        self._going.set()
        self._stopped = False

    def pause(self) -> None:
        """Take nothing more after the current frame, until `resume`."""
        self._going.clear()

    def resume(self) -> None:
        """Go on."""
        self._going.set()

    def stop(self) -> None:
        """End after the current frame, also if it is paused."""
        self._stopped = True
        self._going.set()

    @property
    def paused(self) -> bool:
        """Whether it waits, or will after the current frame."""
        return not self._going.is_set()

    @property
    def interrupts(self) -> bool:
        """Whether the acquisition has to leave the stream of frames at once, to wait or to end."""
        return self._stopped or self.paused

    def checkpoint(self) -> None:
        """Wait while paused.

        Raises
        ------
        AcquisitionStoppedError
            If it is to end.
        """
        self._going.wait()
        if self._stopped:
            raise AcquisitionStoppedError("the acquisition was stopped; what was recorded is safe")
