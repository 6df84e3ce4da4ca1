"""Closed forms of CDP for normal patches, and published figures."""

import numpy as np
from scipy.stats import norm

#: Mean and deviation of the dark and of the bright patch, and CDP of their contrast at ε = 50 %.
NORMAL = [
    ((100, 5, 120, 5), 0.79940),
    ((100, 10, 120, 10), 0.47840),
    ((100, 20, 150, 25), 0.47971),
    ((50, 10, 60, 10), 0.25145),
    ((1000, 30, 1100, 35), 0.70136),
]


def share_of_normal(bright: tuple[float, float], dark: tuple[float, float], low: float, high: float) -> float:
    """Share of the pairs of two normal patches, each a mean and a deviation, whose contrast is from `low` to `high`."""
    ratio = 1 + np.array([low, high])
    below, up_to = norm.cdf((ratio * dark[0] - bright[0]) / np.hypot(ratio * dark[1], bright[1]))
    return float(up_to - below)
