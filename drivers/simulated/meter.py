"""Replies of a simulated meter: when they come, their faults, and a port in this process that carries them."""

from __future__ import annotations

import errno
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Final, Literal, Protocol, Self

import numpy as np

from ...core.clock import Clock
from ...core.errors import InputError
from ...core.reading import CD_M2_PER_FL
from ..minolta_ls.protocol import (
    LS110,
    MODE_GROUPS,
    POWER_ON,
    SIMULATED_COMMAND,
    SIMULATED_REPLY,
    LSDataSheet,
    MeterMode,
    four_digits,
)

CRLF: Final = b"\r\n"

#: Longest garbage; a reading has 17 bytes.
_LONGEST_GARBAGE: Final = 24


class MeterEngine(Protocol):
    """Maps commands to replies, for example `SimulatedLS`."""

    remote: bool
    unit: Literal["cd/m2", "fL"]

    def answer(self, command: bytes) -> bytes:
        """Return the reply to a command, both with CR LF, or nothing; a command without CR LF is incomplete."""


@dataclass(frozen=True)
class Fault:
    r"""Fault of one reply; none without arguments.

    A meter that states fL is no fault of one reply: set `SimulatedLS.unit`.

    Parameters
    ----------
    delay_s : float
        Delay of the reply in seconds; until then the meter accepts no command.
    reply : bytes or None
        Sent instead of the meter's own: ``b""`` for silence, ``b"ER30\r\n"`` for an error code, or any garbage.
    n_bytes : int or None
        Number of bytes after which the reply is truncated.

    Examples
    --------
    Silent once, then an answer 2 s late, a good one, one cut short, and an empty battery:

    >>> faults = [Fault(reply=b""), Fault(delay_s=2), Fault(), Fault(n_bytes=7), Fault(reply=b"ER30\r\n")]
    """

    delay_s: float = 0.0
    reply: bytes | None = None
    n_bytes: int | None = None

    def __post_init__(self) -> None:
        if not self.delay_s >= 0:
            raise InputError(f"delay_s is {self.delay_s}: give a number of seconds of at least 0")
        if self.n_bytes is not None and self.n_bytes < 0:
            raise InputError(f"n_bytes is {self.n_bytes}: give a number of bytes of at least 0")

    @classmethod
    def garbled(cls, seed: int) -> Fault:
        """Return a reply of random bytes of that seed, every other time with a CR LF."""
        rng = np.random.default_rng(seed)
        garbage = rng.bytes(int(rng.integers(1, _LONGEST_GARBAGE)))
        return cls(reply=garbage + (CRLF if rng.integers(2) else b""))


class FaultyMeter:
    """A meter whose replies take time and have the faults that are injected; base of what puts it on a port.

    Parameters
    ----------
    engine : MeterEngine
        The meter.
    response_time_s : float
        Time a MES takes.

    Raises
    ------
    InputError
        If the time is negative.
    """

    def __init__(self, engine: MeterEngine, response_time_s: float) -> None:
        if not response_time_s >= 0:
            raise InputError(f"response_time_s is {response_time_s}: give a number of seconds of at least 0")
        self.engine = engine
        self._response_time_s = response_time_s
        self._faults: deque[Fault] = deque()

    def inject(self, *faults: Fault) -> None:
        """Queue faults, one for each of the next replies, of whatever command."""
        self._faults.extend(faults)

    def recover(self) -> None:
        """Forget the faults that are queued, and enter remote mode."""
        self._faults.clear()
        self.engine.remote = True

    def unplug(self) -> None:
        """Pull the cable."""
        raise NotImplementedError

    def plug_in(self) -> None:
        """Reconnect the cable."""
        raise NotImplementedError

    def reply(self, command: bytes) -> tuple[bytes, float] | None:
        """Return the reply to a command and the time it takes, in which no other is accepted; None for silence."""
        answer = self.engine.answer(command)
        if not answer:
            return None
        fault = self._faults.popleft() if self._faults else Fault()
        busy_s = fault.delay_s + (self._response_time_s if command.startswith(b"MES") else 0.0)
        return (answer if fault.reply is None else fault.reply)[: fault.n_bytes], busy_s


class InProcessPort(FaultyMeter):
    """A meter for `MinoltaLS` without a serial port; see `labcdp.drivers.minolta_ls.port.Port`.

    Parameters
    ----------
    engine : MeterEngine
        The meter.
    clock : Clock
        Clock of its replies.
    response_time_s : float
        Time a MES takes.
    """

    name = "the simulated meter"
    may_be_simulated = True

    def __init__(self, engine: MeterEngine, clock: Clock, response_time_s: float = 0.8) -> None:
        super().__init__(engine, response_time_s)
        self.clock = clock
        self.rtscts = False
        self._plugged = True
        self._slice_s = 0.0
        self._busy_until_s = clock.monotonic_s()
        # What is on its way, with the time of its arrival.
        self._coming: deque[tuple[float, int]] = deque()

    def unplug(self) -> None:
        """Pull the cable; what was on its way is lost."""
        self._plugged = False
        self._coming.clear()

    def plug_in(self) -> None:
        """Reconnect the cable."""
        self._plugged = True

    def connect(self, slice_s: float, write_timeout_s: float) -> Self:
        """Open it; a `read` takes at most `slice_s`."""
        self._require_cable(errno.ENOENT)
        self._slice_s = slice_s
        return self

    def close(self) -> None:
        """Close it; the meter keeps running."""

    def reset_output_buffer(self) -> None:
        """Do nothing: a command is taken at once."""
        self._require_cable()

    def write(self, data: bytes) -> None:
        """Take commands, each with its CR LF, unless the meter is busy."""
        self._require_cable()
        for command in data.split(CRLF)[:-1]:
            now_s = self.clock.monotonic_s()
            if now_s >= self._busy_until_s and (reply := self.reply(command + CRLF)) is not None:
                text, busy_s = reply
                self._busy_until_s = now_s + busy_s
                self._coming.extend((self._busy_until_s, byte) for byte in text)

    @property
    def in_waiting(self) -> int:
        """Number of bytes that have arrived."""
        self._require_cable()
        return sum(at_s <= self.clock.monotonic_s() for at_s, _ in self._coming)

    def read(self, n: int) -> bytes:
        """Return up to `n` bytes that arrive in time."""
        if not self.in_waiting:
            now_s = self.clock.monotonic_s()
            next_s = self._coming[0][0] if self._coming else now_s + self._slice_s
            self.clock.sleep(min(self._slice_s, next_s - now_s))
        return bytes(self._coming.popleft()[1] for _ in range(min(n, self.in_waiting)))

    def _require_cable(self, number: int = errno.EIO) -> None:
        if not self._plugged:
            raise OSError(number, "it is unplugged")


