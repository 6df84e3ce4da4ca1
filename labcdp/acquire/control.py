"""Control: pause, continue and stop a running acquisition from another thread."""

from __future__ import annotations

import threading

from ..core.errors import LabcdpError


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
