"""Whether a histogram looks like that of companded codes: their density jumps at the knees of a curve."""

from __future__ import annotations

from dataclasses import replace
from math import log, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.companding import Companding, shipped_curve, shipped_curves
from ..core.result import Finding, warning

#: Changes of the linear value, in both directions from a knee; fewest pixels on the sparser side; and the standard
#: deviation of the logarithm of the ratio of a scene's densities there: clouds, edges, steps of charts. The narrowest
#: that has enough pixels counts. Judgements, by the test's pictures.
_SIDES = ((0.08, 300, 0.25), (0.25, 30, 0.5))
#: Fewest knees that must show the jump, of those that have pixels on both sides, and the share of these.
_LEAST_KNEES, _MOST_OTHERS = 2, 0.25
#: Logarithm of the ratio of likelihoods from which a curve is proposed: 1 in 3 million by chance, were scenes normal.
_EVIDENCE = 15.0
#: Least ratio of slopes that makes a knee.
_KNEE = 1.5


def likely_curve(counts: NDArray[np.int64], bits: int) -> Companding | None:
    """Find the shipped curve whose knees a histogram shows.

    The density of a scene over linear values changes little from just below a value to just above it. Counted by codes
    it jumps at a knee, by the ratio of the slopes.

    Parameters
    ----------
    counts : ndarray of int, shape (n,)
        Pixels by value.
    bits : int
        Bits of the type of the values.

    Returns
    -------
    Companding or None
        The most likely one, with the shift of its codes; None if values are likely no codes.

    Examples
    --------
    >>> from labcdp.files import shipped_curve
    >>> light = np.random.default_rng(1).lognormal(7, 1.5, 200_000)
    >>> codes = shipped_curve("AR0231").code(light)
    >>> likely_curve(np.bincount(codes), 16).name
    'AR0231'
    >>> likely_curve(np.bincount(np.minimum(light, 65535).astype(int)), 16)
    """
    most, best = _EVIDENCE, None
    for curve in map(shipped_curve, shipped_curves()):
        for shift in sorted({0, max(bits - curve.bits, 0)}):
            codes = _codes(counts, curve, shift)
            evidence = 0.0 if codes is None else _evidence(codes, curve)
            if evidence > most:
                most, best = evidence, replace(curve, shift=shift)
    return best


def companded_findings(counts: NDArray[np.int64], bits: int) -> list[Finding]:
    """Return a warning that grey values look like codes of a shipped curve; none if they do not."""
    curve = likely_curve(counts, bits)
    return [] if curve is None else [warning("companded-likely", curve=curve.name, shift=curve.shift)]


def _codes(counts: NDArray[np.int64], curve: Companding, shift: int) -> NDArray[np.int64] | None:
    """Return pixels by code; None if values are none of the curve's."""
    if np.delete(counts, np.s_[:: 2**shift]).any():
        return None
    codes = np.zeros(2**curve.bits, np.int64)
    of_values = counts[:: 2**shift]
    if of_values[codes.size :].any() or of_values[int(curve.codes[-1]) + 1 :].any():
        return None
    codes[: of_values.size] = of_values[: codes.size]
    return codes


def _evidence(codes: NDArray[np.int64], curve: Companding) -> float:
    """Logarithm of the likelihood of the jumps by the curve over that of none; 0 if too few knees show them."""
    knees, values = np.array(curve.codes), np.array(curve.values)
    slopes = np.diff(values) / np.diff(knees)
    total, shown, others = 0.0, 0, 0
    for number in range(1, len(knees) - 1):
        expected = log(slopes[number] / slopes[number - 1])
        if abs(expected) < log(_KNEE):
            continue
        seen = _jump(codes, knees[number - 1 : number + 2], values[number] / slopes[number - 1 : number + 1])
        if seen is None:
            continue
        jump, variance = seen
        total += (jump**2 - (jump - expected) ** 2) / (2 * variance)
        is_shown = abs(jump - expected) < 2 * sqrt(variance)
        shown, others = shown + is_shown, others + (not is_shown)
    return total if shown >= _LEAST_KNEES and others <= _MOST_OTHERS * shown else 0.0


def _jump(codes: NDArray[np.int64], knees: NDArray[Any], per_rel: NDArray[Any]) -> tuple[float, float] | None:
    """Return the jump of the density at the middle of three knees, in logarithms, and its variance; None if unknown.

    Parameters
    ----------
    codes : ndarray of int, shape (n,)
        Pixels by code.
    knees : ndarray, shape (3,)
        Codes of the knee and of its neighbours.
    per_rel : ndarray, shape (2,)
        Codes for a relative change of the linear value of 1, below and above the knee.
    """
    at = int(knees[1])
    for near_rel, least, scene in _SIDES:
        below, above = (int(min(near_rel * n, room - 1)) for n, room in zip(per_rel, np.diff(knees), strict=True))
        if min(below, above) < 1:
            continue
        # The knee itself belongs to both segments.
        n_below, n_above = int(codes[at - below : at].sum()), int(codes[at + 1 : at + 1 + above].sum())
        if min(n_below, n_above) >= least:
            jump = log(n_above / above) - log(n_below / below)
            return jump, scene**2 + 1 / n_below + 1 / n_above
    return None
