"""End of the linear range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

from .result import SaturationLimit
from .series import SeriesPoint

#: Drop of the variance after its peak, in standard uncertainties, required of a peak.
_SIGNIFICANT = 4.0
#: Share of values at the last DN above which the converter limits the range.
_CONVERTER_SHARE = 0.5


@dataclass(frozen=True)
class Saturation:
    """The end of the linear range.

    Parameters
    ----------
    index : int
        Point of the series with the largest temporal variance; the last unsaturated one where no peak was seen.
    limit : {'converter', 'full well', 'not reached'}
        Cause of saturation.
    """

    index: int
    limit: SaturationLimit


def find_saturation(points: Sequence[SeriesPoint]) -> Saturation:
    """Find the point of saturation: the largest temporal variance (EMVA 1288 Release 4.0 Linear).

    Beyond it pixels reach the end of the converter, or are full, and their noise vanishes.

    Parameters
    ----------
    points : sequence of SeriesPoint
        At least one, in rising order of signal.
    """
    index = max(range(len(points)), key=lambda i: points[i].light.variance_dn2)
    peak, beyond = points[index], points[index + 1 :]
    falls = any(
        peak.light.variance_dn2 - point.light.variance_dn2
        > _SIGNIFICANT * hypot(peak.variance_uncertainty_dn2, point.variance_uncertainty_dn2)
        for point in beyond
    )
    if not falls:
        return Saturation(index, "not reached")
    at_the_end = max(point.light.saturated_share for point in beyond)
    return Saturation(index, "converter" if at_the_end >= _CONVERTER_SHARE else "full well")
