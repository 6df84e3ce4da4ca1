"""The contrast a video is compared with: measured, that of its first frame, or that of another camera's video."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.disk import file_sha256, reason
from ...core.errors import InputError
from ...core.finding import Finding, warning
from ...report.netcdf import read_dataset
from .settings import VideoSettings

#: How far the time of a frame of the other video may be off, in parts of the usual distance of its frames.
_NEAR = 0.5


class ReferenceContrast(Protocol):
    """Gives the contrast that a frame is compared with."""

    def of(self, number: int, time_s: float) -> tuple[float | None, Finding | None]:
        """Contrast for a frame, or why there is none; nothing of both if the frame itself decides."""

    def learn(self, contrast: float) -> None:
        """Take note of what was measured in a frame."""

    @property
    def sha256(self) -> str | None:
        """Hash of the file it comes from, None if it comes from none."""


class FixedReference:
    """One contrast for all frames: a measured one, or that of the first frame in which the regions are seen.

    Parameters
    ----------
    contrast : float or None
        The contrast; None for that of the first frame.
    """

    sha256 = None

    def __init__(self, contrast: float | None) -> None:
        self._contrast = contrast

    def of(self, number: int, time_s: float) -> tuple[float | None, Finding | None]:
        """Contrast, None as long as no frame was measured."""
        return self._contrast, None

    def learn(self, contrast: float) -> None:
        """Keep the first valid target contrast."""
        if self._contrast is None and isfinite(contrast) and contrast > 0:
            self._contrast = contrast


class VideoReference:
    """Contrast that another video measured in its frame of the same number or time.

    Parameters
    ----------
    path : Path
        Its results as NetCDF, as `labcdp video` wrote them.
    by : {'number', 'time'}
        What frames are matched by. By time, the nearest one counts, up to half the usual distance of its frames.

    Raises
    ------
    InputError
        If there are no such results at `path`, or they have no contrasts.
    """

    def __init__(self, path: Path, by: Literal["number", "time"]) -> None:
        dataset = _load(path)
        self.sha256 = file_sha256(path, "results.nc of another video")
        name = "frame" if by == "number" else "time_s"
        order = np.argsort(dataset[name], kind="stable")
        self._at: NDArray[np.float64] = dataset[name][order]
        self._contrasts: NDArray[np.float64] = dataset["measured_contrast"][order]
        self._by, self._path = by, path
        steps = np.diff(self._at)
        self._tolerance = 0.0 if by == "number" else _NEAR * float(np.median(steps)) if steps.size else 1e-3

    def of(self, number: int, time_s: float) -> tuple[float | None, Finding | None]:
        """Contrast, or why there is none."""
        at = number if self._by == "number" else time_s
        place = int(np.argmin(np.abs(self._at - at)))
        if abs(self._at[place] - at) > self._tolerance:
            if self._by == "time":
                return None, warning("reference-without-time", time_s=time_s)
            return None, warning("reference-without-frame", number=number)
        contrast = float(self._contrasts[place])
        if not (isfinite(contrast) and contrast > 0):
            return None, warning("reference-without-contrast")
        return contrast, None

    def learn(self, contrast: float) -> None:
        """Nothing: what this video measures does not matter."""


def make_reference(settings: VideoSettings) -> ReferenceContrast | None:
    """Make the requested reference, None for none; raises InputError as `VideoReference`."""
    reference = settings.reference
    if reference is None:
        return None
    if isinstance(reference, Path):
        return VideoReference(reference, settings.reference_by)
    return FixedReference(None if reference == "first" else float(reference))


def _load(path: Path) -> Mapping[str, NDArray[Any]]:
    """Frame numbers, times and contrasts of results on disk."""
    names = ("frame", "time_s", "measured_contrast")
    dataset = read_dataset(path, "result of another video")
    shapes = {name: dataset[name].shape if name in dataset.variables else () for name in names}
    if len(set(shapes.values())) != 1 or len(shapes["frame"]) != 1 or shapes["frame"][0] == 0:
        raise InputError(
            f"the reference {path} holds no contrasts of a video's frames: give results.nc that labcdp video wrote for "
            "two regions"
        )
    try:
        return {name: np.asarray(dataset[name].values, dtype=float) for name in names}
    except (ValueError, TypeError) as error:
        raise InputError(f"the reference {path} holds no numbers ({reason(error)}): give results.nc") from error
