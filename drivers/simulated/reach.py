"""Whether a simulated camera in this process can be reached: faults that cut it off, and its recovery."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from ...core.clock import Clock
from ...core.errors import InputError
from ..camera import CameraBusyError, CameraLostError, CameraNotFoundError, Gap
from .commands import CameraFaults

#: Silence after which a camera is lost, and heartbeat time-out after which it drops the connection, as on the wire.
_NOTICED_AFTER_S: Final = 1.0
_HEARTBEAT_S: Final = 3.0
#: Polling interval of a fault's end.
STEP_S: Final = 0.1
#: Faults during which the camera cannot be reached, and what is wrong then.
_OUT_OF_REACH: Final = {
    "vanish": "it does not answer",
    "freeze": "it does not answer",
    "second controller": "another program took control",
}


class Reach:
    """The connection to a camera that has faults.

    Parameters
    ----------
    clock : Clock
        Clock to wait with.
    patience_s : float
        How long to wait for a lost camera to come back; 0 for not at all.
    name : str
        Name of the camera in messages.

    Raises
    ------
    InputError
        If `patience_s` is negative.
    """

    def __init__(self, clock: Clock, patience_s: float, name: str) -> None:
        if not patience_s >= 0:
            raise InputError(f"patience_s is {patience_s}: give a number of seconds of at least 0")
        self._clock = clock
        self._patience_s = patience_s
        self._called = name
        self._faults: CameraFaults = {}
        self._frozen_at_s = 0.0
        # Why the connection is lost, until the camera is connected again.
        self._cut = ""
        self._gaps: tuple[Gap, ...] = ()

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Interruptions since the camera was opened, after which it was reconnected."""
        return self._gaps

    def _connect(self) -> None:
        """Connect anew; raises CameraNotFoundError or CameraBusyError if the faults imply so."""
        if "vanish" in self._faults or "freeze" in self._faults:
            raise CameraNotFoundError(f"{self._called} does not answer: let the simulated camera recover")
        if "second controller" in self._faults:
            raise CameraBusyError(f"another program controls {self._called}: let the simulated camera recover")
        self._cut, self._gaps = "", ()

    def set_faults(self, faults: CameraFaults) -> None:
        """Replace the current faults."""
        now_s, before, self._faults = self._clock.monotonic_s(), self._faults, faults
        if "freeze" in faults and "freeze" not in before:
            self._frozen_at_s = now_s
        if "freeze" in before and "freeze" not in faults and now_s - self._frozen_at_s >= _HEARTBEAT_S:
            self._cut = "it did not answer"
        # Loss of power or control ends the connection, however short.
        for kind in ("vanish", "second controller"):
            if kind in faults:
                self._cut = _OUT_OF_REACH[kind]

    def _await_reconnect(self) -> None:
        """Wait until a lost camera is back; raises CameraLostError after the patience."""
        began_s, lost_at = self._clock.monotonic_s(), self._clock.now()
        self._wait_while(lambda: "freeze" in self._faults, _NOTICED_AFTER_S)
        reason = self._cut or (_OUT_OF_REACH["freeze"] if "freeze" in self._faults else "")
        if not reason:
            return
        self._cut = reason
        self._wait_while(self._out_of_reach, self._patience_s)
        if self._patience_s == 0 or self._out_of_reach():
            raise CameraLostError(
                f"{self._called} is lost, {reason}: let the simulated camera recover, then open it again"
            )
        self._cut = ""
        gap = Gap(lost_at, self._clock.now(), self._clock.monotonic_s() - began_s, reason)
        self._gaps = (*self._gaps, gap)

    def _out_of_reach(self) -> bool:
        return not _OUT_OF_REACH.keys().isdisjoint(self._faults)

    def _wait_while(self, bad: Callable[[], bool], longest_s: float) -> None:
        until_s = self._clock.monotonic_s() + longest_s
        # In whole steps: a rest of rounding would not advance a virtual clock.
        while bad() and self._clock.monotonic_s() < until_s:
            self._clock.sleep(STEP_S)
