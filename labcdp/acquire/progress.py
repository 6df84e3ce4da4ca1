"""Progress of a running acquisition."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .live import Live


@dataclass(frozen=True)
class Progress:
    """State of a run.

    Parameters
    ----------
    step : str
        Current step, for the user.
    done, total : int
        Frames or readings of this kind, including those recorded earlier.
    live : Live or None
        Statistics of the current exposure, after each frame.
    note : str or None
        Message to the user.
    """

    step: str
    done: int
    total: int
    live: Live | None = None
    note: str | None = None


Report = Callable[[Progress], None]
