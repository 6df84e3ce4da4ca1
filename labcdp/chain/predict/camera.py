"""A sensor with its settings and what is made of its captures, and the probabilities of the DN of one of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import ceil, hypot
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ..hdr import CaptureLadder, Hdr
from ..isp import CodeCurve
from ..sensor import CaptureModel, Sensor, digitise
from ..signal import ExposureSettings

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]

#: Half the width of the windows in standard deviations; 3e-12 of a normal distribution lies outside.
_REACH = 7.0


@dataclass(frozen=True)
class CameraModel:
    """Sensor, exposures, merge and tone curve.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    settings : ExposureSettings
        Exposure settings.
    hdr : Hdr or None
        Merge of the exposures; None for a single one.
    tone_curve : CodeCurve or None
        Encodes the merged DN, or the DN of a single exposure with its black level. The code is decoded again.
    spectrum : str
        Spectrum of the light, on which the shares of photodiodes with other quantum efficiencies depend.

    Raises
    ------
    InputError
        If there are several exposures or captures without `hdr`.

    Examples
    --------
    >>> from labcdp.chain import CameraModel, Chain, ExposureSettings
    >>> ((_, sensor),) = Chain.load("manta-g505").sensors
    >>> camera = CameraModel(sensor, ExposureSettings((0.01,)))
    >>> camera.exposures_s, camera.full_well_e
    ((0.01,), 7000.0)
    """

    sensor: Sensor
    settings: ExposureSettings
    hdr: Hdr | None = None
    tone_curve: CodeCurve | None = None
    spectrum: str = "D65"

    def __post_init__(self) -> None:
        count = len(self.sensor.captures or self.settings.exposure_s)
        if self.hdr is None and count > 1:
            raise InputError(f"there are {count} exposures and nothing merges them: give one exposure, or an Hdr")

    @cached_property
    def captures(self) -> tuple[CaptureModel, ...]:
        """What is merged, most sensitive first."""
        models = self.sensor.capture_models(self.settings, self.spectrum)
        return tuple(sorted(models, key=lambda model: -model.sensitivity_s))

    @property
    def merges_captures(self) -> bool:
        """Whether the captures are merged by what they are, and not as exposures of one photodiode at one gain."""
        return bool(self.sensor.captures) or (self.hdr is not None and self.hdr.method == "most-sensitive")

    @cached_property
    def exposures_s(self) -> tuple[float, ...]:
        """Exposure times in seconds, longest first."""
        return tuple(sorted(self.settings.exposure_s, reverse=True))

    @property
    def k_dn_per_e(self) -> float:
        """Overall system gain at the gain of the settings."""
        return self.sensor.system_gain_dn_per_e(self.settings.gain_db)

    @property
    def offset_spread_e(self) -> float:
        """Standard deviation of the offsets over pixels, columns and rows, electrons."""
        return hypot(self.sensor.dsnu_e, self.sensor.column_dsnu_e, self.sensor.row_dsnu_e)

    @property
    def full_well_e(self) -> float:
        """Full well as a simulated exposure has it, in float32."""
        return float(np.float32(self.sensor.full_well_e))

    @property
    def all_noise_e(self) -> float:
        """Standard deviation of read noise and all offsets together, electrons."""
        return hypot(self.sensor.read_noise_e, self.offset_spread_e)

    @property
    def certain_e(self) -> float:
        """Mean electrons from which on all pixels are full or at the highest DN."""
        end_e = (2**self.sensor.bits - self.sensor.black_level_dn) / self.k_dn_per_e + _REACH * self.all_noise_e
        limit_e = max(min(self.full_well_e, end_e), 1.0)
        return float(limit_e + (_REACH + 1) * np.sqrt(limit_e) + 60)

    def dn_rows(self, mean_e: FloatArray, offsets_e: FloatArray | None = None) -> Iterator[csr_array]:
        """Probability of each DN of an exposure for each of several means, at each of several offsets.

        Parameters
        ----------
        mean_e : ndarray, shape (n,)
            Mean photo and dark electrons.
        offsets_e : ndarray or None
            Offsets of pixels in electrons; None for all pixels at once, whose offsets then are noise.

        Yields
        ------
        scipy.sparse.csr_array, shape (n, 2^bits)

        Notes
        -----
        P(DN = d) = sum over n of P(n; mean) P(d | n): Poisson counts n up to the full well, which holds all that is
        above, each followed by normal noise, rounding and clipping. The sum takes every count; where both factors are
        smooth over many counts, every second, fourth, ..., which for normal densities is exact to 1e-8 up to a step
        of their common width.
        """
        noise_e = self.all_noise_e if offsets_e is None else self.sensor.read_noise_e
        electrons = electron_rows(mean_e, self.full_well_e, noise_e)
        occurs = np.bincount(electrons.indices) > 0
        for offset_e in (0.0,) if offsets_e is None else offsets_e:
            yield electrons @ self._dn_of_count(offset_e, noise_e, occurs)

    def _dn_of_count(self, offset_e: float, noise_e: float, occurs: NDArray[np.bool_]) -> csr_array:
        """Probability of each DN for each count 0, 1, ... and the full well that occurs, shape (counts, 2^bits)."""
        from scipy.sparse import csr_array
        from scipy.special import ndtr

        index = np.flatnonzero(occurs)
        count, states = np.minimum(index, self.full_well_e), ceil(self.full_well_e)
        bits, black_dn, k_dn_per_e = self.sensor.bits, self.sensor.black_level_dn, self.k_dn_per_e
        top = 2**bits - 1
        if noise_e == 0:
            dn = digitise((count + offset_e).astype(np.float32), k_dn_per_e, black_dn, bits)
            return csr_array((np.ones(count.size), (index, dn)), shape=(states + 1, top + 1))
        centre_dn = k_dn_per_e * (count + offset_e) + black_dn
        noise_dn = k_dn_per_e * noise_e
        width = min(2 * ceil(_REACH * noise_dn) + 2, top + 1)
        first = np.clip(np.floor(centre_dn - width / 2 + 1), 0, top + 1 - width)
        edges = first[:, None] + np.arange(width + 1) - 0.5
        edges[edges < 0] = -np.inf
        edges[edges > top] = np.inf
        share = np.diff(ndtr((edges - centre_dn[:, None]) / noise_dn), axis=1)
        column = (first[:, None] + np.arange(width)).astype(np.int32)
        starts = np.searchsorted(index, np.arange(states + 2)) * width
        return csr_array((share.ravel(), column.ravel(), starts), shape=(states + 1, top + 1))

    @property
    def dn_per_e_s(self) -> float:
        """Slope of the mean DN over the rate of photo-electrons of the sensor's own photodiode."""
        if self.sensor.captures:
            first = self.captures[0]
            return first.k_dn_per_e * first.light_share * first.exposure_s
        return self.k_dn_per_e * self.exposures_s[0]

    @property
    def dark_e_s(self) -> float:
        """Mean dark current at the temperature of the settings, electrons per second."""
        return self.sensor.dark_current_at(self.settings.temperature_c)

    @property
    def dark_dn(self) -> float:
        """Mean DN of dark signal, on the scale of the values."""
        if self.sensor.captures:
            first = self.captures[0]
            return (first.sensor.black_level_dn if self.hdr is None else 0.0) + first.k_dn_per_e * first.dark_e
        black_dn = self.sensor.black_level_dn if self.hdr is None else 0.0
        return black_dn + self.dark_e_s * self.dn_per_e_s

    @property
    def saturation_dn(self) -> float:
        """DN before the tone curve from which a pixel counts as saturated."""
        gain_db = self.settings.gain_db
        limit = self.sensor.saturation_dn(gain_db) if self.hdr is None else self.hdr.saturation_dn(self.ladder)
        return limit if self.tone_curve is None else min(limit, self.tone_curve.top_dn)

    @cached_property
    def ladder(self) -> CaptureLadder:
        """The captures for merging."""
        return CaptureLadder.of_captures([c.described(np.empty(0), self.spectrum) for c in self.captures])


