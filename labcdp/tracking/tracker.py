"""What a tracker takes and returns, and the choice among the methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..roi import Roi

#: Ways to follow regions: see `make_tracker`.
METHODS = ("kcf", "csrt", "flow", "homography", "fixed")


@dataclass(frozen=True)
class TrackedRoi:
    """A region in one frame.

    Parameters
    ----------
    roi : Roi
        Where the region is now; where it was last seen while it is lost. It lies inside the image.
    quality : float
        Share of the structure around the region that is found again where it should be, 0 to 1: see
        `labcdp.tracking.alignment.Fit`.
    lost : bool
        True if nothing should be measured here in this frame.
    reason : str
        Why it is lost; else what else is to be known about this frame, or empty.
    """

    roi: Roi
    quality: float
    lost: bool
    reason: str


class Tracker(Protocol):
    """Follows regions through a video."""

    def update(self, grey: NDArray[np.uint8]) -> tuple[TrackedRoi, ...]:
        """Find the regions in the next frame; one result a region, in the order given at the start.

        Parameters
        ----------
        grey : ndarray of uint8, shape (height, width)
            The next frame, of the first one's size.

        Raises
        ------
        InputError
            If the frame is not of type uint8 or of another size.
        """
        ...


def make_tracker(method: str, grey: NDArray[np.uint8], rois: Sequence[Roi]) -> Tracker:
    """Make a tracker that has seen the first frame.

    Parameters
    ----------
    method : str
        ``kcf``: kernelised correlation filter; fast. ``csrt``: correlation filter with spatial reliability; slow, for
        large jumps from frame to frame. ``flow``: optical flow of points around the region. ``homography``: as
        ``flow``, but also follows a flat target that tilts. The four share a search and an alignment with the first
        frame that decide, so that nothing drifts. ``fixed``: regions stay where they are, and are never lost.

        What can be followed are edges: those of the patch a region lies in, and structure around it that moves
        with it. A uniform thing without any, before a background that moves otherwise, is followed badly. Where
        several places look the same, as on a checkerboard, the one nearest to the expected place is taken; a jump
        by whole squares between two frames is not seen, and a square that was lost for more
        than two frames stays lost unless another region tells where it is. A region is lost if more than 5 % of it
        are covered; less is not noticed, nor is something put in its place with the same outline and other levels.
        Noise above about 40 % of the contrast may shift places by some pixels.
    grey : ndarray of uint8, shape (height, width)
        First frame.
    rois : sequence of Roi
        Regions in it.

    Returns
    -------
    Tracker

    Raises
    ------
    InputError
        If the method is unknown, the frame is not of type uint8, a region does not lie in the image or there is
        nothing to follow in and around it (every method but ``fixed``), or two regions have one name.
    """
    if method not in METHODS:
        raise InputError(f"unknown tracking method {method!r}: give one of {', '.join(METHODS)}")
    first = grey_frame(grey)
    if not rois:
        raise InputError("there is no region to follow: give at least one")
    names = [roi.name for roi in rois]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{names.count(name)} regions are called {name!r}: give each a name of its own")
    for roi in rois:
        roi.mask((first.shape[0], first.shape[1]))
    if method == "fixed":
        from .fixed import FixedTracker

        return FixedTracker(first, rois)
    from .following import FollowingTracker

    return FollowingTracker(method, first, rois)


def grey_frame(grey: NDArray[Any], shape: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """Check a frame, also for its `shape` if that is given, and return it."""
    array = np.asarray(grey)
    if array.ndim != 2 or array.dtype != np.uint8:
        raise InputError(
            f"a frame to track in has shape {array.shape} and type {array.dtype}: give a grey image of two dimensions "
            "and 8 bit (uint8)"
        )
    if shape is not None and array.shape != shape:
        raise InputError(
            f"a frame has {array.shape[1]} x {array.shape[0]} pixels, the first one had {shape[1]} x {shape[0]}: "
            "start anew where the size changes"
        )
    # Frames of video files cannot be written to; if none can, compiled loops see one type only.
    frame = np.ascontiguousarray(array).view()
    frame.flags.writeable = False
    return frame
