"""Dark frame library: what each pixel adds in darkness, at any exposure and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import log2, sqrt
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError, InputError
from ..stored_array import StoredArray, content_sha256, read_only
from .defects import DefectMap
from .pixel_statistics import PixelStatistics
from .region_statistics import quantisation_variance_dn2

#: Temperatures that differ by less than this say nothing about how the dark current grows with them.
MIN_TEMPERATURE_SPAN_C = 3.0


@dataclass(frozen=True, eq=False)
class DarkLibrary:
    """Pattern of the darkness, zero on average: offset(x, y) + rate(x, y) t 2^((T - T_ref) / T_d).

    The mean darkness is not part of it; a calibration's dark model has that. Doubling of the dark current every T_d:
    EMVA 1288 Release 4.0 Linear, equation for mu_I(T). Two libraries are equal if all their values are.

    Parameters
    ----------
    offset_dn : ndarray of float32, shape (height, width)
        Pattern at zero exposure, mean 0 over the sound pixels.
    rate_dn_s : ndarray of float32, shape (height, width)
        Growth of the pattern per second at `temperature_c`, mean 0 over the sound pixels.
    noise_covariance : ((float, float), (float, float))
        Covariance of one pixel's offset (DN) and rate (DN/s) by the noise of the frames.
    pattern_covariance : ((float, float), (float, float))
        Covariance of offset and rate from sound pixel to sound pixel, noise removed.
    temperature_c : float or None
        Temperature T_ref of the frames; None if unknown.
    doubling_temperature_c : float or None
        T_d; None if the frames do not tell, the pattern then holds at `temperature_c` only.
    n_frames : int
        How many dark frames it was made from.

    Raises
    ------
    InputError
        If the arrays differ in shape or are not finite.
    """

    offset_dn: Annotated[NDArray[np.float32], StoredArray("float32", 2)]
    rate_dn_s: Annotated[NDArray[np.float32], StoredArray("float32", 2)]
    noise_covariance: tuple[tuple[float, float], tuple[float, float]]
    pattern_covariance: tuple[tuple[float, float], tuple[float, float]]
    temperature_c: float | None
    doubling_temperature_c: float | None
    n_frames: int

    def __post_init__(self) -> None:
        for name in ("offset_dn", "rate_dn_s"):
            values = np.asarray(getattr(self, name))
            if values.ndim != 2 or not np.isfinite(values).all():
                raise InputError(f"{name} of a dark library is a 2-D array of finite numbers")
            object.__setattr__(self, name, read_only(values, np.float32))
        if self.offset_dn.shape != self.rate_dn_s.shape:
            raise InputError("offset_dn and rate_dn_s of a dark library differ in shape")

    def pattern_dn(
        self, shape: tuple[int, int], exposure_s: float, temperature_c: float | None = None
    ) -> NDArray[np.float32]:
        """Pattern of the darkness at an exposure and temperature, mean 0.

        Parameters
        ----------
        shape : (int, int)
            Height and width of the image.
        exposure_s : float
            Exposure time.
        temperature_c : float or None
            Temperature; None for that of the library.

        Raises
        ------
        InputError
            If the library is of another image size.
        """
        if shape != self.offset_dn.shape:
            height, width = self.offset_dn.shape
            raise InputError(
                f"the dark library is for {width} x {height} pixels, the image has {shape[1]} x {shape[0]}: take dark "
                "frames with this image size"
            )
        pattern: NDArray[np.float32] = self.offset_dn + np.float32(self._time_s(exposure_s, temperature_c)) * (
            self.rate_dn_s
        )
        return pattern

    def correction_dn(
        self, shape: tuple[int, int], exposure_s: float, temperature_c: float | None = None
    ) -> NDArray[np.float32] | None:
        """Pattern to take off frames, as `pattern_dn`; None where that is not `worth_applying`."""
        if not self.worth_applying(exposure_s, temperature_c):
            return None
        return self.pattern_dn(shape, exposure_s, temperature_c)

    def noise_dn(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """Return the standard uncertainty of one pixel of the pattern."""
        return self._standard(self.noise_covariance, exposure_s, temperature_c)

    def nonuniformity_dn(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """Return the standard deviation of the pattern itself, noise removed (EMVA 1288: DSNU, in DN)."""
        return self._standard(self.pattern_covariance, exposure_s, temperature_c)

    def worth_applying(self, exposure_s: float, temperature_c: float | None = None) -> bool:
        """Whether subtracting the pattern leaves less than it takes away: its noise is below the pattern itself."""
        return self.noise_dn(exposure_s, temperature_c) < self.nonuniformity_dn(exposure_s, temperature_c)

    def verdict(self, exposure_s: float, temperature_c: float | None = None) -> str:
        """Tell in plain words whether subtracting the pattern helps, and by how much."""
        pattern = self.nonuniformity_dn(exposure_s, temperature_c)
        noise = self.noise_dn(exposure_s, temperature_c)
        at = f"at {exposure_s:g} s the dark pattern is {pattern:.3g} DN"
        if self.worth_applying(exposure_s, temperature_c):
            return f"{at}, of which {noise:.2g} DN of noise are left from {self.n_frames} frames: worth subtracting"
        need = "no number of frames helps" if pattern == 0 else f"take {self._frames_needed(pattern, noise)} frames"
        return f"{at}, the library's noise {noise:.2g} DN: subtracting it would add more than it removes; {need}"

    def _frames_needed(self, pattern: float, noise: float) -> int:
        """Frames from which the noise is half of the pattern."""
        return int(np.ceil(self.n_frames * (2 * noise / pattern) ** 2))

    def _time_s(self, exposure_s: float, temperature_c: float | None) -> float:
        """Exposure with as much dark current at the library's temperature."""
        if temperature_c is None or self.temperature_c is None or self.doubling_temperature_c is None:
            return exposure_s
        return float(exposure_s * 2 ** ((temperature_c - self.temperature_c) / self.doubling_temperature_c))

    def _standard(
        self, covariance: tuple[tuple[float, float], ...], exposure_s: float, temperature_c: float | None
    ) -> float:
        sensitivity = np.array([1.0, self._time_s(exposure_s, temperature_c)])
        return sqrt(max(float(sensitivity @ np.array(covariance) @ sensitivity), 0.0))

    @cached_property
    def content_sha256(self) -> str:
        """Hash over all values."""
        unknown = float("nan")
        temperatures = [unknown if v is None else v for v in (self.temperature_c, self.doubling_temperature_c)]
        numbers = np.array([*np.ravel(self.noise_covariance), *np.ravel(self.pattern_covariance), *temperatures])
        return content_sha256(self.offset_dn, self.rate_dn_s, numbers, np.array(self.n_frames))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DarkLibrary):
            return NotImplemented
        return self is other or self.content_sha256 == other.content_sha256

    def __hash__(self) -> int:
        return hash(self.content_sha256)