def electron_rows(mean_e: FloatArray, full_well_e: float, noise_e: float) -> csr_array:
    """Probability of each electron count, the full well last, shape (n, ceil(full well) + 1); see `dn_rows`."""
    from scipy.sparse import csr_array
    from scipy.special import gammaln, pdtrc, xlogy

    states = ceil(full_well_e)
    reach = _REACH * np.sqrt(mean_e) + 15
    step = _count_step(mean_e, mean_e + reach < full_well_e, noise_e)
    first = (np.maximum(mean_e - reach, 0) // step).astype(np.int64) * step
    last = np.minimum(mean_e + reach, states - 1).astype(np.int64)
    sizes = np.maximum((last - first) // step + 1, 0)
    row = np.repeat(np.arange(mean_e.size), sizes)
    begin = np.cumsum(sizes) - sizes
    count = first[row] + (np.arange(row.size) - begin[row]) * step[row]
    # A table of log n! is quicker than its evaluation for each row.
    log_factorial = gammaln(np.arange(count.max(initial=0) + 1) + 1.0)
    share = step[row] * np.exp(xlogy(count, mean_e[row]) - mean_e[row] - log_factorial[count])
    full = pdtrc(states - 1, mean_e)
    reached = np.flatnonzero(full > 0)
    return csr_array(
        (
            np.concatenate([share, full[reached]]),
            (np.concatenate([row, reached]), np.concatenate([count, np.full(reached.size, states)])),
        ),
        shape=(mean_e.size, states + 1),
    )


def _count_step(mean_e: FloatArray, below_full: NDArray[np.bool_], noise_e: float) -> NDArray[np.int64]:
    """Step of the sum over counts: a power of 2 below 0.9 of the common width of shot noise and read noise."""
    if noise_e == 0:
        return np.ones(mean_e.size, dtype=np.int64)
    width = 1 / np.hypot(1 / noise_e, 1 / np.sqrt(np.maximum(mean_e, 1e-300)))
    power = np.floor(np.log2(np.maximum(0.9 * width, 1)))
    # A Poisson distribution of few counts is too skew to be treated as a normal one.
    smooth = below_full & (mean_e > 100)
    return np.where(smooth, 2**power, 1).astype(np.int64)
