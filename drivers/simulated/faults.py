"""Faults and drifts of a simulated bench, applied to its devices, and ended after their duration."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from math import prod
from typing import Final, Literal, Protocol

from ...core.clock import Clock, SimulatedClock
from ...core.errors import InputError
from ..camera import CameraLostError, CameraNotFoundError, Gap
from .commands import CAMERA_FAULTS, CameraFaults, Command
from .port import Fault, FaultyMeter

_log = logging.getLogger(__name__)


class Drifts:
    """Temperature and light as they change with a clock.

    Parameters
    ----------
    clock : Clock
        Clock of the drifts.
    temperature_c : float
        Temperature at the beginning, in degrees Celsius.
    """

    def __init__(self, clock: Clock, temperature_c: float) -> None:
        self._clock = clock
        self._temperature_c = temperature_c
        #: Drifts and when they began on the clock.
        self.begun: tuple[tuple[Command, float], ...] = ()

    def begin(self, drift: Command) -> None:
        """Start a drift now, in addition to existing ones."""
        self.begun = (*self.begun, (drift, self._clock.monotonic_s()))

    def temperature_c(self) -> float:
        """Temperature now, in degrees Celsius."""
        return self._temperature_c + sum(self._changes("temperature"))

    def light_rel(self) -> float:
        """Return the current light, relative to that at the start."""
        return prod((1 + change for change in self._changes("light")), start=1.0)

    def _changes(self, quantity: Literal["temperature", "light"]) -> list[float]:
        now_s = self._clock.monotonic_s()
        return [
            float(drift.value) * (min(1.0, max(0.0, (now_s - at_s) / drift.duration_s)) if drift.duration_s else 1.0)
            for drift, at_s in self.begun
            if drift.kind == quantity
        ]


class FaultyCamera(Protocol):
    """A simulated camera that supports faults."""

    def set_faults(self, faults: CameraFaults) -> None:
        """Replace the current faults."""

    def follow_temperature(self) -> None:
        """Update the temperature registers."""


class Misfortune:
    """Applies faults to registered devices, and ends them after their duration.

    On a `SimulatedClock` what is due runs inside the `sleep` that passes its time, on another clock in a thread of its
    own, which ends with `close` at the latest.

    Parameters
    ----------
    clock : Clock
        Clock of the faults.
    drifts : Drifts
        Temperature and light.
    seed : int
        Random seed of the meter's invalid replies.
    """

    def __init__(self, clock: Clock, drifts: Drifts, seed: int) -> None:
        self._clock = clock
        self._drifts = drifts
        self._garbage_seed = seed
        # Faults come from timers and from the thread of user input.
        self._lock = threading.RLock()
        self._timers: list[threading.Timer] = []
        self._closed = False
        self._lasting: dict[str, Command] = {}
        self._cameras: list[FaultyCamera] = []
        self._meters: list[FaultyMeter] = []

    def close(self) -> None:
        """Cancel what is pending; may be called twice."""
        self._closed = True
        for timer in self._timers:
            timer.cancel()
            if timer is not threading.current_thread():
                timer.join()

    def add_camera(self, camera: FaultyCamera) -> None:
        """Register a camera; active faults are applied to it."""
        with self._lock:
            self._cameras.append(camera)
            self._set_faults()

    def add_meter(self, meter: FaultyMeter) -> None:
        """Register a meter for further faults."""
        with self._lock:
            self._meters.append(meter)

    def schedule(self, command: Command) -> None:
        """Schedule a fault at its time from now."""
        self._call_in(command.at_s, lambda: self.begin(command))

    def _call_in(self, delay_s: float, action: Callable[[], None]) -> None:
        """Run an action after a number of seconds, unless closed before; its exceptions are logged."""

        def run() -> None:
            try:
                if not self._closed:
                    action()
            except Exception:
                _log.exception("a fault of the simulated bench could not be triggered")

        if delay_s <= 0:
            run()
        elif isinstance(self._clock, SimulatedClock):
            self._clock.call_at(self._clock.monotonic_s() + delay_s, run)
        elif not self._closed:
            timer = threading.Timer(delay_s, run)
            timer.daemon = True
            self._timers = [*(running for running in self._timers if running.is_alive()), timer]
            timer.start()

    def begin(self, command: Command) -> None:
        """Start a fault now.

        Raises
        ------
        CameraError
            If the fault cannot be applied.
        """
        kind, value = command.kind, command.value
        with self._lock:
            if kind in ("temperature", "light"):
                self._drifts.begin(command)
                self._follow_until(self._clock.monotonic_s() + (command.duration_s or 0.0))
            elif kind in CAMERA_FAULTS or kind == "meter unplug":
                self._lasting = {**self._lasting, kind: command}
                self._set_faults()
                if command.duration_s is not None:
                    self._call_in(command.duration_s, lambda: self._end(command))
            elif kind == "recover":
                self._lasting = {}
                self._set_faults()
            for meter in self._meters:
                if kind == "recover":
                    meter.recover()
                elif kind in ("meter drop", "meter remote"):
                    meter.engine.remote = kind == "meter remote"
                elif kind == "meter unit":
                    meter.engine.unit = "fL" if value == "fL" else "cd/m2"
                elif kind.startswith("meter") and kind != "meter unplug":
                    meter.inject(self._reply_fault(command))

    def _set_faults(self) -> None:
        faults = {kind: float(command.value) for kind, command in self._lasting.items()}
        for camera in self._cameras:
            camera.set_faults(faults)
        for meter in self._meters:
            (meter.unplug if "meter unplug" in faults else meter.plug_in)()

    def _end(self, fault: Command) -> None:
        """End a fault, unless another of its kind has replaced it."""
        with self._lock:
            if self._lasting.get(fault.kind) is fault:
                self._lasting = {kind: other for kind, other in self._lasting.items() if other is not fault}
                self._set_faults()

    def _follow_until(self, end_s: float) -> None:
        """Update the temperature registers of cameras now and every second until then."""
        for camera in self._cameras:
            camera.follow_temperature()
        if self._clock.monotonic_s() < end_s:
            self._call_in(1.0, lambda: self._follow_until(end_s))

    def _reply_fault(self, command: Command) -> Fault:
        match command.kind:
            case "meter truncate":
                return Fault(n_bytes=int(command.value))
            case "meter delay":
                return Fault(delay_s=command.duration_s or 0.0)
            case "meter garble":
                self._garbage_seed += 1
                return Fault.garbled(self._garbage_seed)
        return Fault(reply=f"{command.value}\r\n".encode("ascii"))


#: Silence after which a camera is lost, and heartbeat time-out after which it drops the connection, as on the wire.
_NOTICED_AFTER_S: Final = 1.0
_HEARTBEAT_S: Final = 3.0
#: Polling interval of a fault's end.
STEP_S: Final = 0.1
#: Faults during which the camera cannot be reached, and what is wrong then.
_OUT_OF_REACH: Final = {
    "vanish": "it does not answer",
    "freeze": "it does not answer",
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
        self.patience_s = patience_s
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

    def be_patient(self, patience_s: float) -> None:
        """Wait this long for the camera when it is lost; 0 also ends a wait."""
        self.patience_s = patience_s

    def _connect(self) -> None:
        """Connect anew; raises CameraNotFoundError if the faults imply so."""
        if "vanish" in self._faults or "freeze" in self._faults:
            raise CameraNotFoundError(f"{self._called} does not answer", "let the simulated camera recover")
        self._cut, self._gaps = "", ()

    def set_faults(self, faults: CameraFaults) -> None:
        """Replace the current faults."""
        now_s, before, self._faults = self._clock.monotonic_s(), self._faults, faults
        if "freeze" in faults and "freeze" not in before:
            self._frozen_at_s = now_s
        if "freeze" in before and "freeze" not in faults and now_s - self._frozen_at_s >= _HEARTBEAT_S:
            self._cut = "it did not answer"
        # Loss of power ends the connection, however short.
        if "vanish" in faults:
            self._cut = _OUT_OF_REACH["vanish"]

    def _await_reconnect(self) -> None:
        """Wait until a lost camera is back; raises CameraLostError after the patience."""
        began_s, lost_at = self._clock.monotonic_s(), self._clock.now()
        self._wait_while(lambda: "freeze" in self._faults, _NOTICED_AFTER_S)
        reason = self._cut or (_OUT_OF_REACH["freeze"] if "freeze" in self._faults else "")
        if not reason:
            return
        self._cut = reason
        self._wait_while(lambda: self._out_of_reach() and self.patience_s > 0, self.patience_s)
        if self.patience_s == 0 or self._out_of_reach():
            raise CameraLostError(
                f"{self._called} is lost, {reason}", "let the simulated camera recover, then open it again"
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
