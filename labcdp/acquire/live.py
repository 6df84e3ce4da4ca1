"""Live statistics of each patch, updated with every frame of an exposure, and the black level they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import sqrt
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calibration.frames.statistics import MAX_CLIPPED_SHARE
from ..core.frame import Frame
from ..core.luminance import Window
from ..core.roi import Roi
from ..session import Role

#: Share of the span from black to saturation below which changes relative to the signal are meaningless.
_LEAST_SIGNAL_REL = 0.01

#: Distance of the rows and columns by which frames are compared, for speed: few pixels with noise never repeat.
_SAMPLED = 8


@dataclass(frozen=True)
class PatchNumbers:
    """Statistics of a patch over the frames of one exposure so far.

    Parameters
    ----------
    patch : str
        Its name.
    exposure_s : float
        Exposure time in seconds.
    frames, pixels : int
        Number of frames, and of pixels in each.
    mean_dn : float
        Mean over frames and pixels.
    black_dn : float
        Black level as measured so far, see `measured_black_dn`; 0 while unknown.
    saturation_dn : float
        The camera's saturation.
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

    Examples
    --------
    >>> from labcdp.acquire import PatchNumbers
    >>> patch = PatchNumbers("a", 0.01, 2, 900, 1064.0, 64.0, 4095.0, 0.0, 12.0, 1.0, drift_dn=10.0)
    >>> patch.signal_dn, patch.drift_rel
    (1000.0, 0.01)
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
        """Mean above the black level."""
        return self.mean_dn - self.black_dn

    @property
    def drift_rel(self) -> float | None:
        """Drift relative to the signal; None for one frame or a negligible signal."""
        return self._relative(self.drift_dn)

    @property
    def flicker_rel(self) -> float | None:
        """Flicker relative to the signal; None for one frame or a negligible signal."""
        return self._relative(self.flicker_dn)

    def _relative(self, change_dn: float | None) -> float | None:
        if change_dn is None or self.signal_dn < _LEAST_SIGNAL_REL * (self.saturation_dn - self.black_dn):
            return None
        return change_dn / self.signal_dn


@dataclass(frozen=True)
class LiveStatistics:
    """Live statistics of the current exposure.

    Parameters
    ----------
    role : {'light', 'dark'}
        Whether the target is seen.
    exposure_s : float
        Exposure time in seconds.
    patches : tuple of PatchNumbers
        Visible patches, in the target's order.
    temperature_c : float or None
        Temperature of the camera at the last frame.
    finished : bool
        Whether this was the last frame of the exposure.

    Examples
    --------
    >>> from labcdp.acquire import LiveStatistics
    >>> LiveStatistics("dark", exposure_s=0.01, patches=(), temperature_c=38.5).finished
    False
    """

    role: Role
    exposure_s: float
    patches: tuple[PatchNumbers, ...]
    temperature_c: float | None
    finished: bool = False


class LiveNumbers:
    """Running statistics of the frames of one exposure; holds only the regions' last values.

    Parameters
    ----------
    regions : sequence of Roi
        The visible patches.

    Attributes
    ----------
    n_frames, n_repeated : int
        Frames added, and those that are bit for bit the same as an earlier one.
    """

    def __init__(self, regions: Sequence[Roi]) -> None:
        self._patches = [_PatchAccumulator(region) for region in regions]
        self._seen: set[int] = set()
        self.n_frames = self.n_repeated = 0

    def add(self, frame: Frame) -> tuple[PatchNumbers, ...]:
        """Add a frame and return the statistics so far.

        Raises
        ------
        InputError
            If a region lies outside the frame.
        """
        for patch in self._patches:
            patch.add(frame)
        self._look_for_repeat(frame)
        return self.numbers

    def _look_for_repeat(self, frame: Frame) -> None:
        """Count a frame that repeats an earlier one in all sampled pixels; blank frames are not counted."""
        sample = frame.dn[::_SAMPLED, ::_SAMPLED]
        key = hash(sample.tobytes())
        self.n_frames += 1
        self.n_repeated += key in self._seen and bool(sample.min() != sample.max())
        self._seen.add(key)

    @property
    def numbers(self) -> tuple[PatchNumbers, ...]:
        """The statistics so far; none before the first frame."""
        return tuple(numbers for patch in self._patches if (numbers := patch.numbers) is not None)


