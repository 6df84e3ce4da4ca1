"""Trackers: what they are made of, and how regions at rest are compared."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.roi import Roi
from .frame import Levels
from .group import RegionGroup
from .methods import methods_of
from .tracked_roi import TrackedRoi

#: Pixels around a region at rest that are compared with the first frame.
_MARGIN_PX = 8


def make_tracker(
    method: str | Sequence[str],
    grey: NDArray[Any],
    rois: Sequence[Roi],
    levels: Levels = (0.0, nan, 0.0),
) -> Tracker:
    """Make a tracker that has seen the first frame.

    Parameters
    ----------
    method : str or sequence of str
        ``follow``: regions move, turn and change their size with their objects, which may slowly change their looks.
        ``homography``: as ``follow``, but also for a flat target that tilts. ``fixed``: regions stay where they are,
        and are never lost. Other methods for some regions: ``"follow,wall=fixed"``, or one for each.

        What can be followed are edges: those of the patch a region lies in, and structure around it that moves
        with it. A plain region of a larger background stays in the scene, whose points tell where that is. Where
        several places look the same, as on a checkerboard, the one nearest to the expected place is taken; a jump
        by whole squares between two frames is not seen, and a square that was lost stays lost if it may have moved
        by half the distance meanwhile, unless another region tells where it is. A region is lost if more than 5 % of
        it are covered; less is not noticed, nor is something put in its place with the same outline and other levels.
    grey : ndarray of uint8 or uint16, shape (height, width)
        First frame.
    rois : sequence of Roi
        Regions in it.
    levels : (float, float, float)
        Black level of the frames; steps of 8 bits for each of theirs; and contrast in these steps (standard deviation)
        below which a codec may leave a thing where it was although it moves, 0 if none changed the frames: 16, 255/219
        and 4 of limited Y' in H.264. Steps of nan if of more bits the noise is to decide, as it should without a codec.

    Returns
    -------
    Tracker

    Raises
    ------
    InputError
        If the method is unknown, the frame is not of one of these types, a region does not lie in the image or there is
        nothing to follow in and around it (every method but ``fixed``), or two regions have one name.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from labcdp.core.roi import Roi
    >>> from labcdp.tracking import make_tracker
    >>> noise = np.random.default_rng(1).integers(0, 255, (120, 160), dtype=np.uint8)
    >>> scene = cv2.GaussianBlur(noise, (9, 9), 0)
    >>> tracker = make_tracker("follow", scene, [Roi.rectangle("sign", 60, 40, 30, 30)])
    >>> (found,) = tracker.update(np.roll(scene, 3, axis=1))
    >>> round(found.roi.centre[0])
    78
    """
    names = [roi.name for roi in rois]
    methods = methods_of(method, names) if isinstance(method, str) else tuple(method)
    first = grey_frame(grey)
    if not rois:
        raise InputError("there is no region to follow: give at least one")
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{names.count(name)} regions are called {name!r}: give each a name of its own")
    for roi in rois:
        roi.mask((first.shape[0], first.shape[1]))
    return Tracker(first, rois, methods, levels)


class Tracker:
    """Finds regions in frame after frame; made by `make_tracker`.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp import Roi
    >>> from labcdp.tracking import Tracker, make_tracker
    >>> frame = np.full((120, 160), 100, np.uint8)
    >>> tracker: Tracker = make_tracker("fixed", frame, [Roi.rectangle("sign", 60, 40, 30, 30)])
    >>> tracker.update(frame)[0].roi.centre
    (75.0, 55.0)
    """

    def __init__(self, first: NDArray[Any], rois: Sequence[Roi], methods: Sequence[str], levels: Levels) -> None:
        self._shape, self._dtype = (first.shape[0], first.shape[1]), first.dtype
        self._fixed = [
            _Fixed(first, roi) if method == "fixed" else None for roi, method in zip(rois, methods, strict=True)
        ]
        followed = [
            (roi, method == "homography") for roi, method in zip(rois, methods, strict=True) if method != "fixed"
        ]
        self._following = RegionGroup(first, levels, *zip(*followed, strict=True)) if followed else None

    def update(self, grey: NDArray[Any]) -> tuple[TrackedRoi, ...]:
        """Find the regions in the next frame; one result a region, in the order given at the start.

        Parameters
        ----------
        grey : ndarray of uint8 or uint16, shape (height, width)
            The next frame, of the first one's size and type.

        Raises
        ------
        InputError
            If the frame is of another type or size.
        """
        frame = grey_frame(grey, self._shape, self._dtype)
        moving = iter(() if self._following is None else self._following.update(frame))
        return tuple(next(moving) if one is None else one.seen_in(frame) for one in self._fixed)


class _Fixed:
    """A region that stays in place; its quality is the correlation with the first frame, and it is never lost.

    This assumes that nothing moves: changes in place are those of the light or of the measured quantity.
    """

    def __init__(self, first: NDArray[Any], roi: Roi) -> None:
        rows, columns = roi.window((first.shape[0], first.shape[1]))
        top, left = (max(one.start - _MARGIN_PX, 0) for one in (rows, columns))
        self._roi = roi
        self._window = slice(top, rows.stop + _MARGIN_PX), slice(left, columns.stop + _MARGIN_PX)
        self._first = _deviations(first[self._window])

    def seen_in(self, frame: NDArray[Any]) -> TrackedRoi:
        """Compare a frame with the first one."""
        return TrackedRoi(self._roi, _correlation(self._first, _deviations(frame[self._window])), False)


def grey_frame(
    grey: NDArray[Any], shape: tuple[int, int] | None = None, dtype: np.dtype[Any] | None = None
) -> NDArray[Any]:
    """Check a frame, also for its `shape` and type if those are given, and return it."""
    array = np.asarray(grey)
    if array.ndim != 2 or array.dtype not in ((np.uint8, np.uint16) if dtype is None else (dtype,)):
        raise InputError(
            f"a frame to track in has shape {array.shape} and type {array.dtype}: give a grey image of two dimensions "
            f"and type {'uint8 or uint16' if dtype is None else dtype}"
        )
    if shape is not None and array.shape != shape:
        raise InputError(
            f"a frame has {array.shape[1]} x {array.shape[0]} pixels, the first one had {shape[1]} x {shape[0]}: "
            "start again where the size changes"
        )
    return array


def _deviations(pixels: NDArray[Any]) -> NDArray[np.float32]:
    values = pixels.astype(np.float32)
    deviations: NDArray[np.float32] = values - np.float32(values.mean(dtype=np.float64))
    return deviations


def _correlation(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    """Correlation of two images of mean 0, nothing below 0; 1 if both are constant, 0 if one is."""
    power_a, power_b = float(np.vdot(a, a)), float(np.vdot(b, b))
    if power_a == 0 or power_b == 0:
        return 1.0 if power_a == power_b else 0.0
    correlation = float(np.vdot(a, b)) / float(np.sqrt(power_a * power_b))
    return min(max(correlation, 0.0), 1.0)
