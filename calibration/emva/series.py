"""Points of a photon or exposure series."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import sqrt
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from ..frames.rounding import ROUNDING_DN2
from ..frames.statistics import FrameStatistics


@dataclass(frozen=True)
class Level:
    """Values of the frames of one condition.

    Parameters
    ----------
    mean_dn, variance_dn2 : float
        Mean, and temporal variance of one pixel.
    n_pixels : int
        How many were averaged.
    frame_means_dn : tuple of float
        Mean of each frame.
    saturated_share, black_share : float
        Share of the values at the last DN of the scale or above saturation, and at DN 0.
    multiple : int
        Largest power of two that divides all values, up to 16.
    """

    mean_dn: float
    variance_dn2: float
    n_pixels: int
    frame_means_dn: tuple[float, ...]
    saturated_share: float = 0.0
    black_share: float = 0.0
    multiple: int = 1

    @classmethod
    def of(cls, s: FrameStatistics) -> Level:
        """Values of frame statistics, without their images."""
        names = (one.name for one in fields(cls) if one.name != "variance_dn2")
        return cls(variance_dn2=s.temporal_variance_dn2, **{name: getattr(s, name) for name in names})

    @property
    def n_frames(self) -> int:
        """How many frames were averaged."""
        return len(self.frame_means_dn)

    @property
    def dof(self) -> int:
        """Degrees of freedom of the variance."""
        return max((self.n_pixels - 1) * (self.n_frames - 1), 1)

    @property
    def mean_variance_dn2(self) -> float:
        """Variance of the mean by temporal noise, with 1/12 DN^2 of rounding as the least."""
        return max(self.variance_dn2, ROUNDING_DN2) / (self.n_pixels * self.n_frames)


@dataclass(frozen=True)
class SeriesPoint:
    """One point of a photon or exposure series: light and dark signal at one exposure.

    Parameters
    ----------
    label : str
        Patch of a session; empty for a data set.
    exposure_s : float
        Exposure time.
    photons : float or None
        Mean photons a pixel received; None if not known.
    light, dark : Level
        With light, and without.
    frames_variance_dn2 : float
        Variance of the signal above dark by what changes from frame to frame: black level and lamp.
    """

    label: str
    exposure_s: float
    photons: float | None
    light: Level
    dark: Level
    frames_variance_dn2: float = 0.0

    @property
    def stimulus(self) -> float:
        """Photons, or the exposure in seconds where they are not known."""
        return self.exposure_s if self.photons is None else self.photons

    @property
    def net_dn(self) -> float:
        """Mean above dark signal."""
        return self.light.mean_dn - self.dark.mean_dn

    @property
    def net_variance_dn2(self) -> float:
        """Temporal variance above that of dark signal."""
        return self.light.variance_dn2 - self.dark.variance_dn2

    @property
    def variance_uncertainty_dn2(self) -> float:
        """Standard uncertainty of `net_variance_dn2`: the variance of a normal variance is 2 s^4 / dof."""
        return sqrt(sum(2 * level.variance_dn2**2 / level.dof for level in (self.light, self.dark)))

    @property
    def net_uncertainty_dn(self) -> float:
        """Standard uncertainty of `net_dn` by temporal noise, black level and lamp."""
        return sqrt(self.light.mean_variance_dn2 + self.dark.mean_variance_dn2 + self.frames_variance_dn2)


def columns(points: Sequence[object], *names: str) -> NDArray[np.float64]:
    """Values of points by the names of their attributes, which may be paths, one row for each name."""
    return np.array([[attrgetter(name)(point) for point in points] for name in names], dtype=np.float64)
