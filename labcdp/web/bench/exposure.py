"""An exposure that fills the range of the converter."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.roi import Roi
from .live_camera import LiveCamera

#: Where the brightest pixels should be, as a share of the converter's range.
TARGET = 0.8
#: Shares of the range within which an exposure is good enough.
_GOOD = (0.7, 0.9)
#: Quantile that stands for the brightest pixels: single hot ones do not count.
_BRIGHTEST = 0.99
#: Step while pixels are saturated and nothing can be computed.
_STEP = 0.25
#: Attempts to fit the exposure, time for a frame with the new one, and how often it is looked for.
_MOST_ATTEMPTS, _ATTEMPT_S, _LOOK_S = 10, 20.0, 0.5


def better_exposure_s(
    values: NDArray[Any], exposure_s: float, bit_depth: int, limits_s: tuple[float, float]
) -> float | None:
    """Compute an exposure with which the brightest pixels are nearer to 80 % of the range.

    The black level is unknown and counted as light: a dark image needs several steps.

    Parameters
    ----------
    values : ndarray of int
        DN of the pixels that matter.
    exposure_s : float
        Exposure with which they were taken.
    bit_depth : int
        Bits of a DN.
    limits_s : (float, float)
        Shortest and longest exposure of the camera.

    Returns
    -------
    float or None
        The exposure; None if the present one is good, or no other is possible.
    """
    highest = 2.0**bit_depth - 1
    brightest = float(np.quantile(values, _BRIGHTEST))
    share = brightest / highest
    if _GOOD[0] <= share <= _GOOD[1]:
        return None
    factor = _STEP if share > 0.99 else TARGET * highest / max(brightest, 1.0)
    wanted_s = float(np.clip(exposure_s * factor, *limits_s))
    return None if np.isclose(wanted_s, exposure_s, rtol=0.01) else wanted_s


def fit_exposure(camera: LiveCamera, rois: Callable[[], Sequence[Roi]]) -> Iterator[str]:
    """Change the exposure of a camera until the brightest region, or the image, fills the range; yield what failed."""
    for _ in range(_MOST_ATTEMPTS):
        live = camera.live
        if live.frame is None or live.settings is None:
            break
        frame = live.frame
        inside = [roi.select(frame.dn) for roi in rois()] or [frame.dn.ravel()]
        brightest = max(inside, key=lambda values: float(values.mean()))
        better_s = better_exposure_s(brightest, frame.exposure_s, frame.bit_depth, live.exposure_range_s)
        if better_s is None:
            yield ""
            return
        camera.request(exposure_s=better_s)
        if not _has_another_exposure(camera, frame.exposure_s):
            yield "The exposure cannot be fitted: the camera does not take it"
            return
    yield "The exposure cannot be fitted: there is too much or too little light"


def _has_another_exposure(camera: LiveCamera, exposure_s: float) -> bool:
    """Wait for a frame with another exposure; False if none comes."""
    until_s = monotonic() + _ATTEMPT_S
    while (live := camera.live).frame is None or live.frame.exposure_s == exposure_s:
        if live.error or monotonic() > until_s:
            return False
        camera.wait_for_news(live, _LOOK_S)
    return True
