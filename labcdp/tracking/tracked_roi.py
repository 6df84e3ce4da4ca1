"""What is found of a region in a frame, and the base of what follows it."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.errors import InputError
from ..core.result import Finding, FindingValue, warning
from ..core.roi import Roi
from .geometry import Matrix, inverse
from .template import Template


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
    reasons : tuple of Finding
        Why it is lost.

    Examples
    --------
    >>> from labcdp.core.roi import Roi
    >>> from labcdp.tracking import TrackedRoi
    >>> TrackedRoi(Roi.rectangle("sign", 0, 0, 9, 9), quality=0.98, lost=False).lost
    False
    """

    roi: Roi
    quality: float
    lost: bool
    reasons: tuple[Finding, ...] = ()


class NotFollowedError(InputError):
    """A region cannot be followed: nothing in and around it fixes its place.

    Examples
    --------
    >>> from labcdp.tracking import NotFollowedError
    >>> NotFollowedError("sky").region
    'sky'
    """

    def __init__(self, region: str) -> None:
        super().__init__(
            f"region {region!r} cannot be followed: neither it and its surroundings nor the rest of the image have "
            "enough structure in both directions; choose one with edges or texture nearby, or the method 'fixed'"
        )
        self.region = region


class RegionState:
    """A region and its template, with what is found of it in each frame.

    Parameters
    ----------
    template : Template
        The region in the first frame.
    """

    def __init__(self, template: Template) -> None:
        self._template, self._first = template, template.roi
        self._from_first = inverse(template.to_image)
        self._to_image = template.to_image
        #: Findings of this frame.
        self.result = TrackedRoi(template.roi, 1.0, False)

    @property
    def motion(self) -> Matrix:
        """Pixels of the first frame to those of the frame in which it was last seen."""
        motion: Matrix = self._to_image @ self._from_first
        return motion

    def _finding(self, code: str, **values: FindingValue) -> Finding:
        return warning(code, self._first.name, **values)
