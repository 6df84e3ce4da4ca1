"""What is to be evaluated of a video."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..contrast import Epsilon
from ..contrast.interval import AskedContrast
from ..errors import InputError
from ..roi import Roi
from ..sources.video_selection import Selection
from ..tracking import METHODS, TrackedRoi

#: Called for each evaluated frame: its number, the frame in 8 bits, where the regions are in it, and its results by
#: the names they have in the dataset. Its regions are none from pixel to pixel.
Observer: TypeAlias = Callable[[int, NDArray[np.uint8], Sequence[TrackedRoi], Mapping[str, Any]], None]
#: Called with the frames that are done, and how many there are going to be as far as that is known.
Progress: TypeAlias = Callable[[int, "int | None"], None]
#: A measured contrast; that of the first frame; or the results of another video, by a calibrated camera for example.
Reference: TypeAlias = "float | Literal['first'] | Path"


@dataclass(frozen=True)
class VideoSettings:
    """What is to be evaluated of a video; can be sent to another process.

    Parameters
    ----------
    contrasts : tuple of float
        Contrasts to be detected, fractions; at least one, none twice.
    rois : tuple of Roi
        The two regions in the first frame of the selection; none for pixel to pixel.
    method : str
        How the regions are followed: one of `labcdp.tracking.METHODS`.
    epsilon : float or DetectionInterval
        Tolerance of the contrasts.
    reference : float, 'first', Path or None
        Contrast that each frame is compared with besides: a measured one, that of the first frame in which the regions
        are seen, or that in the results of another video, for the frame of the same number or time.
    reference_by : {'number', 'time'}
        How the frames of the other video are matched.
    selection : Selection
        Which frames.
    calibration, camera : Path or None
        Calibration file, or camera specification; at most one. Neither for relative values.
    encoding : {'linear', 'srgb'} or None
        How values follow light; None for in proportion, or as the camera specification says.
    image_size : (int, int) or None
        Width and height of the image the regions were drawn on, which must be those of the frames; None if not known.
    exposure_s, gain_db, bit_depth : float or int or None
        Of the video; they count before what it or the calibration says. Bits are those of 16-bit values.

    Raises
    ------
    InputError
        If something is out of range or does not fit together.
    """

    contrasts: tuple[float, ...]
    rois: tuple[Roi, ...] = ()
    method: str = "kcf"
    epsilon: Epsilon = 0.5
    reference: Reference | None = None
    reference_by: Literal["number", "time"] = "number"
    selection: Selection = field(default_factory=Selection)
    calibration: Path | None = None
    camera: Path | None = None
    encoding: Literal["linear", "srgb"] | None = None
    image_size: tuple[int, int] | None = None
    exposure_s: float | None = None
    gain_db: float | None = None
    bit_depth: int | None = None

    def __post_init__(self) -> None:
        if not self.contrasts:
            raise InputError("no contrast is given: give at least one, for example 100%")
        for contrast in self.contrasts:
            AskedContrast(contrast, self.epsilon, "weber")
        if len(set(self.contrasts)) != len(self.contrasts):
            raise InputError("a contrast is given twice: give each once")
        if len(self.rois) not in (0, 2):
            raise InputError(f"{len(self.rois)} regions are given: give two, or none for pixel to pixel")
        if self.method not in METHODS:
            raise InputError(f"unknown tracking method {self.method!r}: give one of {', '.join(METHODS)}")
        if self.reference is not None and not self.rois:
            raise InputError("a reference contrast needs regions: give two, or give the contrast itself")
        if isinstance(self.reference, float):
            AskedContrast(self.reference, self.epsilon, "weber")

    @property
    def mode(self) -> Literal["regions", "neighbours"]:
        """Whether regions are compared, or pixels with their neighbours."""
        return "regions" if self.rois else "neighbours"
