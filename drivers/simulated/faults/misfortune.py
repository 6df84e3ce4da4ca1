"""Misfortune: applies faults to the devices of a simulated bench and ends them after their duration."""

from __future__ import annotations

import threading

from ....core.clock import Clock
from ..meter.meter import SimulatedLS
from ..meter.replies import Fault, FaultyMeter
from .commands import (
    CameraFault,
    Command,
    Drift,
    MeterRemote,
    MeterReplyFault,
    MeterUnit,
    MeterUnplug,
    Recover,
    Scheduled,
)
from .drift import Drifts
from .schedule import Timers
from .trouble import CameraTrouble, TroubledCamera

#: Update interval of the temperature register of a camera on the wire during a drift.
_FOLLOWED_EVERY_S = 1.0


class Misfortune:
    """Applies faults to registered devices.

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
        self._timers = Timers(clock)
        # Faults come from the timer thread and from the thread of user input.
        self._lock = threading.RLock()
        self._lasting: dict[str, CameraFault] = {}
        self._pulled: MeterUnplug | None = None
        self._cameras: list[TroubledCamera] = []
        self._meters: list[FaultyMeter] = []
        self._engines: list[SimulatedLS] = []

    def close(self) -> None:
        """Cancel all pending actions; may be called twice."""
        self._timers.close()

    def add_camera(self, camera: TroubledCamera) -> None:
        """Register a camera; active faults are applied to it."""
        with self._lock:
            self._cameras.append(camera)
            camera.set_faults(_trouble(self._lasting))

    def add_meter(self, meter: FaultyMeter, engine: SimulatedLS) -> None:
        """Register a meter for further faults."""
        with self._lock:
            self._meters.append(meter)
            self._engines.append(engine)

    def schedule(self, item: Scheduled) -> None:
        """Schedule a fault at its time from now."""
        self._timers.call_in(item.at_s, lambda: self.tell(item.command))

    def tell(self, command: Command) -> None:
        """Start a fault now.

        Raises
        ------
        CameraError
            If the fault cannot be applied.
        """
        with self._lock:
            match command:
                case CameraFault():
                    self._lasting = {**self._lasting, command.kind: command}
                    self._set_faults()
                    if command.duration_s is not None:
                        self._timers.call_in(command.duration_s, lambda: self._end(command))
                case Drift():
                    self._drifts.begin(command)
                    self._follow_until(self._clock.monotonic_s() + command.duration_s)
                case Recover():
                    self._lasting = {}
                    self._set_faults()
                    self._set_remote(True)
                    self._plug_in()
                    for meter in self._meters:
                        meter.recover()
                case MeterUnplug():
                    self._unplug(command)
                case MeterRemote():
                    self._set_remote(command.remote)
                case MeterUnit():
                    for engine in self._engines:
                        engine.unit = command.unit
                case MeterReplyFault():
                    fault = self._reply_fault(command)
                    for meter in self._meters:
                        meter.inject(fault)

    def _set_faults(self) -> None:
        for camera in self._cameras:
            camera.set_faults(_trouble(self._lasting))

    def _end(self, fault: CameraFault) -> None:
        """End a fault, unless another of its kind has replaced it."""
        with self._lock:
            if self._lasting.get(fault.kind) is fault:
                self._lasting = {kind: other for kind, other in self._lasting.items() if other is not fault}
                self._set_faults()

    def _follow_until(self, end_s: float) -> None:
        """Update the temperature registers now and every second until then."""
        for camera in self._cameras:
            camera.follow_temperature()
        if self._clock.monotonic_s() < end_s:
            self._timers.call_in(_FOLLOWED_EVERY_S, lambda: self._follow_until(end_s))

    def _set_remote(self, remote: bool) -> None:
        for engine in self._engines:
            engine.remote = remote

    def _unplug(self, command: MeterUnplug) -> None:
        self._pulled = command
        for meter in self._meters:
            meter.unplug()
        if command.duration_s is not None:
            self._timers.call_in(command.duration_s, lambda: self._plug_in(command))

    def _plug_in(self, pulled: MeterUnplug | None = None) -> None:
        """Reconnect the cable, unless it was pulled again since."""
        with self._lock:
            if pulled is None or self._pulled is pulled:
                for meter in self._meters:
                    meter.plug_in()

    def _reply_fault(self, command: MeterReplyFault) -> Fault:
        match command.kind:
            case "code":
                return Fault(reply=f"{command.code}\r\n".encode("ascii"))
            case "truncate":
                return Fault(n_bytes=command.n_bytes)
            case "delay":
                return Fault(delay_s=command.delay_s)
            case "garble":
                self._garbage_seed += 1
                return Fault.garbled(self._garbage_seed)


def _trouble(lasting: dict[str, CameraFault]) -> CameraTrouble:
    return CameraTrouble(
        loss=lasting["lose"].share if "lose" in lasting else 0.0,
        frozen="freeze" in lasting,
        stalled="stall" in lasting,
        gone="vanish" in lasting,
        wrong_ids="wrong ids" in lasting,
        wrong_size="wrong size" in lasting,
        taken="second controller" in lasting,
    )
