"""What can go wrong at the simulated bench: one small value for each, whose text is the command for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: Faults of the camera that last until their time is over.
CameraFaultKind = Literal["lose", "freeze", "stall", "vanish", "wrong ids", "wrong size", "second controller"]


@dataclass(frozen=True)
class CameraFault:
    """Something is wrong with the camera; see `CameraTrouble` for what each kind does.

    Parameters
    ----------
    kind : str
        Which fault.
    duration_s : float or None
        How long; None until `Recover`.
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
    """Temperature or light changes evenly, and stays changed.

    Parameters
    ----------
    quantity : {'temperature', 'light'}
        What changes.
    change : float
        By how much: degrees Celsius, or a fraction of the light of now.
    duration_s : float
        Within which time; 0 for at once.
    """

    quantity: Literal["temperature", "light"]
    change: float
    duration_s: float = 0.0

    def __str__(self) -> str:
        amount = f"{_signed(self.change)} C" if self.quantity == "temperature" else f"{_signed(100 * self.change)}%"
        return f"{self.quantity} {amount} in {_duration(self.duration_s)}"


@dataclass(frozen=True)
class MeterReplyFault:
    """Something is wrong with the meter's next reply.

    Parameters
    ----------
    kind : {'code', 'truncate', 'delay', 'garble'}
        An error code comes instead; it breaks off; it comes late; random bytes come instead.
    code : str
        The error code.
    n_bytes : int
        After how many bytes it breaks off.
    delay_s : float
        How late it comes.
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
    """Somebody moves the meter's unit switch.

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
    """The meter drops out of remote mode and is silent, or is put back.

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
        How long; None until `Recover`.
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
    """A command and when it is given.

    Parameters
    ----------
    at_s : float
        Seconds from the beginning of the schedule.
    command : Command
        What happens.
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
