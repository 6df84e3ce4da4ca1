"""Dips of SNR or CDP along the luminance, as an HDR sensor has them where it changes to a shorter exposure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isnan, log10, nan
from statistics import NormalDist

import numpy as np

from .axes import At, CdpMap
from .curve import SectionCurve

#: Chance that noise alone makes a fall anywhere in a map; a dip needs a rise, too, so that its chance is less.
_FALSE_ALARM = 0.01
#: Smallest fall and rise of a dip, relative to the higher value.
_LEAST_FALL = 0.1


@dataclass(frozen=True)
class SnrDip:
    """A dip of a variable along an axis: it falls although the luminance rises, and rises again.

    Parameters
    ----------
    at : dict of str to (float or str)
        Values of the other parameters.
    variable : str
        Name of the variable that dips.
    start, position : float
        Where it is highest before the fall and lowest after it, in the unit of the axis.
    highest : float
        Value of the variable before the fall.
    depth_ratio, depth_db : float
        Highest over lowest value, and 20 log10 of that.
    recovery : float
        Where it is again as high as before the fall; nan if it is not inside the map.
    lowest_cdp, lowest_cdp_at : float
        Lowest CDP from the start to the recovery or to the next dip's start, and where it is.
    expected : float
        Luminance of the change of exposure that the dip belongs to; nan if none of those given fits.
    """

    at: At
    variable: str
    start: float
    position: float
    highest: float
    depth_ratio: float
    depth_db: float
    recovery: float
    lowest_cdp: float
    lowest_cdp_at: float
    expected: float


def find_dips(
    cdp_map: CdpMap, axis: str, variable: str = "snr_dark", expected: Sequence[float] = ()
) -> tuple[SnrDip, ...]:
    """Find dips along an axis, for each value of the other parameters.

    Parameters
    ----------
    cdp_map : CdpMap
        The map. Standard errors of the variable are taken from `<variable>_standard_error` (of CDP from
        `standard_error`). Those of a simulated map are at least as large as its roughness.
    axis : str
        Name of an axis of numbers, the luminance.
    variable : str
        `snr_dark`, `snr_bright`, `csnr` or `cdp`.
    expected : sequence of float
        Luminances at which the sensor changes exposure, on the scale of the axis.

    Returns
    -------
    tuple of SnrDip
        By section, then rising along the axis.

    Raises
    ------
    InputError
        If the axis or variable is missing.

    Notes
    -----
    A fall and the rise after it must be at least 10 %, and so many standard errors of the difference that noise
    alone makes such a fall in at most one of 100 maps of this size (Bonferroni's bound over all pairs of points of each
    section; 5.2 for 400 points). Left out are SNR above 1e6, what follows the luminance from which on the bright region
    is saturated (more than 1 % of its pixels, if the map tells), and a last fall without a rise, unless an expected
    change of exposure explains it. A fall before the variable has recovered from the one before belongs to the same
    dip, unless each of them is an expected change of exposure. An expected luminance belongs to the dip whose fall it
    lies in, give or take a grid step; each explains one dip.
    """
    along = cdp_map.numbers(axis, "dips")
    n_pairs = max(cdp_map.dataset["cdp"].size * (along.values.size - 1) / 2, 1)
    margin = -NormalDist().inv_cdf(_FALSE_ALARM / n_pairs)
    return tuple(
        dip
        for at, section in cdp_map.sections(axis, variable=variable)
        for dip in _dips_of(SectionCurve.of(section, along, variable, margin), at, variable, sorted(expected))
    )


def _dips_of(curve: SectionCurve, at: At, variable: str, expected: list[float]) -> list[SnrDip]:
    falls, last_fall_ends = _falls(curve)
    explained = _explained(curve, falls, expected)
    if falls and not last_fall_ends and len(falls) - 1 not in explained:
        falls = falls[:-1]
    joined = _joined(curve, falls, explained)
    dips = []
    for number, (peak, trough, expected_at) in enumerate(joined):
        recovery = _recovery(curve, peak, trough)
        end = joined[number + 1][0] if number + 1 < len(joined) else curve.places.size - 1
        inside = slice(peak, 1 + min(end, int(np.searchsorted(curve.places, recovery, side="right")) - 1))
        cdp = curve.cdp[inside]
        lowest = peak + int(np.nanargmin(cdp)) if np.isfinite(cdp).any() else None
        ratio = float(curve.values[peak] / curve.values[trough]) if curve.values[trough] > 0 else inf
        dips.append(
            SnrDip(
                at=at,
                variable=variable,
                start=float(curve.places[peak]),
                position=float(curve.places[trough]),
                highest=float(curve.values[peak]),
                depth_ratio=ratio,
                depth_db=20 * log10(ratio),
                recovery=recovery,
                lowest_cdp=nan if lowest is None else float(curve.cdp[lowest]),
                lowest_cdp_at=nan if lowest is None else float(curve.places[lowest]),
                expected=expected_at,
            )
        )
    return dips


def _falls(curve: SectionCurve) -> tuple[list[tuple[int, int]], bool]:
    """Find indices of peak and trough of each fall, and whether the last one is followed by a rise."""
    falls: list[tuple[int, int]] = []
    peak, trough = 0, None
    for i in range(1, curve.values.size):
        if trough is None:
            if curve.values[i] >= curve.values[peak]:
                peak = i
            elif curve.lies_below(i, peak, _LEAST_FALL):
                trough = i
        elif curve.values[i] < curve.values[trough]:
            trough = i
        elif curve.lies_below(trough, i, _LEAST_FALL):
            falls.append((peak, trough))
            peak, trough = i, None
    return falls if trough is None else [*falls, (peak, trough)], trough is None


def _explained(curve: SectionCurve, falls: list[tuple[int, int]], expected: list[float]) -> dict[int, float]:
    """Assign falls to expected luminances, the nearest pairs first, each once."""
    scaled = curve.axis.scaled
    pairs = []
    for number, (peak, trough) in enumerate(falls):
        edge = _last_edge(curve, peak, trough)
        low, high = curve.places[max(edge - 1, 0)], curve.places[min(trough + 1, curve.places.size - 1)]
        middle = scaled(curve.places[[edge, trough]]).mean()
        pairs += [
            (abs(float(scaled(np.array([value]))[0] - middle)), number, value)
            for value in expected
            if low <= value <= high
        ]
    explained: dict[int, float] = {}
    for _, number, value in sorted(pairs):
        if number not in explained and value not in explained.values():
            explained[number] = float(value)
    return explained


def _last_edge(curve: SectionCurve, peak: int, trough: int) -> int:
    """Where the last fall before a trough begins: after the peak there may have been another, too shallow for a dip."""
    edge = trough
    for i in range(trough - 1, peak - 1, -1):
        if curve.values[i] > curve.values[edge]:
            edge = i
        elif curve.lies_below(i, edge, 0.0):
            break
    return edge


def _joined(
    curve: SectionCurve, falls: list[tuple[int, int]], explained: dict[int, float]
) -> list[tuple[int, int, float]]:
    """Peak, trough and expected luminance of each dip: falls that begin before the recovery from another are joined."""
    joined: list[tuple[int, int, float]] = []
    for number, (peak, trough) in enumerate(falls):
        expected = explained.get(number, nan)
        if joined:
            first, lowest, known = joined[-1]
            inside = curve.places[peak] < _recovery(curve, first, lowest)  # never, if it does not recover
            if inside and (isnan(known) or isnan(expected)):
                deepest = trough if curve.values[trough] < curve.values[lowest] else lowest
                joined[-1] = (first, deepest, expected if isnan(known) else known)
                continue
        joined.append((peak, trough, expected))
    return joined


def _recovery(curve: SectionCurve, peak: int, trough: int) -> float:
    """Where the curve is again as high as at the peak, between grid points; nan if nowhere."""
    goal = curve.values[peak]
    above = np.flatnonzero(curve.values[trough + 1 :] >= goal)
    if not above.size:
        return nan
    i = trough + 1 + int(above[0])
    share = (goal - curve.values[i - 1]) / (curve.values[i] - curve.values[i - 1])
    left, right = curve.axis.scaled(curve.places[[i - 1, i]])
    return float(curve.axis.unscaled(left + share * (right - left)))
