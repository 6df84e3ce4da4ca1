"""Points of a photon or exposure series."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from ..frames.statistics import Level


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
        return self.light.temporal_variance_dn2 - self.dark.temporal_variance_dn2

    @property
    def variance_uncertainty_dn2(self) -> float:
        """Standard uncertainty of `net_variance_dn2`: the variance of a normal variance is 2 s^4 / dof."""
        return sqrt(sum(2 * level.temporal_variance_dn2**2 / level.dof for level in (self.light, self.dark)))

    @property
    def net_uncertainty_dn(self) -> float:
        """Standard uncertainty of `net_dn` by temporal noise, black level and lamp."""
        return sqrt(self.light.mean_variance_dn2 + self.dark.mean_variance_dn2 + self.frames_variance_dn2)


def columns(points: Sequence[object], *names: str) -> NDArray[np.float64]:
    """Values of points by the names of their attributes, which may be paths, one row for each name."""
    return np.array([[attrgetter(name)(point) for point in points] for name in names], dtype=np.float64)
