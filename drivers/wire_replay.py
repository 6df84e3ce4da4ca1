"""Replay of a wire transcript: the recorded meter answers again, byte for byte, and its driver is asked again.

The engine stands behind a pseudo-terminal, `labcdp.drivers.simulated.meter_pty.PtyMeter`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from typing import Any, Final

from ..errors import DeviceError, InputError
from ..reading import Reading
from .meter import MeterError
from .minolta_ls import MeterMode, MinoltaLS, MinoltaLS100, MinoltaLS110, Reference
from .minolta_ls_line import LONGEST_REPLY
from .wire_transcript import Exchange, Transcript

#: Time-out of a driver that a transcript is played to; a recorded silence takes twice as long.
REPLAY_TIMEOUT_S: Final = 1.0

_DRIVERS: Final[dict[str, type[MinoltaLS]]] = {"LS-100": MinoltaLS100, "LS-110": MinoltaLS110}


class WireMismatchError(DeviceError):
    """A driver sends something else than the transcript holds."""


class RecordedMeter:
    """A `MeterEngine` that gives the recorded answers to the recorded commands, and to no others.

    Silence stays silence, a broken-off answer breaks off at the same byte, and an answer that came after the
    recorded driver's time-out comes after that of the driver here. Left out are bytes that the driver dropped without
    having asked: those before the first command, and the late rest of an answer that had broken off.

    Parameters
    ----------
    transcript : Transcript
        The transcript.
    timeout_s : float
        Time-out of the driver it is played to, in seconds.
    """

    def __init__(self, transcript: Transcript, timeout_s: float = REPLAY_TIMEOUT_S) -> None:
        self._exchanges = transcript.exchanges
        self._recorded_timeout_s = transcript.header.timeout_s
        self._timeout_s = timeout_s
        self._used = 0
        self._mismatch: str | None = None

    @property
    def n_used(self) -> int:
        """How many of the recorded exchanges took place."""
        return self._used

    @property
    def next_command(self) -> bytes | None:
        """The command that must come next; None if all have come."""
        return self._exchanges[self._used].command.data if self._used < len(self._exchanges) else None

    def answer(self, command: bytes) -> bytes:
        """Return what was received for a command, as late as it came; nothing after a mismatch."""
        expected = self.next_command
        if self._mismatch is None and command != expected:
            wanted = "nothing more" if expected is None else repr(expected)
            self._mismatch = f"command {self._used + 1} is {command!r}, the transcript has {wanted}"
        if self._mismatch is not None:
            return b""
        exchange = self._exchanges[self._used]
        self._used += 1
        reply, is_late = self._reply(exchange)
        if is_late:
            time.sleep(1.5 * self._timeout_s)
        return reply

    def check(self, *, finished: bool) -> None:
        """Raise WireMismatchError if another command came or, once the driver has finished, one did not come."""
        if self._mismatch is not None:
            raise WireMismatchError(f"{self._mismatch}: the driver has changed, or the transcript was edited")
        if finished and self.next_command is not None:
            raise WireMismatchError(
                f"{len(self._exchanges) - self._used} of {len(self._exchanges)} exchanges are left, next is "
                f"{self.next_command!r}: the driver asks less than the transcript holds"
            )

    def _reply(self, exchange: Exchange) -> tuple[bytes, bool]:
        """Return what to send, and whether it comes after the time-out."""
        due_s = exchange.command.t_s + self._recorded_timeout_s
        everything = b"".join(entry.data for entry in exchange.received)
        in_time = b"".join(entry.data for entry in exchange.received if entry.t_s < due_s)
        if not in_time:
            return everything, bool(everything)
        is_whole = b"\r\n" in in_time or len(in_time) >= LONGEST_REPLY
        return (everything if is_whole else in_time), False


def driver_of(transcript: Transcript, port: str, timeout_s: float = REPLAY_TIMEOUT_S) -> MinoltaLS:
    """Return the driver of a transcript's meter, not open.

    Raises
    ------
    InputError
        If there is none for the model.
    """
    model = transcript.header.meter
    if model not in _DRIVERS:
        raise InputError(f"the transcript is of a meter {model!r}: give one of {' or '.join(_DRIVERS)}")
    return _DRIVERS[model](port, timeout_s=timeout_s)


def play(recorded: RecordedMeter, meter: MinoltaLS) -> list[dict[str, Any]]:
    """Call the driver's methods so that it sends the recorded commands; each command is a call, opening takes four.

    Parameters
    ----------
    recorded : RecordedMeter
        Served on the port of `meter`, unused.
    meter : MinoltaLS
        Not open; one that asks once and does not wait for a lost meter. It is closed at the end.

    Returns
    -------
    list of dict
        For each call its name under ``call``, and ``result``, or ``error`` and ``text``.

    Raises
    ------
    WireMismatchError
        If the driver sends something else than was recorded.
    InputError
        If the transcript has a command the driver does not know.
    """
    outcomes: list[dict[str, Any]] = []
    is_open = False
    with closing(meter):
        while (command := recorded.next_command) is not None:
            name, call = _call(meter, command) if is_open else ("open", meter.open)
            used = recorded.n_used
            try:
                outcomes.append({"call": name, "result": _values(call())})
                is_open = True
            except MeterError as error:
                text = str(error).removeprefix(f"{meter.port}: ")
                outcomes.append({"call": name, "error": type(error).__name__, "text": text})
            recorded.check(finished=False)
            if recorded.n_used == used:
                raise WireMismatchError(f"the driver sent nothing where the transcript has {command!r}")
    recorded.check(finished=True)
    return outcomes


def _call(meter: MinoltaLS, command: bytes) -> tuple[str, Callable[[], object]]:
    """Return the method that sends a command, and its name with its argument."""
    name, _, parameter = command.decode("latin-1").removesuffix("\r\n").partition(",")
    plain: dict[str, Callable[[], object]] = {
        "MES": meter.measure,
        "DSR": meter.read_held,
        "CLE": meter.clear_memory,
        "CMR": meter.read_full_scale,
        "CMS": meter.store_full_scale,
        "LMR": meter.read_user_reference,
        "CCR": meter.read_colour_factor,
    }
    with_number = {
        "CMW": meter.write_full_scale,
        "LMW": meter.write_user_reference,
        "CCW": meter.write_colour_factor,
    }
    try:
        if name in plain and not parameter:
            return plain[name].__name__, plain[name]
        if name in with_number:
            number = float(parameter)
            return f"{with_number[name].__name__}({number})", lambda: with_number[name](number)
        if name == "MDS":
            mode = MeterMode(parameter)
            return f"set_mode({mode.name})", lambda: meter.set_mode(mode)
    except ValueError:
        pass
    raise InputError(f"the transcript has the command {command!r}, which the driver does not send: cut it out")


def _values(result: object) -> Any:
    """Return a result as JSON can hold it, without what differs from run to run."""
    if isinstance(result, Reading):
        values = result.to_dict()
        del values["meter"], values["timestamp"]
        return values
    if isinstance(result, Reference):
        return asdict(result)
    return result if isinstance(result, float) else None
