"""Faults of the simulated bench as values."""

from __future__ import annotations

from dataclasses import dataclass


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
