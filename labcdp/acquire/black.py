"""Black level of a camera as measured: registers do not say it in DN of the pixel format."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from ..calibration.signal_limits import MAX_CLIPPED_SHARE
from .live import PatchNumbers

#: Least ratio of two exposures whose line says what is at exposure 0.
_LEAST_RATIO = 2.0


def measured_black_dn(dark: Sequence[PatchNumbers], light: Sequence[PatchNumbers]) -> float | None:
    """Return the mean of the shortest dark frames, else the intercept of the light frames.

    Parameters
    ----------
    dark, light : sequence of PatchNumbers
        All exposures of all patches so far.

    Returns
    -------
    float or None
        None if there is one exposure only, and no dark frame.
    """
    if dark:
        shortest_s = min(n.exposure_s for n in dark)
        return fmean(n.mean_dn for n in dark if n.exposure_s == shortest_s)
    lines = []
    for name in {n.patch for n in light}:
        clear = [n for n in light if n.patch == name and n.saturated_share <= MAX_CLIPPED_SHARE]
        first, last = (pick(clear, key=lambda n: n.exposure_s, default=None) for pick in (min, max))
        if first is not None and last is not None and last.exposure_s >= _LEAST_RATIO * first.exposure_s:
            slope = (last.mean_dn - first.mean_dn) / (last.exposure_s - first.exposure_s)
            lines.append((slope, first.mean_dn - slope * first.exposure_s))
    # The flattest line is extrapolated least.
    return min(lines, default=(0.0, None), key=lambda line: line[0])[1]