_CORRECTION_FLAGS: Final = {MeterMode.PRESET: "P", MeterMode.VARI_CCF: "K"}
#: Modes that need what is stored in the memory, which is empty.
_NEEDS_MEMORY: Final = {MeterMode.VARI_LUMI, MeterMode.VARI_CCF_LUMI, MeterMode.RATIO}


@dataclass(frozen=True)
class MeterErrorModel:
    """Errors of a simulated meter in addition to its rounding to four digits.

    Parameters
    ----------
    scale_rel : float
        Relative error of this device's scale, the same for each of its readings: 0.01 reads 1 % too much.
    repeatability_rel : float
        Relative standard deviation from reading to reading (normal).
    seed : int
        Random seed of the repeatability.

    Raises
    ------
    InputError
        If a value is not finite, the scale error is -1 or below, or the repeatability is negative.
    """

    scale_rel: float = 0.0
    repeatability_rel: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        if not (isfinite(self.scale_rel) and self.scale_rel > -1):
            raise InputError(f"scale_rel is {self.scale_rel}: give a fraction above -1, 0.01 for 1 % too much")
        if not (isfinite(self.repeatability_rel) and self.repeatability_rel >= 0):
            raise InputError(f"repeatability_rel is {self.repeatability_rel}: give a fraction of at least 0")


class SimulatedLS:
    """The meter without a port, with the manual's commands MES, DSR and MDS.

    Parameters
    ----------
    luminance : callable
        Returns the luminance in the meter's field, in cd/m^2; called once for each MES.
    data_sheet : LSDataSheet
        The model.
    errors : MeterErrorModel
        How it errs.
    unit : {'cd/m2', 'fL'}
        Position of the unit switch; the attribute may be changed at any time.

    Attributes
    ----------
    remote : bool
        Whether the meter is in remote mode; without, it is silent.

    Notes
    -----
    Its memory is empty: the colour correction factor is 1, and modes that need a reference are answered with ER11, as
    is DSR before the first measurement. A single measurement has no other peak than its value. Dark signal reads 0.
    """

    def __init__(
        self,
        luminance: Callable[[], float],
        data_sheet: LSDataSheet = LS110,
        errors: MeterErrorModel = MeterErrorModel(),
        unit: Literal["cd/m2", "fL"] = "cd/m2",
    ) -> None:
        self.unit = unit
        self.remote = True
        self._luminance = luminance
        self._data_sheet = data_sheet
        self._errors = errors
        self._rng = np.random.default_rng(errors.seed)
        self._modes = POWER_ON
        self._held = "ER11"

    def answer(self, command: bytes) -> bytes:
        """Execute one command.

        Parameters
        ----------
        command : bytes
            With its CR LF; without, it is an incomplete command.

        Returns
        -------
        bytes
            The reply with CR LF: ``OK00`` and data, or an error code; empty out of remote mode.
        """
        return self._execute(command).encode("ascii") + CRLF if self.remote else b""

    def _execute(self, command: bytes) -> str:
        words = command.removesuffix(CRLF).decode("ascii", "replace") if command.endswith(CRLF) else ""
        if words == "MES":
            return self._measure()
        if words == "DSR":
            return self._held
        if words == SIMULATED_COMMAND:
            return SIMULATED_REPLY.decode("ascii").strip()
        for group in MODE_GROUPS:
            for mode in group:
                if words == f"MDS,{mode.value}":
                    self._modes = tuple(mode if old in group else old for old in self._modes)
                    return "OK00"
        return "ER00"

    def _measure(self) -> str:
        luminance = float(self._luminance())
        if not (isfinite(luminance) and luminance >= 0):
            raise InputError(f"the simulated meter is pointed at {luminance} cd/m^2: give a number of at least 0")
        noise = self._errors.repeatability_rel * self._rng.standard_normal()
        seen = max(0.0, luminance * (1 + self._errors.scale_rel) * (1 + noise))
        sheet = self._data_sheet
        _, highest = sheet.slow_range_cd_m2 if MeterMode.SLOW in self._modes else sheet.fast_range_cd_m2
        if seen > highest:
            return "ER10"
        if not _NEEDS_MEMORY.isdisjoint(self._modes):
            return "ER11"
        peak = "P" if MeterMode.PEAK in self._modes else "C"
        unit, cd_m2_per_unit = ("f", CD_M2_PER_FL) if self.unit == "fL" else ("c", 1.0)
        correction = _CORRECTION_FLAGS[self._modes[0]]
        number = four_digits(seen / cd_m2_per_unit, sheet.decimals)
        if number is None:
            return "ER19"
        # Six characters, padded with blanks on the left.
        self._held = f"OK00,{peak}{unit}{correction}H{number:>6f}"
        return self._held
