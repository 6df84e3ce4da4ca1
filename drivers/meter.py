"""The meter protocol: interface and errors of all luminance meters."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Literal, Protocol

from ..core.errors import DeviceError, InputError
from ..core.reading import MeterIdentity, Reading, ReadingSeries
from .device import Device


class MeterError(DeviceError):
    """A luminance meter is absent or silent, or its answer is not a reading."""


class MeterNotFoundError(MeterError):
    """The serial port does not exist or cannot be opened."""


class MeterTimeoutError(MeterError):
    """The meter did not answer in time, or stopped in the middle of an answer."""


class MeterProtocolError(MeterError):
    """The meter violated its protocol."""


class MeterLostError(MeterError):
    """The connection to an open meter was lost: its port disappeared."""


class MeterReportedError(MeterError):
    """The meter answered with one of its error codes.

    Parameters
    ----------
    code : str
        The code as sent, for example ``ER10``.
    meaning : str
        Meaning of the code by the meter's manual.
    remedy : str
        Remedy.
    """

    def __init__(self, code: str, meaning: str, remedy: str) -> None:
        super().__init__(f"{code}: {meaning}", remedy)
        self.code = code


MeterIncidentKind = Literal["asked again", "lost and back", "error"]


@dataclass(frozen=True)
class MeterIncident:
    """A trouble of a meter, also one that was overcome.

    Parameters
    ----------
    kind : {'asked again', 'lost and back', 'error'}
        Whether a command was repeated, the meter came back after a loss, or the command failed.
    at : datetime
        Host time, with time zone.
    reason : str
        Problem.
    duration_s : float
        Time for which the meter was lost.
    """

    kind: MeterIncidentKind
    at: datetime
    reason: str
    duration_s: float


class Meter(Device, Protocol):
    """Interface of all luminance meters: real, simulated, or replayed.

    A meter is a context manager; its constructor does no I/O; `open` raises MeterNotFoundError or MeterTimeoutError.
    """

    @property
    def identity(self) -> MeterIdentity:
        """Model, serial number and calibration date."""

    @property
    def incidents(self) -> tuple[MeterIncident, ...]:
        """Troubles since the meter was made; none of a meter that does not recover."""
        return ()

    def measure(self) -> Reading:
        """Take one reading."""


def require_mode(
    reading: Reading, *, ratio: bool = False, peak: bool = False, correction: str | None = "preset"
) -> None:
    """Refuse a reading in another mode than the wanted one.

    The flags of a reading state its mode; keys of the meter change modes unnoticed.

    Parameters
    ----------
    reading : Reading
        As the meter gave it.
    ratio : bool
        Whether a ratio in % is wanted instead of a luminance.
    peak : bool
        Whether the highest value is wanted instead of the present one.
    correction : {'preset', 'luminance', 'colour', 'both'} or None
        The correction that the meter should apply; None accepts each. A meter that states none is accepted.

    Raises
    ------
    MeterError
        If the reading is in another mode.
    """
    problems = {
        "a ratio in %": reading.unit == "%" and not ratio,
        "a luminance, not a ratio in %": reading.unit != "%" and ratio,
        "a held peak": reading.peak and not peak,
        "the present value, not the peak": peak and not reading.peak,
        f"a reading with the correction {reading.correction!r}, not {correction!r}": None
        not in (reading.correction, correction)
        and reading.correction != correction,
    }
    for problem, applies in problems.items():
        if applies:
            raise MeterError(
                f"the meter gave {problem} ({reading.raw})",
                "the reading is not used; set the mode back at the meter, or switch it off and on, then repeat",
            )


def measure_series(meter: Meter, n: int) -> ReadingSeries:
    """Take several readings of the same light.

    Parameters
    ----------
    meter : Meter
        Open.
    n : int
        Number of readings.

    Raises
    ------
    InputError
        If `n` is less than 1, or the readings have no mean, for example ratios in %.
    MeterError
        As `Meter.measure`.
    """
    if n < 1:
        raise InputError(f"the number of readings is {n}: take at least 1")
    return ReadingSeries(tuple(meter.measure() for _ in range(n)))
