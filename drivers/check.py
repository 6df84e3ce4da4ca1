"""Checks of a computer, its network and devices, each with its remedy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

from ..core.errors import DeviceError

State = Literal["good", "notice", "fault", "unknown"]


@dataclass(frozen=True)
class Check:
    """The outcome of one check.

    Parameters
    ----------
    topic : str
        Subject of the check, for example ``receive buffer``.
    state : {'good', 'notice', 'fault', 'unknown'}
        Good; works but could be better; does not work; unknown.
    cause : str
        Observation, with values and units.
    remedy : str or None
        Command or manual step that fixes it; None if good.
    """

    topic: str
    state: State
    cause: str
    remedy: str | None = None

    def __str__(self) -> str:
        """Return cause and remedy on one line."""
        return self.cause if self.remedy is None else f"{self.cause}: {self.remedy}"

    @classmethod
    def judged(cls, topic: str, cause: str, remedy: str | None, state: State = "notice") -> Self:
        """Return a good check if `remedy` is None, otherwise a check with `state`."""
        return cls(topic, "good" if remedy is None else state, cause, remedy)

    @classmethod
    def failed(cls, topic: str, error: DeviceError, state: State = "fault") -> Self:
        """Return the check that ended with an error of a device."""
        return cls(topic, state, error.cause, error.remedy)