def dark_library(darks: Sequence[PixelStatistics], defects: DefectMap | None = None) -> DarkLibrary:
    """Fit offset and rate of each pixel to dark frames at one or more exposures and temperatures.

    A straight line over the exposure, corrected for the temperature, by least squares with the number of frames as
    weights. At one exposure all of the pattern is taken as offset. T_d follows from how much steeper the mean darkness
    grows with the exposure at higher temperatures.

    Parameters
    ----------
    darks : sequence of PixelStatistics
        One for each exposure and temperature; at least one with two frames, of one camera and setting.
    defects : DefectMap or None
        Pixels that are not used: the pattern is zero on average over the others, and its covariance is theirs.

    Raises
    ------
    CalibrationError
        If there is no repeated frame, or cameras or settings differ.
    InputError
        If the defects are of another image size.
    """
    if not any(d.n_frames > 1 for d in darks):
        raise CalibrationError("a dark library needs at least 2 dark frames at an exposure: it could not tell noise")
    for d in darks[1:]:
        darks[0].state.require(d.state, "the first dark frames", f"the set of dark frames at {d.exposure_s:g} s")
    doubling = _doubling_temperature_c(darks)
    temperatures = [d.temperature_c for d in darks]
    known = [value for value in temperatures if value is not None]
    reference = float(np.mean(known)) if len(known) == len(darks) else None
    time_s = np.array(
        [
            d.exposure_s
            if doubling is None or reference is None or d.temperature_c is None
            else d.exposure_s * 2 ** ((d.temperature_c - reference) / doubling)
            for d in darks
        ]
    )
    several = np.ptp(time_s) > 0
    design = np.column_stack([np.ones_like(time_s), time_s]) if several else np.ones((time_s.size, 1))
    frames = np.array([d.n_frames for d in darks], dtype=float)
    solve = np.linalg.inv(design.T @ (frames[:, None] * design)) @ (design.T * frames)
    sound = np.ones(darks[0].shape, np.bool_) if defects is None else ~defects.mask(darks[0].shape)
    maps = np.zeros((2, *darks[0].shape))
    for i, d in enumerate(darks):
        pattern = d.mean_dn - d.mean_dn[sound].mean()
        for parameter in range(design.shape[1]):
            maps[parameter] += solve[parameter, i] * pattern
    repeated = [d for d in darks if d.n_frames > 1]
    freedoms = [d.n_frames - 1 for d in repeated]
    average_dn2 = float(np.average([d.typical_variance_dn2 for d in repeated], weights=freedoms))
    # Each set has its own: dark current adds noise at long exposures. A single frame does not know its own.
    variances = np.array(
        [d.mean_variance_dn2 if d.n_frames > 1 else average_dn2 + quantisation_variance_dn2(average_dn2) for d in darks]
    )
    noise = np.zeros((2, 2))
    noise[: design.shape[1], : design.shape[1]] = (solve * variances) @ solve.T
    observed = np.cov(maps[:, sound])
    return DarkLibrary(
        offset_dn=maps[0],
        rate_dn_s=maps[1],
        noise_covariance=_pairs(noise),
        pattern_covariance=_pairs(observed - noise),
        temperature_c=reference,
        doubling_temperature_c=doubling,
        n_frames=int(frames.sum()),
    )


def _pairs(matrix: NDArray[np.float64]) -> tuple[tuple[float, float], tuple[float, float]]:
    (a, b), (c, d) = matrix.tolist()
    return (a, b), (c, d)


def _doubling_temperature_c(darks: Sequence[PixelStatistics]) -> float | None:
    """T_d from the slopes of the mean darkness over the exposure at different temperatures; None if they do not tell.

    Sets within half a degree count as one temperature.
    """
    groups: dict[int, list[PixelStatistics]] = {}
    for d in darks:
        if d.temperature_c is None:
            return None
        groups.setdefault(round(d.temperature_c), []).append(d)
    points = []
    for group in groups.values():
        t = np.array([d.exposure_s for d in group])
        if np.ptp(t) > 0:
            slope = float(np.polyfit(t, [float(np.median(d.mean_dn)) for d in group], 1)[0])
            if slope > 0:
                points.append((float(np.mean([d.temperature_c for d in group if d.temperature_c is not None])), slope))
    if len(points) < 2 or np.ptp([p[0] for p in points]) < MIN_TEMPERATURE_SPAN_C:
        return None
    growth = float(np.polyfit([p[0] for p in points], [log2(p[1]) for p in points], 1)[0])
    return 1 / growth if growth > 0 else None
