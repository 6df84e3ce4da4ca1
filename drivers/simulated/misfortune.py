"""Misfortune: lets faults befall the devices of a simulated bench, and ends them when their time is over."""

from __future__ import annotations

import threading

from ...clock import Clock
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
from .in_process_meter import InProcessMeter
from .meter import SimulatedLS
from .meter_pty import Fault, PtyMeter
from .schedule import Timers
from .trouble import CameraTrouble, TroubledCamera

#: How often the temperature register of a camera on the wire follows a drift.
_FOLLOWED_EVERY_S = 1.0


class Misfortune:
    """What goes wrong with the devices it is given.

    Parameters
    ----------
    clock : Clock
        Whose time faults take.
    drifts : Drifts
        Temperature and light.
    seed : int
        Of the garbage the meter sends.
    """

    def __init__(self, clock: Clock, drifts: Drifts, seed: int) -> None:
        self._clock = clock
        self._drifts = drifts
        self._garbage_seed = seed
        self._timers = Timers(clock)
        # The timers' thread and the one that types both tell faults.
        self._lock = threading.RLock()
        self._lasting: dict[str, CameraFault] = {}
        self._pulled: MeterUnplug | None = None
        self._cameras: list[TroubledCamera] = []
        self._meters: list[PtyMeter | InProcessMeter] = []
        self._engines: list[SimulatedLS] = []

    def close(self) -> None:
        """Forget what has not happened yet; may be called twice."""
        self._timers.close()

    def add_camera(self, camera: TroubledCamera) -> None:
        """Let the camera have its share, of what lasts now too."""
        with self._lock:
            self._cameras.append(camera)
            camera.suffer(_trouble(self._lasting))

    def add_meter(self, meter: PtyMeter | InProcessMeter, engine: SimulatedLS) -> None:
        """Let the meter have its share from now on."""
        with self._lock:
            self._meters.append(meter)
            self._engines.append(engine)

    def schedule(self, item: Scheduled) -> None:
        """Let a fault begin at its time from now."""
        self._timers.call_in(item.at_s, lambda: self.tell(item.command))

    def tell(self, command: Command) -> None:
        """Let a fault begin now.

        Raises
        ------
        CameraError
            If it cannot be brought about.
        """
        with self._lock:
            match command:
                case CameraFault():
                    self._lasting = {**self._lasting, command.kind: command}
                    self._suffer()
                    if command.duration_s is not None:
                        self._timers.call_in(command.duration_s, lambda: self._end(command))
                case Drift():
                    self._drifts.begin(command)
                    self._follow_until(self._clock.monotonic_s() + command.duration_s)
                case Recover():
                    self._lasting = {}
                    self._suffer()
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

    def _suffer(self) -> None:
        for camera in self._cameras:
            camera.suffer(_trouble(self._lasting))

    def _end(self, fault: CameraFault) -> None:
        """End a fault, unless another of its kind has taken its place."""
        with self._lock:
            if self._lasting.get(fault.kind) is fault:
                self._lasting = {kind: other for kind, other in self._lasting.items() if other is not fault}
                self._suffer()

    def _follow_until(self, end_s: float) -> None:
        """Let registers follow the temperature now and every second until then."""
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
        """Put the cable back, unless it was pulled again since."""
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
