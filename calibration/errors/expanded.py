"""Expanded uncertainty of a value with the common errors of luminance meters."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt

from ..meter import MeterScale
from .uncertainty import expanded_of


def expanded_rel(scales: Sequence[MeterScale], random_rel: float, dof: float = inf) -> float:
    """Relative expanded uncertainty U (95 %) of a value with the errors of meters and a further normal one."""
    normal = [(one.normal_rel**2, one.degrees_of_freedom) for one in scales]
    rectangular = [part for one in scales for part in (one.half_width_rel / sqrt(3), one.mismatch_rel)]
    return expanded_of([*normal, (random_rel**2, dof)], rectangular)
