"""The choice among the methods to follow regions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.roi import Roi
from .fixed import FixedTracker
from .following import FollowingTracker
from .tracker import TrackedRoi, Tracker, grey_frame

#: Ways to follow regions: see `make_tracker`.
METHODS = ("follow", "homography", "fixed")


def methods_of(method: str, names: Sequence[str]) -> tuple[str, ...]:
    """Say which method each region has.

    Parameters
    ----------
    method : str
        One of `METHODS` for all, or with others for some regions: ``"follow,wall=fixed"``.
    names : sequence of str
        Names of the regions.

    Raises
    ------
    InputError
        If a method or a region is unknown.
    """
    parts = [part.strip() for part in method.split(",")]
    general = next((part for part in parts if "=" not in part), METHODS[0])
    own: dict[str, str] = {}
    for part in parts:
        name, given, value = part.rpartition("=")
        if value not in METHODS or (not given and part != general):
            raise InputError(
                f"unknown tracking method {part!r}: give one of {', '.join(METHODS)}, or for one region NAME=METHOD"
            )
        if given:
            own[name] = value
    for name in own:
        if name not in names:
            raise InputError(f"method {method!r} names region {name!r}: the regions are {', '.join(names)}")
    return tuple(own.get(name, general) for name in names)


def method_among(method: str, names: Sequence[str], chosen: Sequence[str]) -> str:
    """Return the method of some of the regions as `methods_of` takes it for these alone.

    Parameters
    ----------
    method, names
        As for `methods_of`, of all regions.
    chosen : sequence of str
        Names of those that are followed.

    Raises
    ------
    InputError
        If a method or a region is unknown.
    """
    found = dict(zip(names, methods_of(method, names), strict=True))
    own = [found[name] for name in chosen]
    return own[0] if len(set(own)) == 1 else ",".join(f"{name}={found[name]}" for name in chosen)


def make_tracker(method: str | Sequence[str], grey: NDArray[Any], rois: Sequence[Roi]) -> Tracker:
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

    Returns
    -------
    Tracker

    Raises
    ------
    InputError
        If the method is unknown, the frame is not of one of these types, a region does not lie in the image or there is
        nothing to follow in and around it (every method but ``fixed``), or two regions have one name.
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
    followed = [number for number, one in enumerate(methods) if one != "fixed"]
    if not followed:
        return FixedTracker(first, rois)
    planar = [methods[number] == "homography" for number in followed]
    moving = FollowingTracker(first, [rois[number] for number in followed], planar)
    if len(followed) == len(rois):
        return moving
    return _Mixed(
        moving, followed, FixedTracker(first, [roi for roi, one in zip(rois, methods, strict=True) if one == "fixed"])
    )


class _Mixed:
    """Some regions followed, and others fixed."""

    def __init__(self, moving: Tracker, followed: list[int], fixed: Tracker) -> None:
        self._moving, self._followed, self._fixed = moving, followed, fixed

    def update(self, grey: NDArray[Any]) -> tuple[TrackedRoi, ...]:
        """Find the regions in the next frame; see `Tracker`."""
        result = list(self._fixed.update(grey))
        for number, found in zip(self._followed, self._moving.update(grey), strict=True):
            result.insert(number, found)
        return tuple(result)
