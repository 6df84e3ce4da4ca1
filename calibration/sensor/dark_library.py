"""Dark frame library: dark signal of each pixel at any exposure and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, hypot, sqrt
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ...core.disk.arrays import EqualByContent, StoredArray, read_only
from ...core.errors import CalibrationError, InputError
from ...core.result import Finding, info
from ..frames.defects import DefectMap
from ..frames.measure import MeasuredFrames, blocks
from ..frames.observe import dark_observation
from ..frames.rounding import quantisation_variance_dn2
from .dark import fit_dark
from .dark_fit import DOUBLING_REL, MIN_TEMPERATURE_SPAN_C, TYPICAL_DOUBLING_C, DarkCurrent, as_rows, growth_by

#: Ratio of a dark pixel's standard deviation with and without the pattern from which more dark frames are worth their
#: time: a judgement.
_WORTH_MORE_FRAMES = 1.1


@dataclass(frozen=True, eq=False)
class DarkLibrary(DarkCurrent, EqualByContent):
    """Pattern of the dark signal, zero on average: offset(x, y) + rate(x, y) t 2^((T - T_ref) / T_d).

    The mean dark signal is not included; it is in the calibration's dark model. Doubling of the dark current every T_d:
    EMVA 1288 Release 4.0 Linear, equation for mu_I(T). Two libraries are equal if all their values are.

    Parameters
    ----------
    offset_dn : ndarray of float32, shape (height, width)
        Pattern at zero exposure, mean 0 over the valid pixels.
    rate_dn_s : ndarray of float32, shape (height, width)
        Growth of the pattern per second at `temperature_c`, mean 0 over the valid pixels.
    noise_covariance : ((float, float), (float, float))
        Covariance of one pixel's offset (DN) and rate (DN/s) by the noise of the frames.
    pattern_covariance : ((float, float), (float, float))
        Covariance of offset and rate between valid pixels, noise removed.
    temperature_c : float or None
        Temperature T_ref of the frames; None if unknown.
    doubling_temperature_c : float or None
        T_d; None if unknown: a typical one is then used, and its uncertainty counts as noise of the pattern.
    n_frames : int
        Number of dark frames used.
    only_exposure_s : float or None
        The exposure, if there is one only: offset and growth are then not known apart, and the whole pattern is in
        `offset_dn`.

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
    only_exposure_s: float | None = None

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
        """Pattern of the dark signal at an exposure and temperature, mean 0.

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
        time_s = np.float32(self._time_s(exposure_s, temperature_c))
        pattern: NDArray[np.float32] = self.offset_dn + time_s * self.rate_dn_s
        return pattern

    def correction_dn(
        self, shape: tuple[int, int], exposure_s: float, temperature_c: float | None = None
    ) -> NDArray[np.float32] | None:
        """Pattern to subtract from frames, as `pattern_dn`; None where not `worth_applying`."""
        if not self.worth_applying(exposure_s, temperature_c):
            return None
        return self.pattern_dn(shape, exposure_s, temperature_c)

    @lru_cache(maxsize=8)  # noqa: B019 - the few libraries of a program, which each frame asks for
    def cropped(self, corner: tuple[int, int], shape: tuple[int, int]) -> DarkLibrary:
        """Library of the part of the image that has its upper left pixel at a `corner` (x, y)."""
        window = slice(corner[1], corner[1] + shape[0]), slice(corner[0], corner[0] + shape[1])
        return replace(self, offset_dn=self.offset_dn[window], rate_dn_s=self.rate_dn_s[window])

    def noise_dn(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """Return the standard uncertainty of one pixel of the pattern: noise of the frames, and unknown growth."""
        of_frames = _deviation(self.noise_covariance, self._time_s(exposure_s, temperature_c))
        return hypot(of_frames, self._unknown_growth_dn(exposure_s, temperature_c))

    def nonuniformity_dn(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """Return the standard deviation of the pattern itself, noise removed (EMVA 1288: DSNU, in DN)."""
        return _deviation(self.pattern_covariance, self._time_s(exposure_s, temperature_c))

    def worth_applying(self, exposure_s: float, temperature_c: float | None = None) -> bool:
        """Whether subtracting the pattern helps: its uncertainty is below the pattern itself."""
        return self.noise_dn(exposure_s, temperature_c) < self.nonuniformity_dn(exposure_s, temperature_c)

    def verdict(self, exposure_s: float, temperature_c: float | None = None) -> list[Finding]:
        """Return whether subtracting the pattern helps, and by how much; nothing where it hardly matters."""
        pattern, noise = (of(exposure_s, temperature_c) for of in (self.nonuniformity_dn, self.noise_dn))
        values = {"exposure_s": exposure_s, "pattern_dn": pattern, "noise_dn": noise, "n_frames": self.n_frames}
        if noise < pattern:
            return [info("dark-pattern-subtracted", **values)]
        if pattern == 0:
            return [info("dark-pattern-none", **values)]
        if self._unknown_growth_dn(exposure_s, temperature_c) > pattern / 2:
            return [info("dark-pattern-of-other-frames", **values)]
        if hypot(1, pattern / (noise * sqrt(self.n_frames))) < _WORTH_MORE_FRAMES:
            return []
        return [info("dark-pattern-too-noisy", **values, needed=ceil(self.n_frames * (2 * noise / pattern) ** 2))]

    def _time_s(self, exposure_s: float, temperature_c: float | None) -> float:
        """Equivalent exposure at the library's temperature."""
        return exposure_s * self.growth(temperature_c)

    def _unknown_growth_dn(self, exposure_s: float, temperature_c: float | None) -> float:
        """Return the uncertainty of the pattern by its growth with exposure or temperature, where not measured."""
        time_s = self._time_s(exposure_s, temperature_c)
        if self.only_exposure_s is not None:
            # All of the pattern may be dark current.
            return sqrt(max(self.pattern_covariance[0][0], 0.0)) * abs(time_s / self.only_exposure_s - 1)
        if self.doubling_temperature_c is not None or temperature_c is None or self.temperature_c is None:
            return 0.0
        growth_rel = 2 ** (DOUBLING_REL / TYPICAL_DOUBLING_C * abs(temperature_c - self.temperature_c)) - 1
        return sqrt(max(self.pattern_covariance[1][1], 0.0)) * time_s * growth_rel


