"""Trouble of a simulated camera, and the connection to a camera in this process: its loss and recovery."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from ...core.clock import Clock
from ...core.errors import InputError
from ..camera import CameraBusyError, CameraLostError, CameraNotFoundError, Gap


@dataclass(frozen=True)
class CameraTrouble:
    """Faults of a camera; none without arguments.

    Parameters
    ----------
    loss : float
        Share of the stream's packets that are lost, 0 to 1.
    frozen : bool
        It neither answers nor sends, and continues normally afterwards.
    stalled : bool
        It answers, but sends no frame.
    gone : bool
        It has no power; afterwards all settings are those after power-on.
    wrong_ids : bool
        It repeats frame ids, or sends older ones.
    wrong_size : bool
        Its frames have half the height.
    taken : bool
        Another program controls it, after a power cycle.

    Raises
    ------
    InputError
        If `loss` is not between 0 and 1.
    """

    loss: float = 0.0
    frozen: bool = False
    stalled: bool = False
    gone: bool = False
    wrong_ids: bool = False
    wrong_size: bool = False
    taken: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.loss <= 1:
            raise InputError(f"loss is {self.loss}: give a share from 0 to 1")

    @property
    def out_of_reach(self) -> bool:
        """Whether the connection to the camera is lost."""
        return self.frozen or self.gone or self.taken


#: No fault.
NO_TROUBLE = CameraTrouble()


class TroubledCamera(Protocol):
    """A simulated camera that supports faults."""

    def set_faults(self, trouble: CameraTrouble) -> None:
        """Replace the current trouble."""

    def follow_temperature(self) -> None:
        """Update the temperature registers."""


#: Silence after which a camera is lost.
_NOTICED_AFTER_S: Final = 1.0

#: Heartbeat time-out after which a camera drops the connection, as on the wire.
_HEARTBEAT_S: Final = 3.0

#: Polling interval of the trouble's end.
STEP_S: Final = 0.1


class Link:
    """Connection to a simulated camera.

    Parameters
    ----------
    clock : Clock
        Clock to wait with.
    patience_s : float
        How long to wait for a lost camera to come back; 0 for not at all.
    name : str
        Name of the camera in messages.

    Attributes
    ----------
    trouble : CameraTrouble
        Current trouble.
    cut : str or None
        Why the connection is lost, or None.
    gaps : tuple of Gap
        Interruptions since `connect`.

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
        self._name = name
        self._frozen_at_s = 0.0
        self.trouble = NO_TROUBLE
        self.cut: str | None = None
        self.gaps: tuple[Gap, ...] = ()

    def connect(self) -> None:
        """Connect anew; raises CameraNotFoundError or CameraBusyError as the trouble implies."""
        if self.trouble.gone or self.trouble.frozen:
            raise CameraNotFoundError(f"{self._name} does not answer: let the simulated camera recover")
        if self.trouble.taken:
            raise CameraBusyError(f"another program controls {self._name}: let the simulated camera recover")
        self.cut, self.gaps = None, ()

    def set_faults(self, trouble: CameraTrouble) -> None:
        """Replace the current trouble."""
        if trouble.frozen != self.trouble.frozen:
            now_s = self._clock.monotonic_s()
            if not trouble.frozen and now_s - self._frozen_at_s >= _HEARTBEAT_S:
                self.cut = "it did not answer"
            self._frozen_at_s = now_s
        self.trouble = trouble
        # Loss of power or control ends the connection, however short.
        if trouble.gone:
            self.cut = "it does not answer"
        elif trouble.taken:
            self.cut = "another program took control"

    def await_reconnect(self) -> None:
        """Wait until a lost camera is back; raises CameraLostError after `patience_s`."""
        began_s, lost_at = self._clock.monotonic_s(), self._clock.now()
        self._wait_while(lambda: self.trouble.frozen, _NOTICED_AFTER_S)
        reason = self.cut or ("it does not answer" if self.trouble.frozen else None)
        if reason is None:
            return
        self.cut = reason
        if self._patience_s > 0:
            self._wait_while(lambda: self.trouble.out_of_reach, self._patience_s)
        if self._patience_s == 0 or self.trouble.out_of_reach:
            raise CameraLostError(
                f"{self._name} is lost, {reason}: let the simulated camera recover, then open it again"
            )
        self.cut = None
        duration_s = self._clock.monotonic_s() - began_s
        self.gaps = (*self.gaps, Gap(lost_at, self._clock.now(), duration_s, reason))

    def _wait_while(self, bad: Callable[[], bool], longest_s: float) -> None:
        until_s = self._clock.monotonic_s() + longest_s
        # In whole steps: a rest of rounding would not advance a virtual clock.
        while bad() and self._clock.monotonic_s() < until_s:
            self._clock.sleep(STEP_S)
