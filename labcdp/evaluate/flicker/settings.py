"""Settings of the flicker of regions of a video."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from ...core.disk.files import shown
from ...core.errors import InputError
from ..video.settings import VideoSettings


@dataclass(frozen=True)
class FlickerSettings(VideoSettings):
    """Settings of the flicker of regions of a video; regions, tracking and light are those of `VideoSettings`.

    Parameters
    ----------
    off_frames : (int, int) or None
        First frame with the lamp off, and the one before which such frames end, by their numbers; None for none. They
        give the light without the lamp, and do not count otherwise. They may be before the first evaluated frame:
        the regions are then taken where they are in that one.
    threshold, tolerance : float
        As of `labcdp.flicker`, fractions.
    frequency_hz : float or None
        Frequency of the lamp, where it is known.

    Raises
    ------
    InputError
        If there is no region, or a value is out of its range.

    Examples
    --------
    >>> from labcdp import Roi
    >>> from labcdp.evaluate.flicker.settings import FlickerSettings
    >>> FlickerSettings(rois=(Roi.rectangle("lamp", 0, 0, 8, 8),), method="fixed", off_frames=(0, 25)).tolerance
    0.1
    """

    off_frames: tuple[int, int] | None = None
    threshold: float = 0.1
    tolerance: float = 0.1
    frequency_hz: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("threshold", "tolerance", "frequency_hz"):
            value = getattr(self, name)
            if value is None and name == "frequency_hz":
                continue
            if isinstance(value, bool) or not isinstance(value, int | float) or not (isfinite(value) and value > 0):
                raise InputError(f"{name} is {shown(value)}: give a number above 0")
        if self.off_frames is not None:
            first, stop = self.off_frames
            if not 0 <= first < stop:
                raise InputError(f"off_frames is {first}:{stop}: give the first frame and the one after the last")

    def _check_number(self) -> None:
        if not self.rois:
            raise InputError("no regions: give those whose flicker is evaluated")


def off_frames_error(first: int, stop: int, first_frame: int, last_frame: int) -> InputError:
    """Return the error of frames with the lamp off that are none of a video's, or all."""
    return InputError(
        f"off_frames is {first}:{stop}, but the frames are {first_frame} to {last_frame}: give some of them"
    )
