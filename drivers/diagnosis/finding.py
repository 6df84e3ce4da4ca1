"""Finding: one thing that was looked at, what is wrong with it, and what mends it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

State = Literal["good", "notice", "fault", "unknown"]


@dataclass(frozen=True)
class Finding:
    """The outcome of one check.

    Parameters
    ----------
    topic : str
        What was looked at, for example ``receive buffer``.
    state : {'good', 'notice', 'fault', 'unknown'}
        Good; works but could be better; does not work; could not be found out.
    cause : str
        What was found, with values and units.
    remedy : str or None
        The command, or what hands have to do, that mends it; None for a good one.
    """

    topic: str
    state: State
    cause: str
    remedy: str | None = None

    def __str__(self) -> str:
        """Return cause and remedy on one line."""
        return self.cause if self.remedy is None else f"{self.cause}: {self.remedy}"

    @classmethod
    def of_error(cls, topic: str, error: Exception, state: State = "fault") -> Self:
        """Make a finding of an error of ours, whose message ends in what to do after its last colon."""
        text = " ".join(str(error).split())
        cause, colon, remedy = text.rpartition(": ")
        # A reason that another program gave stands in brackets at the end, and may have a colon of its own.
        if not colon or remedy.count("]") > remedy.count("["):
            return cls(topic, state, text)
        return cls(topic, state, cause, remedy)
