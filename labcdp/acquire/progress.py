"""Progress: what a run tells while it goes on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .live import Live


@dataclass(frozen=True)
class Progress:
    """How far a run is.

    Parameters
    ----------
    step : str
        What is being taken, for a person.
    done, total : int
        Frames or readings of this kind, those recorded earlier included.
    live : Live or None
        What the frames of the present exposure say, after each frame.
    note : str or None
        Something a person should be told.
    """

    step: str
    done: int
    total: int
    live: Live | None = None
    note: str | None = None


Report = Callable[[Progress], None]