def region_values(frame: Frame, region: Roi) -> NDArray[Any]:
    """Return a copy of the linear DN of a region of a frame, shape (n,); raises InputError as `Roi.mask`."""
    window, mask = _window_and_mask(region, frame.shape)
    values = frame.linear_dn(window)
    return values.flatten() if mask is None else values[mask]


@lru_cache(maxsize=256)
def _window_and_mask(region: Roi, shape: tuple[int, int]) -> tuple[Window, NDArray[np.bool_] | None]:
    """Bounding box of a region, and its mask there, None for all pixels; kept for the next frames."""
    mask = region.mask(shape)
    return region.window(shape), None if mask.all() else mask


class _PatchAccumulator:
    def __init__(self, region: Roi) -> None:
        self._region = region
        self._last: NDArray[np.float32] | None = None
        self._last_mean = 0.0
        self._n = 0
        self._exposure_s = self._saturation_dn = 0.0
        # Sums over frames: of means, of means times the frame's index, of saturated shares; over pairs: of
        # variances of the difference, of squared differences of the means.
        self._means = self._weighted = self._saturated = self._variances = self._squares = 0.0

    def add(self, frame: Frame) -> None:
        values = region_values(frame, self._region)
        mean = float(values.mean(dtype=np.float64))
        kept = values.astype(np.float32)
        if self._last is not None:
            difference = kept - self._last
            shift = float(difference.mean(dtype=np.float64))
            self._variances += max(float(np.dot(difference, difference)) / difference.size - shift**2, 0.0)
            self._squares += (mean - self._last_mean) ** 2
        self._saturated += np.count_nonzero(values >= frame.linear_saturation_dn) / values.size
        self._weighted += self._n * mean
        self._means += mean
        self._n += 1
        self._exposure_s = frame.exposure_s
        self._saturation_dn = frame.linear_saturation_dn
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
            patch=self._region.name,
            exposure_s=self._exposure_s,
            frames=n,
            pixels=self._last.size,
            mean_dn=mean_dn,
            black_dn=0.0,
            saturation_dn=self._saturation_dn,
            saturated_share=self._saturated / n,
            temporal_noise_dn=sqrt(self._variances / pairs / 2) if pairs else None,
            flicker_dn=sqrt(self._squares / pairs / 2) if pairs else None,
            drift_dn=slope * pairs if pairs else None,
        )


#: Least ratio of two exposures whose line says what is at exposure 0.
_LEAST_RATIO = 2.0


def measured_black_dn(dark: Sequence[PatchNumbers], light: Sequence[PatchNumbers]) -> float | None:
    """Return the mean of the shortest dark frames, else the intercept of the light frames.

    Parameters
    ----------
    dark, light : sequence of PatchNumbers
        All exposures of all patches so far.

    Returns
    -------
    float or None
        None if there is one exposure only, and no dark frame.
    """
    if dark:
        shortest_s = min(n.exposure_s for n in dark)
        return fmean(n.mean_dn for n in dark if n.exposure_s == shortest_s)
    lines = []
    for name in {n.patch for n in light}:
        clear = [n for n in light if n.patch == name and n.saturated_share <= MAX_CLIPPED_SHARE]
        first, last = (pick(clear, key=lambda n: n.exposure_s, default=None) for pick in (min, max))
        if first is not None and last is not None and last.exposure_s >= _LEAST_RATIO * first.exposure_s:
            slope = (last.mean_dn - first.mean_dn) / (last.exposure_s - first.exposure_s)
            lines.append((slope, first.mean_dn - slope * first.exposure_s))
    # The flattest line is extrapolated least.
    return min(lines, default=(0.0, None), key=lambda line: line[0])[1]
