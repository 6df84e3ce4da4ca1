"""Exposure of each of 256 levels from the pixels of a bracket: OpenCV's curve, smoothed, and where its knots are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Method = Literal["debevec", "robertson"]

#: Levels of the methods: both are for 8 bits.
LEVELS = 256
#: Smoothness of Debevec's curve, the weight of its second derivative, and Robertson's rounds.
_LAMBDA, _ROUNDS = 20.0, 100
#: Levels around which the curve is smoothed by a parabola.
WINDOW = 11
#: Distance of two knots in parts of the DN above dark, and the most in levels: a straight line in between is then off
#: by 0.2 % at the most for a response of the power 2.2.
_KNOT_REL, _KNOT_STEP = 0.08, 8


def opencv_curve(levels: NDArray[np.uint8], exposures_s: Sequence[float], method: Method) -> NDArray[np.float64]:
    """Exposure of each level by OpenCV, shape (256,), without scale; `levels` has the shape (exposures, pixels)."""
    import cv2

    # OpenCV's Robertson reads three channels whatever it is given, and Debevec's samples are a square of pixels.
    n = levels.shape[1]
    images = [np.repeat(row[:, None, None], 3, axis=2) for row in levels]
    times = np.array(exposures_s, dtype=np.float32)
    if method == "debevec":
        process: Any = cv2.createCalibrateDebevec(samples=n, lambda_=_LAMBDA, random=False)
    else:
        process = cv2.createCalibrateRobertson(max_iter=_ROUNDS, threshold=1e-4)
    curve: NDArray[np.float64] = np.asarray(process.process(images, times=times), dtype=float).reshape(LEVELS, 3)[:, 0]
    # Levels that no pixel shows are not a number.
    known = np.flatnonzero(np.isfinite(curve) & (curve > 0))
    return np.interp(np.arange(LEVELS), known, curve[known])


def smoothed(curve: NDArray[np.float64], net_dn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Curve with its logarithm smoothed by parabolas (Savitzky-Golay), a power law taken off before; rising."""
    from scipy.signal import savgol_filter

    values, x = np.log(np.maximum(curve, 1e-30)), np.log(net_dn)
    law = np.polyval(np.polyfit(x, values, 1), x)
    window = min(WINDOW, (values.size - 1) // 2 * 2 + 1)
    if window > 2:
        values = law + savgol_filter(values - law, window, 2)
    return rising(np.exp(values))


def rising(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Make it rise: where the curve falls, by a millionth from knot to knot."""
    steps = 1 + 1e-6 * np.arange(values.size)
    risen: NDArray[np.float64] = np.maximum.accumulate(values) * steps
    return risen


def knot_levels(first: int, last: int, net_dn: NDArray[np.float64]) -> NDArray[np.intp]:
    """Levels from `first` to `last` to put knots at, given the DN above dark of all levels."""
    knots = [first]
    while knots[-1] < last:
        step = net_dn[knots[-1]] * _KNOT_REL / (net_dn[1] - net_dn[0])
        knots.append(min(knots[-1] + int(np.clip(step, 1, _KNOT_STEP)), last))
    return np.array(knots, dtype=np.intp)
