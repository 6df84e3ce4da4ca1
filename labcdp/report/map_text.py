"""What a map shows, in a few sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .map_parts import axes_of
from .map_wording import notes

if TYPE_CHECKING:
    from xarray import Dataset

    from ..evaluate.maps import MapAnalysis


def map_notes(dataset: Dataset, analysis: MapAnalysis) -> list[str]:
    """Tell the widest usable range of a map and its deepest dips."""
    return notes(analysis, axes_of(dataset))
