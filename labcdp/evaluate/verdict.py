"""Whether a contrast is detected: its CDP against a limit, the same for pictures, videos and sessions."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Literal, TypeAlias

from ..core.errors import InputError
from ..core.table import Column
from ..report.layout import State

Verdict: TypeAlias = Literal["detected", "not detected", "undecided", "saturated"]
#: CDP from which a contrast counts as detected unless another limit is given.
CDP_LIMIT = 0.9
#: Colours of the verdicts.
STATES: dict[Verdict, State] = {"detected": "good", "not detected": "bad", "undecided": "open", "saturated": "open"}
#: Limit and verdict, for items that have them under these names.
LIMIT = Column("cdp_limit", "CDP limit", "", "CDP from which the contrast counts as detected.", digits=0, shown=False)
VERDICT = Column(
    "verdict",
    "detected",
    "",
    "Whether the CDP reaches the limit: undecided within its 95 % interval; saturated if a region is, without a CDP.",
)


def cdp_verdict(cdp: float, interval: tuple[float, float], limit: float) -> Verdict:
    """Return whether a contrast is detected: undecided if the interval of its CDP is unknown or includes the limit."""
    low, high = interval
    if not (isfinite(low) and isfinite(high)) or low < limit <= high:
        return "undecided"
    return "detected" if cdp >= limit else "not detected"


def require_limit(limit: float) -> None:
    """Raise InputError if a limit of the CDP is no probability above 0."""
    if not 0 < limit <= 1:
        raise InputError(f"the CDP limit is {limit:g}: give a probability above 0, up to 1")


def changes_of(answers: Sequence[float | None], most: int) -> list[int]:
    """Return places of a rising series, in order, where the answer changes most; of one that does not, a spread.

    Parameters
    ----------
    answers : sequence of float or None
        Such as the share of frames in which each contrast is detected; None for no answer.
    most : int
        Number of places, at least 2.
    """
    if len(answers) <= most:
        return [*range(len(answers))]
    known = [0.0 if answer is None else answer for answer in answers]
    steps = sorted(range(len(known) - 1), key=lambda at: -abs(known[at + 1] - known[at]))
    places: list[int] = []
    for at in steps:
        for end in (at, at + 1):
            if known[at] != known[at + 1] and end not in places and len(places) < most:
                places.append(end)
    spread = [round(n * (len(known) - 1) / (most - 1)) for n in range(most)]
    # What does not change is shown by its ends.
    return sorted([*places, *(index for index in spread if index not in places)][:most])
