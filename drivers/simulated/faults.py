"""Fault commands of the simulated bench, for schedules and typed commands."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Final, Literal

from ...core.clock import Clock, SimulatedClock
from ...core.disk.files import MOST_QUOTED, quoted
from ...core.errors import ConfigurationError
from .in_process import CameraTrouble, TroubledCamera
from .meter import Fault, FaultyMeter, SimulatedLS


@dataclass(frozen=True)
class Command:
    """One fault, or the end of all.

    Parameters
    ----------
    kind : str
        First words of the command: a fault of the camera (see `CameraTrouble`), ``temperature``, ``light``, ``meter``
        with what happens to it, or ``recover``.
    value : float or str
        Share of lost packets; change in degrees Celsius, or of the current light as a fraction; bytes of a truncated
        reply; seconds of delay; error code or unit of the meter.
    duration_s : float or None
        How long it lasts, None until ``recover``; for a drift the time of the change, None for a step.
    """

    kind: str
    value: float | str = 0.0
    duration_s: float | None = None

    @property
    def number(self) -> float:
        """The value as a number."""
        return float(self.value)


@dataclass(frozen=True)
class Scheduled:
    """A command with its time.

    Parameters
    ----------
    at_s : float
        Seconds from the start of the schedule.
    command : Command
        The command.
    """

    at_s: float
    command: Command


_SECONDS: Final = {"ms": 0.001, "s": 1.0, "min": 60.0, "h": 3600.0}
_NUMBER: Final = r"[0-9]{1,9}(?:\.[0-9]{1,12})?"
_TIME: Final = rf"(?P<time>{_NUMBER}) ?(?P<time_unit>ms|s|min|h)"
_LASTS: Final = rf"(?: for {_TIME})?"
_WITHIN: Final = rf"(?: in {_TIME})?"

#: The register of the temperature reaches from -40 to 125 degrees Celsius.
_LARGEST_CHANGE_C: Final = 80

#: The error codes of the meter's manual.
METER_CODES: Final = ("ER00", "ER01", "ER10", "ER11", "ER19", "ER20", "ER30")


def _share(text: str) -> float:
    if float(text) > 100:
        raise ValueError(f"{float(text):g}% is more than all packets")
    return float(text) / 100


def _light(text: str) -> float:
    if float(text) < -100:
        raise ValueError(f"{float(text):g}% leaves no light")
    return float(text) / 100


def _change_c(text: str) -> float:
    if abs(float(text)) > _LARGEST_CHANGE_C:
        raise ValueError(f"{float(text):g} C is out of range (at most {_LARGEST_CHANGE_C} C)")
    return float(text)


#: Kind of a command, the pattern of what follows it, how its value is read, and an example.
_RULES: Final[tuple[tuple[str, str, Callable[[str], float | str], str], ...]] = (
    ("lose", rf" (?P<value>{_NUMBER}) ?%{_LASTS}", _share, "lose 5% for 20 s"),
    *((kind, _LASTS, float, f"{kind} for 3 s") for kind in ("freeze", "stall")),
    ("vanish", _LASTS, float, "vanish for 5 s"),
    *((kind, _LASTS, float, f"{kind} for 2 s") for kind in ("wrong ids", "wrong size")),
    ("second controller", _LASTS, float, "second controller for 4 s"),
    ("temperature", rf" (?P<value>[+-]{_NUMBER}) ?c{_WITHIN}", _change_c, "temperature +8 C in 10 min"),
    ("light", rf" (?P<value>[+-]{_NUMBER}) ?%{_WITHIN}", _light, "light -5% in 1 h"),
    ("meter", rf" (?P<value>{'|'.join(METER_CODES).lower()})", str.upper, "meter ER10"),
    ("meter truncate", " (?P<value>[0-9]{1,2})", int, "meter truncate 7"),
    ("meter delay", f" {_TIME}", float, "meter delay 3 s"),
    ("meter garble", "", float, "meter garble"),
    ("meter unit", " (?P<value>fl|cd/m2)", lambda text: "fL" if text == "fl" else text, "meter unit fL"),
    *((kind, "", float, kind) for kind in ("meter drop", "meter remote")),
    ("meter unplug", _LASTS, float, "meter unplug for 2 s"),
    ("recover", "", float, "recover"),
)

#: An example of each command.
EXAMPLES: Final = tuple(example for *_, example in _RULES)

_AT: Final = re.compile(rf"at {_TIME} (?P<command>.*)")


def parse_command(text: str) -> Command:
    """Parse one command, for example ``lose 5% for 20 s``; case and blanks are ignored.

    Raises
    ------
    ConfigurationError
        If it is invalid; the message gives an example of the closest command.
    """
    words = " ".join(text.lower().split())
    for kind, pattern, value, example in _RULES:
        if match := re.fullmatch(kind + pattern, words, re.ASCII):
            found = match.groupdict()
            try:
                return Command(kind, value(found.get("value") or "0"), _seconds(match))
            except ValueError as error:
                raise ConfigurationError(f"{quoted(text.strip())}: {error}: write for example {example!r}") from None
    raise ConfigurationError(f"{quoted(text.strip())} is not a known fault: write for example {_nearest(words)!r}")


def parse_schedule(text: str, source: str = "schedule") -> tuple[Scheduled, ...]:
    """Parse a schedule: lines such as ``at 1 min vanish for 5 s``, in any order; ``#`` starts a comment.

    Parameters
    ----------
    text : str
        The lines; one without ``at`` runs immediately.
    source : str
        Name of the schedule in messages.

    Returns
    -------
    tuple of Scheduled
        By time.

    Raises
    ------
    ConfigurationError
        If a line is invalid, with its number and a valid example.
    """
    scheduled = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = " ".join(line.partition("#")[0].split())
        if not words:
            continue
        try:
            scheduled.append(_scheduled(words))
        except ConfigurationError as error:
            raise ConfigurationError(f"{source}, line {number}: {error}") from None
    return tuple(sorted(scheduled, key=lambda item: item.at_s))


def _scheduled(words: str) -> Scheduled:
    timed = words.lower().startswith("at ")
    if not timed:
        return Scheduled(0.0, parse_command(words))
    match = _AT.fullmatch(words.lower())
    if match is None:
        raise ConfigurationError(
            f"{quoted(words)} has no time after 'at': write for example 'at 10 s lose 5% for 20 s'"
        )
    return Scheduled(_seconds(match) or 0.0, parse_command(match["command"]))


def _seconds(match: re.Match[str]) -> float | None:
    found = match.groupdict()
    return None if found.get("time") is None else float(found["time"]) * _SECONDS[found["time_unit"]]


def _nearest(words: str) -> str:
    """Return the example most similar to a text."""
    lowered = {example.lower(): example for example in EXAMPLES}
    same_word = [example for example in lowered if words and example.split()[0] == words.split()[0]]
    close = get_close_matches(words[:MOST_QUOTED], same_word or list(lowered), n=1, cutoff=0.0)
    return lowered[close[0]]


@dataclass(frozen=True)
class _Begun:
    """A drift and its start time on the clock."""

    drift: Command
    at_s: float

    def change(self, now_s: float) -> float:
        """Return the current amount of the change."""
        duration_s = self.drift.duration_s or 0.0
        return self.drift.number * (1.0 if duration_s == 0 else min(1.0, max(0.0, (now_s - self.at_s) / duration_s)))


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
        self._begun: tuple[_Begun, ...] = ()

    def begin(self, drift: Command) -> None:
        """Start a drift now, in addition to existing ones."""
        self._begun = (*self._begun, _Begun(drift, self._clock.monotonic_s()))

    @property
    def begun(self) -> bool:
        """Whether there are any drifts."""
        return bool(self._begun)

    def temperature_c(self) -> float:
        """Temperature now, in degrees Celsius."""
        return self._temperature_c + sum(self._changes("temperature"))

    def light_rel(self) -> float:
        """Return the current light, relative to that at the start."""
        light = 1.0
        for change in self._changes("light"):
            light *= 1 + change
        return light

    def _changes(self, quantity: Literal["temperature", "light"]) -> list[float]:
        now_s = self._clock.monotonic_s()
        return [begun.change(now_s) for begun in self._begun if begun.drift.kind == quantity]


_log = logging.getLogger(__name__)

Action = Callable[[], None]


class Timers:
    """Actions at given times of a clock.

    On a `SimulatedClock` an action runs inside the `sleep` that passes its time, on another clock in a thread of its
    own, which ends with `close` at the latest. One that is due runs at once.

    Parameters
    ----------
    clock : Clock
        Clock of the actions.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: list[threading.Timer] = []
        self._closed = False

    def call_in(self, delay_s: float, action: Action) -> None:
        """Run an action after a number of seconds, unless closed before; its exceptions are logged."""
        if delay_s <= 0:
            self._do(action)
        elif isinstance(self._clock, SimulatedClock):
            self._clock.call_at(self._clock.monotonic_s() + delay_s, lambda: self._do(action))
        elif not self._closed:
            timer = threading.Timer(delay_s, self._do, [action])
            timer.daemon = True
            self._waiting = [*(one for one in self._waiting if one.is_alive()), timer]
            timer.start()

    def close(self) -> None:
        """Cancel all pending actions; may be called twice."""
        self._closed = True
        for timer in self._waiting:
            timer.cancel()
            if timer is not threading.current_thread():
                timer.join()

    def _do(self, action: Action) -> None:
        if self._closed:
            return
        try:
            action()
        except Exception:
            _log.exception("a fault of the simulated bench could not be triggered")


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
        self._lasting: dict[str, Command] = {}
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
        kind = command.kind
        with self._lock:
            if kind in ("temperature", "light"):
                self._drifts.begin(command)
                self._follow_until(self._clock.monotonic_s() + (command.duration_s or 0.0))
            elif kind == "recover":
                self._lasting = {}
                self._set_faults()
                self._set_remote(True)
                for meter in self._meters:
                    meter.recover()
            elif kind in ("meter drop", "meter remote"):
                self._set_remote(kind == "meter remote")
            elif kind == "meter unit":
                for engine in self._engines:
                    engine.unit = "fL" if command.value == "fL" else "cd/m2"
            elif kind in ("meter", "meter truncate", "meter delay", "meter garble"):
                fault = self._reply_fault(command)
                for meter in self._meters:
                    meter.inject(fault)
            else:
                self._begin(command)

    def _begin(self, fault: Command) -> None:
        """Begin a fault that lasts, of the camera or the meter's cable."""
        self._lasting = {**self._lasting, fault.kind: fault}
        self._set_faults()
        if fault.duration_s is not None:
            self._timers.call_in(fault.duration_s, lambda: self._end(fault))

    def _set_faults(self) -> None:
        for camera in self._cameras:
            camera.set_faults(_trouble(self._lasting))
        for meter in self._meters:
            if "meter unplug" in self._lasting:
                meter.unplug()
            else:
                meter.plug_in()

    def _end(self, fault: Command) -> None:
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

    def _reply_fault(self, command: Command) -> Fault:
        match command.kind:
            case "meter truncate":
                return Fault(n_bytes=int(command.number))
            case "meter delay":
                return Fault(delay_s=command.duration_s or 0.0)
            case "meter garble":
                self._garbage_seed += 1
                return Fault.garbled(self._garbage_seed)
        return Fault(reply=f"{command.value}\r\n".encode("ascii"))


def _trouble(lasting: dict[str, Command]) -> CameraTrouble:
    return CameraTrouble(
        loss=lasting["lose"].number if "lose" in lasting else 0.0,
        frozen="freeze" in lasting,
        stalled="stall" in lasting,
        gone="vanish" in lasting,
        wrong_ids="wrong ids" in lasting,
        wrong_size="wrong size" in lasting,
        taken="second controller" in lasting,
    )
