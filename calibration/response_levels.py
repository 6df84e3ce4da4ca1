"""Exposure of each of 256 levels of DN by OpenCV, smoothed."""

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
#: Levels from one knot to the next.
_KNOT_STEP = 5


def level_of(net_dn: NDArray[np.floating[Any]], limits: tuple[float, float]) -> NDArray[np.uint8]:
    """Level of DN above dark: 1 to 254 between the limits in equal ratios, 0 and 255 beyond.

    In equal steps a response with a power, as cameras have it, would bend most where the least DN are.
    """
    low, high = limits
    place = np.log(np.maximum(net_dn, 1e-3 * low) / low) / np.log(high / low)
    level: NDArray[np.uint8] = np.clip(np.rint(1 + (LEVELS - 3) * place), 0, LEVELS - 1).astype(np.uint8)
    return level


def knots(curve: NDArray[np.float64], limits: tuple[float, float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """DN above dark and exposure at knots, the ends of the range among them, from the exposure of all levels."""
    inner = np.arange(1, LEVELS - 1)
    at = np.unique(np.append(inner[::_KNOT_STEP], inner[-1]))
    low, high = limits
    return low * (high / low) ** ((at - 1) / (LEVELS - 3)), _smoothed(curve[inner])[at - 1]


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


def _smoothed(curve: NDArray[np.float64]) -> NDArray[np.float64]:
    """Curve with its logarithm smoothed by parabolas (Savitzky-Golay), a straight line taken off before; rising."""
    from scipy.signal import savgol_filter

    values, x = np.log(curve), np.arange(curve.size)
    line = np.polyval(np.polyfit(x, values, 1), x)
    smooth = np.exp(line + savgol_filter(values - line, WINDOW, 2))
    # Where the curve falls it rises by a millionth from level to level.
    rising: NDArray[np.float64] = np.maximum.accumulate(smooth) * (1 + 1e-6 * x)
    return rising
