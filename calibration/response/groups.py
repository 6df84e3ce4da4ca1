"""Averages of a bracket's pixels in groups of equal brightness, to reduce the bias by noise."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import log, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.response import Response

_Array = NDArray[np.floating[Any]]

#: Most groups, as the cost of Debevec's equations grows with the cube; and fewest pixels of one.
_MOST_GROUPS, _LEAST_PIXELS = 300, 10
#: Brightness range relative to neighbouring groups above which a group mixes two areas of the scene.
_MIXED, _NEIGHBOURS = 4.0, 21
#: Parts of the range, of equal ratio, that the residual is averaged over.
_CELLS = 24


def group_pixels(dn: _Array) -> _Array:
    """Average pixels of about one brightness: mean DN, shape (exposures, groups).

    Groups much less uniform than those of neighbouring brightness are left out: they mix areas of the scene, and their
    mean does not follow the response.

    Parameters
    ----------
    dn : ndarray of float, shape (exposures, pixels)
        Pixels of the bracket.
    """
    from scipy.ndimage import median_filter

    brightness = dn.sum(axis=0)
    order = np.argsort(brightness, kind="stable")
    members = np.array_split(order, min(_MOST_GROUPS, max(order.size // _LEAST_PIXELS, 1)))
    spans = np.array([brightness[m[-1]] - brightness[m[0]] for m in members])
    even = spans <= _MIXED * np.maximum(median_filter(spans, _NEIGHBOURS, mode="nearest"), 1.0)
    return np.array([dn[:, m].mean(axis=1) for m, keep in zip(members, even, strict=True) if keep]).T


def residual_rel(
    net_dn: _Array, exposures_s: Sequence[float], response: Response, limits: tuple[float, float]
) -> float:
    """Root mean square deviation of neighbouring exposures from the response over the signals.

    Parameters
    ----------
    net_dn : ndarray of float, shape (exposures, groups)
        DN of the groups above dark.
    exposures_s : sequence of float
        Of the frames.
    response : Response
        To be judged.
    limits : (float, float)
        DN above dark that count.

    Raises
    ------
    CalibrationError
        If no group is within the limits at two exposures.
    """
    means = []
    for i, j in pairwise(range(len(exposures_s))):
        a, b = net_dn[i], net_dn[j]
        both = (a >= limits[0]) & (b <= limits[1])
        a, b = a[both], b[both]
        deviation = np.log(response.linearise(b) / response.linearise(a) * exposures_s[i] / exposures_s[j])
        cell = (_CELLS * np.log(b / limits[0]) / log(limits[1] / limits[0])).astype(int)
        number = np.bincount(cell)
        means.append((np.bincount(cell, deviation) / np.maximum(number, 1))[number > 0])
    squares = np.square(np.concatenate(means))
    if not squares.size:
        raise CalibrationError("no brightness is seen at two exposures: take exposures in between, a factor of 2 to 4")
    return sqrt(float(squares.mean()))