def _deviation(covariance: tuple[tuple[float, float], ...], time_s: float) -> float:
    """Return the standard deviation of offset + rate t, by the covariance of the two."""
    sensitivity = np.array([1.0, time_s])
    return sqrt(max(float(sensitivity @ np.array(covariance) @ sensitivity), 0.0))


def dark_library(darks: Sequence[MeasuredFrames], defects: DefectMap | None = None) -> DarkLibrary:
    """Fit offset and rate of each pixel to dark frames at one or more exposures and temperatures.

    A straight line over the exposure, corrected for the temperature as in the dark model, by least squares with the
    number of frames as weights. At one exposure the whole pattern is treated as offset.

    Parameters
    ----------
    darks : sequence of MeasuredFrames
        One for each exposure and temperature; at least one with two frames, of one camera and setting.
    defects : DefectMap or None
        Pixels not used: mean and covariance of the pattern are those of the others.

    Raises
    ------
    CalibrationError
        If there is no repeated frame, or cameras or settings differ.
    InputError
        If the defects are of another image size.
    """
    repeated = [d for d in darks if d.n_frames > 1]
    if not repeated:
        raise CalibrationError(
            "a dark library needs at least 2 dark frames at an exposure: noise cannot be measured with fewer"
        )
    darks[0].state.require_alike(darks, "the first dark frames")
    temperature_c, doubling_c = _temperatures(repeated)
    warmer_k = [
        0.0 if d.temperature_c is None or temperature_c is None else d.temperature_c - temperature_c for d in darks
    ]
    time_s = np.array([d.exposure_s * growth_by(k, doubling_c) for d, k in zip(darks, warmer_k, strict=True)])
    one_exposure = np.ptp([d.exposure_s for d in darks]) == 0
    design = np.ones((time_s.size, 1)) if one_exposure else np.column_stack([np.ones_like(time_s), time_s])
    frames = np.array([d.n_frames for d in darks], dtype=float)
    solve = np.linalg.inv(design.T @ (frames[:, None] * design)) @ (design.T * frames)
    shape = darks[0].state.image_shape
    sound = True if defects is None else ~defects.mask(shape)
    means_dn = np.array([d.image_dn.mean(dtype=np.float64, where=sound) for d in darks])
    maps = np.zeros((2, *shape))
    for part in blocks(shape):
        images = np.array([d.image_dn[part] for d in darks], np.float64)
        maps[: len(solve), part] = np.tensordot(solve, images - means_dn[:, None, None], 1)
    # Noise differs between sets, as dark current adds to it; it cannot be estimated from a single frame.
    dof, typical_dn2 = zip(*((d.dof, d.typical_variance_dn2) for d in repeated), strict=True)
    average_dn2 = float(np.average(typical_dn2, weights=dof))
    of_one = average_dn2 + quantisation_variance_dn2(average_dn2, repeated[0].step_dn)
    variances = [d.pixel_mean_variance_dn2 if d.n_frames > 1 else of_one for d in darks]
    noise = np.zeros((2, 2))
    noise[: len(solve), : len(solve)] = (solve * np.array(variances)) @ solve.T
    return DarkLibrary(
        offset_dn=maps[0].astype(np.float32),
        rate_dn_s=maps[1].astype(np.float32),
        noise_covariance=as_rows(noise),
        pattern_covariance=as_rows(np.cov(maps.reshape(2, -1) if defects is None else maps[:, sound]) - noise),
        temperature_c=temperature_c,
        doubling_temperature_c=doubling_c,
        n_frames=int(frames.sum()),
        only_exposure_s=darks[0].exposure_s if one_exposure else None,
    )


def _temperatures(darks: Sequence[MeasuredFrames]) -> tuple[float | None, float | None]:
    """Mean temperature of dark frames, and that by which the dark current doubles; None where they do not show it."""
    known = [d.temperature_c for d in darks if d.temperature_c is not None]
    if len(known) < len(darks):
        return None, None
    if np.ptp(known) < MIN_TEMPERATURE_SPAN_C:
        return float(np.mean(known)), None
    model, _ = fit_dark([dark_observation(d) for d in darks])
    return model.temperature_c, model.doubling_temperature_c
