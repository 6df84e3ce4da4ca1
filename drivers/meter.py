"""The meter protocol: interface and errors of all luminance meters."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Literal, Protocol

from ..core.errors import DeviceError, InputError
from ..core.reading import MeterIdentity, Reading, ReadingSeries
from .device import Device


class MeterError(DeviceError):
    """A luminance meter is absent or silent, or its answer is not a reading.

    Examples
    --------
    >>> from labcdp.drivers import MeterError
    >>> print(MeterError("the meter is silent", "switch it on"))
    the meter is silent: switch it on
    """


class MeterNotFoundError(MeterError):
    """The serial port does not exist or cannot be opened.

    Examples
    --------
    >>> from labcdp.drivers import open_meter
    >>> from labcdp.drivers.meter import MeterNotFoundError
    >>> try:
    ...     open_meter("no-such-port")
    ... except MeterNotFoundError as error:
    ...     print(error.cause)
    no-such-port
    """


class MeterTimeoutError(MeterError):
    """The meter did not answer in time, or stopped in the middle of an answer.

    Examples
    --------
    >>> from labcdp.drivers.meter import MeterTimeoutError
    >>> MeterTimeoutError("no answer within 2 s", "switch the meter on").remedy
    'switch the meter on'
    """


class MeterProtocolError(MeterError):
    """The meter violated its protocol.

    Examples
    --------
    >>> from labcdp.drivers.meter import MeterProtocolError
    >>> MeterProtocolError("the reply is 'OK??'", "check the model").cause
    "the reply is 'OK??'"
    """


class MeterLostError(MeterError):
    """The connection to an open meter was lost: its port disappeared.

    Examples
    --------
    >>> from labcdp.drivers import MeterError
    >>> from labcdp.drivers.meter import MeterLostError
    >>> issubclass(MeterLostError, MeterError)
    True
    """


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

    Examples
    --------
    >>> from labcdp.drivers.meter import MeterReportedError
    >>> error = MeterReportedError("ER10", "the light is too bright", "use a filter")
    >>> error.code, str(error)
    ('ER10', 'ER10: the light is too bright: use a filter')
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

    Examples
    --------
    >>> from datetime import UTC, datetime
    >>> from labcdp.drivers.meter import MeterIncident
    >>> MeterIncident("asked again", datetime(2026, 3, 1, tzinfo=UTC), "no answer", duration_s=0.0).kind
    'asked again'
    """

    kind: MeterIncidentKind
    at: datetime
    reason: str
    duration_s: float


class Meter(Device, Protocol):
    """Interface of all luminance meters: real, simulated, or replayed.

    A meter is a context manager; its constructor does no I/O; `open` raises MeterNotFoundError or MeterTimeoutError.

    Examples
    --------
    >>> from labcdp.drivers import Meter, ReplayMeter
    >>> from labcdp.session import Session, example_session
    >>> def luminance_cd_m2(meter: Meter) -> float:
    ...     with meter:
    ...         return meter.measure().luminance_cd_m2
    >>> luminance_cd_m2(ReplayMeter(Session.open(example_session()))) > 0
    True
    """

    #: Whether it takes as many readings as are wanted; False if a person, a file or a recording gives them.
    live: bool = True

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

    Examples
    --------
    >>> from labcdp.drivers.meter import MeterError, require_mode
    >>> from labcdp.session import Session, example_session
    >>> reading = Session.open(example_session()).readings()[0].reading
    >>> require_mode(reading)  # a luminance with the preset correction
    >>> try:
    ...     require_mode(reading, ratio=True)
    ... except MeterError as error:
    ...     print(error.cause)
    the meter gave a luminance, not a ratio in % (OK00,CcPH  0.50)
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

    Examples
    --------
    >>> from labcdp.drivers import ReplayMeter
    >>> from labcdp.drivers.meter import measure_series
    >>> from labcdp.session import Session, example_session
    >>> with ReplayMeter(Session.open(example_session())) as meter:
    ...     series = measure_series(meter, 2)
    >>> len(series.readings)
    2
    """
    if n < 1:
        raise InputError(f"the number of readings is {n}: take at least 1")
    return ReadingSeries(tuple(meter.measure() for _ in range(n)))
