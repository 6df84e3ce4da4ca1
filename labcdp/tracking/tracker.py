"""What a tracker takes and returns, and the choice among the methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.finding import Finding
from ..core.roi import Roi


@dataclass(frozen=True)
class TrackedRoi:
    """A region in one frame.

    Parameters
    ----------
    roi : Roi
        Where the region is now; where it was last seen while it is lost. It lies inside the image.
    quality : float
        Share of the structure around the region that is found again where it should be, 0 to 1: see
        `labcdp.tracking.align.alignment.Fit`.
    lost : bool
        True if nothing should be measured here in this frame.
    reasons : tuple of Finding
        Why it is lost.
    """

    roi: Roi
    quality: float
    lost: bool
    reasons: tuple[Finding, ...] = ()


class NotFollowedError(InputError):
    """A region cannot be followed: nothing in and around it fixes its place."""

    def __init__(self, region: str) -> None:
        super().__init__(
            f"region {region!r} cannot be followed: neither it and its surroundings nor the rest of the image have "
            "enough structure in both directions; choose one with edges or texture nearby, or the method fixed"
        )
        self.region = region


class Tracker(Protocol):
    """Follows regions through a video."""

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
        ...


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
