"""A luminance meter without an interface: the user types the displayed number."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Final, Self

from ...core.errors import InputError
from ...core.reading import MeterIdentity, Reading
from ..device import Device
from ..meter import MeterError, MeterIncident
from .text import MeterAccuracy, parse_written, reading_of

_ATTEMPTS: Final = 3


class ManualMeter(Device):
    """A meter whose readings are typed in; a `Meter`.

    Parameters
    ----------
    ask : callable
        Called with a prompt; returns the typed text, for example `input`.
    identity : MeterIdentity
        Identity of the meter.
    accuracy : MeterAccuracy
        Its accuracy by data sheet or certificate.

    Examples
    --------
    >>> accuracy = MeterAccuracy(scale_half_width_rel=0.03, repeatability_rel=0.002, digits=1)
    >>> with ManualMeter(lambda prompt: "12,3", MeterIdentity("L 1003", "4711"), accuracy) as meter:
    ...     meter.measure().luminance_cd_m2
    12.3
    """

    def __init__(self, ask: Callable[[str], str], identity: MeterIdentity, accuracy: MeterAccuracy) -> None:
        self._ask = ask
        self._identity = identity
        self._accuracy = accuracy
        self._is_open = False

    @property
    def identity(self) -> MeterIdentity:
        """Model, serial number and calibration date, as given."""
        return self._identity

    def open(self) -> Self:
        """Open the meter."""
        self._is_open = True
        return self

    def close(self) -> None:
        """Close the meter; may be called twice."""
        self._is_open = False

    @property
    def incidents(self) -> tuple[MeterIncident, ...]:
        """None: it does not recover."""
        return ()

    def measure(self) -> Reading:
        """Ask for one reading, up to three times if the input is not a luminance.

        The value of the last digit typed is the resolution: type ``12.30`` if the meter shows it.

        Raises
        ------
        MeterError
            If the meter is not open, input ends, or no answer is a luminance.
        """
        if not self._is_open:
            raise MeterError(
                f"{self._identity.model}: the meter is not open: call open(), or use it in a with statement"
            )
        prompt = f"Luminance shown by {self._identity.model}, in cd/m2 or with its unit like 3.4 fL: "
        problem = ""
        for _ in range(_ATTEMPTS):
            try:
                text = self._ask(f"{problem}{prompt}")
            except EOFError:
                raise MeterError(
                    "no reading of the luminance meter was typed: run the command in an interactive terminal"
                ) from None
            try:
                written = parse_written(text)
            except InputError as error:
                problem = f"{error}. "
                continue
            unit = written.unit or "cd/m2"
            return reading_of(written, unit, self._accuracy, self._identity, datetime.now(UTC), text)
        raise MeterError(f"no luminance was typed in {_ATTEMPTS} attempts, last: {problem.removesuffix('. ')}")
