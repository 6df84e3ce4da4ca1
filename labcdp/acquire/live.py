"""Live numbers: what the frames of one exposure say of each patch, computed as they come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame
from ..roi import Roi
from ..session import Role

#: Below this share of the span from black to saturation, a change relative to the signal says nothing.
_LEAST_SIGNAL_REL = 0.01


@dataclass(frozen=True)
class PatchNumbers:
    """One patch in the frames of one exposure so far.

    Parameters
    ----------
    patch : str
        Its name.
    exposure_s : float
        Exposure time in seconds.
    frames, pixels : int
        How many frames, and pixels in each.
    mean_dn : float
        Mean over frames and pixels.
    black_dn, saturation_dn : float
        The camera's nominal black, and where it saturates.
    saturated_share : float
        Share of the values at saturation or above.
    temporal_noise_dn : float or None
        Standard deviation of one pixel from frame to frame, from differences of successive frames (EMVA 1288
        Release 4.0, pairs of images); None for one frame.
    flicker_dn : float or None
        Standard deviation of the region's mean from frame to frame, from successive differences (J. von Neumann
        et al., Ann. Math. Stat. 12 (1941) 153), so that a slow drift does not count; None for one frame.
    drift_dn : float or None
        Change of the region's mean from the first to the last frame, by the least-squares line; None for one.
    """

    patch: str
    exposure_s: float
    frames: int
    pixels: int
    mean_dn: float
    black_dn: float
    saturation_dn: float
    saturated_share: float
    temporal_noise_dn: float | None
    flicker_dn: float | None
    drift_dn: float | None

    @property
    def signal_dn(self) -> float:
        """Mean above the nominal black."""
        return self.mean_dn - self.black_dn

    @property
    def drift_rel(self) -> float | None:
        """Drift relative to the signal; None for one frame, or next to no signal."""
        return self._relative(self.drift_dn)

    @property
    def flicker_rel(self) -> float | None:
        """Flicker relative to the signal; None for one frame, or next to no signal."""
        return self._relative(self.flicker_dn)

    def _relative(self, change_dn: float | None) -> float | None:
        if change_dn is None or self.signal_dn < _LEAST_SIGNAL_REL * (self.saturation_dn - self.black_dn):
            return None
        return change_dn / self.signal_dn


@dataclass(frozen=True)
class Live:
    """What is known of the exposure that is being taken.

    Parameters
    ----------
    role : {'light', 'dark'}
        Whether the target is seen.
    exposure_s : float
        Exposure time in seconds.
    patches : tuple of PatchNumbers
        Those the camera sees, in the target's order.
    temperature_c : float or None
        The camera's, with the last frame.
    finished : bool
        Whether this was the last frame of the exposure.
    """

    role: Role
    exposure_s: float
    patches: tuple[PatchNumbers, ...]
    temperature_c: float | None
    finished: bool = False


class LiveNumbers:
    """Takes the frames of one exposure one by one; holds the regions' last values only.

    Parameters
    ----------
    regions : sequence of Roi
        The patches the camera sees.
    """

    def __init__(self, regions: Sequence[Roi]) -> None:
        self._patches = [_PatchAccumulator(region) for region in regions]

    def add(self, frame: Frame) -> tuple[PatchNumbers, ...]:
        """Take one frame and return the numbers so far.

        Raises
        ------
        InputError
            If a region lies outside the frame.
        """
        for patch in self._patches:
            patch.add(frame)
        return self.numbers

    @property
    def numbers(self) -> tuple[PatchNumbers, ...]:
        """The numbers so far; none before the first frame."""
        return tuple(numbers for patch in self._patches if (numbers := patch.numbers) is not None)


class RegionPixels:
    """A region's pixels of many frames of one size; finds out where they are once.

    Parameters
    ----------
    region : Roi
        The region.
    """

    def __init__(self, region: Roi) -> None:
        self._region = region
        self._shape: tuple[int, int] | None = None
        self._window: tuple[slice, slice] = (slice(0), slice(0))
        self._mask: NDArray[np.bool_] | None = None

    def of(self, frame: Frame) -> NDArray[np.unsignedinteger[Any]]:
        """Return the values, shape (n,), as a copy of their own; raises InputError as `Roi.mask`."""
        if frame.shape != self._shape:
            mask = self._region.mask(frame.shape)
            self._window, self._shape = self._region.window(frame.shape), frame.shape
            self._mask = None if mask.all() else mask
        window = frame.dn[self._window]
        return window.flatten() if self._mask is None else window[self._mask]


class _PatchAccumulator:
    def __init__(self, region: Roi) -> None:
        self._name = region.name
        self._pixels = RegionPixels(region)
        self._last: NDArray[np.float32] | None = None
        self._last_mean = 0.0
        self._n = 0
        self._exposure_s = self._black_dn = self._saturation_dn = 0.0
        # Sums over frames: of means, of means times the frame's index, of saturated shares; over pairs: of
        # variances of the difference, of squared differences of the means.
        self._means = self._weighted = self._saturated = self._variances = self._squares = 0.0

    def add(self, frame: Frame) -> None:
        values = self._pixels.of(frame)
        mean = float(values.mean(dtype=np.float64))
        kept = values.astype(np.float32)
        if self._last is not None:
            difference = kept - self._last
            shift = float(difference.mean(dtype=np.float64))
            self._variances += max(float(np.dot(difference, difference)) / difference.size - shift**2, 0.0)
            self._squares += (mean - self._last_mean) ** 2
        self._saturated += np.count_nonzero(values >= frame.saturation_dn) / values.size
        self._weighted += self._n * mean
        self._means += mean
        self._n += 1
        self._exposure_s = frame.exposure_s
        self._black_dn, self._saturation_dn = frame.black_level_dn, frame.saturation_dn
        self._last, self._last_mean = kept, mean

    @property
    def numbers(self) -> PatchNumbers | None:
        if self._last is None:
            return None
        n, pairs = self._n, self._n - 1
        mean_dn = self._means / n
        # Least squares on the index 0 .. n - 1, whose squared deviations sum to n (n^2 - 1) / 12.
        slope = (self._weighted - self._means * (n - 1) / 2) * 12 / (n * (n**2 - 1)) if pairs else 0.0
        return PatchNumbers(
            patch=self._name,
            exposure_s=self._exposure_s,
            frames=n,
            pixels=self._last.size,
            mean_dn=mean_dn,
            black_dn=self._black_dn,
            saturation_dn=self._saturation_dn,
            saturated_share=self._saturated / n,
            temporal_noise_dn=sqrt(self._variances / pairs / 2) if pairs else None,
            flicker_dn=sqrt(self._squares / pairs / 2) if pairs else None,
            drift_dn=slope * pairs if pairs else None,
        )
