"""Faults of the simulated bench as values; the text of each is its command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: Faults of the camera that last until their time is over.
CameraFaultKind = Literal["lose", "freeze", "stall", "vanish", "wrong ids", "wrong size", "second controller"]


@dataclass(frozen=True)
class CameraFault:
    """A fault of the camera; see `CameraTrouble` for the effect of each kind.

    Parameters
    ----------
    kind : str
        Which fault.
    duration_s : float or None
        Duration; None until `Recover`.
    share : float
        Share of the packets that are lost, 0 to 1; for ``lose`` only.
    """

    kind: CameraFaultKind
    duration_s: float | None = None
    share: float = 0.0

    def __str__(self) -> str:
        what = f"lose {_decimal(100 * self.share)}%" if self.kind == "lose" else self.kind
        return what + _for(self.duration_s)


@dataclass(frozen=True)
class Drift:
    """A linear change of temperature or light, which then persists.

    Parameters
    ----------
    quantity : {'temperature', 'light'}
        What changes.
    change : float
        Amount: degrees Celsius, or a fraction of the current light.
    duration_s : float
        Duration of the change; 0 for a step.
    """

    quantity: Literal["temperature", "light"]
    change: float
    duration_s: float = 0.0

    def __str__(self) -> str:
        amount = f"{_signed(self.change)} C" if self.quantity == "temperature" else f"{_signed(100 * self.change)}%"
        return f"{self.quantity} {amount} in {_duration(self.duration_s)}"


@dataclass(frozen=True)
class MeterReplyFault:
    """A fault of the meter's next reply.

    Parameters
    ----------
    kind : {'code', 'truncate', 'delay', 'garble'}
        Error code instead; truncated; late; random bytes instead.
    code : str
        The error code.
    n_bytes : int
        Number of bytes after which it is truncated.
    delay_s : float
        Delay.
    """

    kind: Literal["code", "truncate", "delay", "garble"]
    code: str = ""
    n_bytes: int = 0
    delay_s: float = 0.0

    def __str__(self) -> str:
        if self.kind == "code":
            return f"meter {self.code}"
        return (
            "meter "
            + {
                "truncate": f"truncate {self.n_bytes}",
                "delay": f"delay {_duration(self.delay_s)}",
                "garble": "garble",
            }[self.kind]
        )


@dataclass(frozen=True)
class MeterUnit:
    """A move of the meter's unit switch.

    Parameters
    ----------
    unit : {'cd/m2', 'fL'}
        Its new position.
    """

    unit: Literal["cd/m2", "fL"]

    def __str__(self) -> str:
        return f"meter unit {self.unit}"


@dataclass(frozen=True)
class MeterRemote:
    """The meter leaves remote mode and is silent, or returns to it.

    Parameters
    ----------
    remote : bool
        Whether it is in remote mode.
    """

    remote: bool

    def __str__(self) -> str:
        return "meter remote" if self.remote else "meter drop"


@dataclass(frozen=True)
class MeterUnplug:
    """The meter's cable is pulled.

    Parameters
    ----------
    duration_s : float or None
        Duration; None until `Recover`.
    """

    duration_s: float | None = None

    def __str__(self) -> str:
        return "meter unplug" + _for(self.duration_s)


@dataclass(frozen=True)
class Recover:
    """The camera's faults end, and the meter is plugged in and in remote mode."""

    def __str__(self) -> str:
        return "recover"


Command = CameraFault | Drift | MeterReplyFault | MeterUnit | MeterRemote | MeterUnplug | Recover


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

    def __str__(self) -> str:
        return f"at {_duration(self.at_s)} {self.command}"


def _for(duration_s: float | None) -> str:
    return "" if duration_s is None else f" for {_duration(duration_s)}"


def _duration(duration_s: float) -> str:
    return f"{_decimal(duration_s)} s"


def _signed(value: float) -> str:
    return ("-" if value < 0 else "+") + _decimal(abs(value))


def _decimal(value: float) -> str:
    text = f"{value:.9f}"
    return text.rstrip("0").rstrip(".")
