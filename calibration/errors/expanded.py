"""Expanded uncertainty of a value with the common errors of luminance meters."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt

from ..meter import MeterScale
from .uncertainty import expanded_half_width


def expanded_rel(scales: Sequence[MeterScale], random_rel: float) -> float:
    """Relative expanded uncertainty U (95 %) of a value with the common errors of meters and a further normal one.

    The largest rectangular part counts as such, all others as normal, with Student's t for the effective degrees of
    freedom of certificates (JCGM 100:2008, G.4).
    """
    from scipy.stats import norm, t

    rectangular = [part for one in scales for part in (one.half_width_rel / sqrt(3), one.mismatch_rel)]
    largest = max(rectangular, default=0.0)
    normal_rel = sqrt(
        max(sum(u**2 for u in rectangular) - largest**2, 0.0) + random_rel**2 + sum(one.normal_rel**2 for one in scales)
    )
    fourth = sum(one.normal_rel**4 / one.degrees_of_freedom for one in scales)
    dof = normal_rel**4 / fourth if fourth > 0 else inf
    factor = 1.0 if dof == inf else float(t.isf(0.025, max(dof, 1)) / norm.isf(0.025))
    return expanded_half_width(sqrt(3) * largest, normal_rel * factor)
