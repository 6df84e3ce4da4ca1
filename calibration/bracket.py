"""One luminance map from several exposures of a still scene (high dynamic range)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import CalibrationError
from ..core.frame import Frame
from ..core.luminance import WHOLE, CommonError, Invalid, LuminanceMap, Window, require_alike
from ..core.result import Finding, warning
from .colour.model import AnyCalibration
from .uncertainty import SMALL_EFFECT_REL

#: Required distance of a pixel's expected value from saturation, in standard deviations of its noise.
_SATURATION_MARGIN = 3.0
#: Probability that chance makes the exposures of any pixel of an image look inconsistent.
_CHANCE = 0.01
#: Share of inconsistent pixels that is reported.
_REPORTED_SHARE = 1e-4
#: Number of pixels for the noise model of an exposure, and of its knots.
_SAMPLES, _KNOTS = 20_000, 64
#: Pixels that are merged at a time.
_BLOCK = 200_000

_Array = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Bracket:
    """Luminance from several exposures.

    Parameters
    ----------
    map : LuminanceMap
        Weighted mean of the exposures for each pixel.
    n_used : ndarray of uint8, shape (height, width)
        Number of frames used for each pixel; 0 if all of them are saturated or the pixel is defect.
    exposures_s : tuple of float
        Of the frames, shortest first.
    inconsistent_share : float
        Share of the pixels with inconsistent exposures.
    findings : tuple of Finding
        Findings for the user.
    """

    map: LuminanceMap
    n_used: NDArray[np.uint8]
    exposures_s: tuple[float, ...]
    inconsistent_share: float
    findings: tuple[Finding, ...]


def bracket_luminance(conversion: AnyCalibration, frames: Sequence[Frame]) -> Bracket:
    """Luminance of a still scene from frames at several exposures.

    Each pixel is the mean of its exposures with the inverse of their variances as weights, which minimises its
    variance; saturated and defect pixels are excluded. The weights follow from the mean luminance, not from each
    exposure's value, as noise would give low values more weight; for the same reason an exposure is excluded where
    saturation is expected within three standard deviations. Common errors are weighted like the exposures; so is the
    noise of flat field and dark library, one error of a pixel at all exposures. Exposures that differ by more than
    noise, dark signal non-uniformity and `SMALL_EFFECT_REL` (chi^2) are flagged: something moved or flickered.

    Parameters
    ----------
    conversion : Calibration or ColourCalibration
        Of the camera.
    frames : sequence of Frame
        At least one, of one camera and setting; several of one exposure are averaged.

    Raises
    ------
    CalibrationError
        If there is no frame, or one is not of the conversion's camera and setting.
    """
    if not frames:
        raise CalibrationError("there is no frame: give the frames of a bracket, at best at 3 exposures or more")
    merge = _Merge.of(conversion, sorted(frames, key=lambda frame: frame.exposure_s))
    # NumPy computes without the interpreter's lock: two at a time take little more memory.
    with ThreadPoolExecutor(2) as pool:
        blocks = list(pool.map(lambda window: merge.block(window)[0], merge.windows()))
    of_pixels = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    n_used, common_rel = of_pixels.pop("n_used"), of_pixels.pop("common_rel")
    invalid = of_pixels["invalid"]
    combined = _MergedMap(merge, common_rel, luminance_cd_m2=of_pixels.pop("mean"), **of_pixels)
    share = float(np.mean((invalid & Invalid.INCONSISTENT) != 0))
    exposures_s = tuple(exposure.frame.exposure_s for exposure in merge.exposures)
    return Bracket(combined, n_used, exposures_s, share, _findings(exposures_s, combined, share))


class _MergedMap(LuminanceMap):
    """Map of a merge; its common errors are merged again where they are asked for, as they would fill the memory."""

    def __init__(self, merge: _Merge, common_rel: _Array, **of_pixels: Any) -> None:
        super().__init__(common=(), slow_rel=merge.slow_rel, fixed_rel=merge.fixed_rel, step=merge.step, **of_pixels)
        self._common_rel, self._merge = common_rel, merge

    @property
    def common_rel(self) -> _Array:
        """Relative standard uncertainty of all common errors together."""
        return self._common_rel

    def common_in(self, window: Window) -> tuple[CommonError, ...]:
        """Return the common errors of some rows and columns of the map."""
        return self._merge.block(window)[1]


@dataclass(frozen=True, eq=False)
class _Exposure:
    """A frame, the first one alike but for the pixels, and knots of the pixels' variance over the luminance."""

    frame: Frame
    first: int
    full: Frame
    luminance_cd_m2: NDArray[np.float64]
    variance: NDArray[np.float64]
    dark_cd_m2: float

    def variance_at(self, luminance_cd_m2: _Array) -> _Array:
        """Variance of pixels of an expected luminance."""
        return np.interp(luminance_cd_m2, self.luminance_cd_m2, self.variance).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Merge:
    """Frames to be merged block by block: at once they would take 100 times the memory of the result."""

    conversion: AnyCalibration
    exposures: tuple[_Exposure, ...]
    shape: tuple[int, int]
    slow_rel: float
    fixed_rel: float
    step: int

    @classmethod
    def of(cls, conversion: AnyCalibration, frames: Sequence[Frame]) -> _Merge:
        exposures: list[_Exposure] = []
        alike: dict[tuple[float, float, float | None], _Exposure] = {}
        for frame in frames:
            setting = frame.exposure_s, frame.gain_db, frame.temperature_c
            if setting not in alike:
                luminance = conversion.to_luminance(frame)
                saturation_dn = frame.dn_at(min(frame.linear_saturation_dn, conversion.state.saturation_dn))
                full = frame.with_pixels(np.full_like(frame.dn, saturation_dn))
                dark_cd_m2 = conversion.dark_spread_cd_m2(frame)
                alike[setting] = _Exposure(frame, len(exposures), full, *_noise(luminance), dark_cd_m2)
            exposures.append(replace(alike[setting], frame=frame))
        require_alike([conversion.to_luminance(frame, (slice(0, 1), slice(0, 1))) for frame in frames])
        return cls(
            conversion, tuple(exposures), luminance.shape, luminance.slow_rel, luminance.fixed_rel, luminance.step
        )

    def windows(self) -> Iterator[Window]:
        rows = max(_BLOCK // self.shape[1], 1)
        return ((slice(start, start + rows), slice(None)) for start in range(0, self.shape[0], rows))

    def block(self, window: Window) -> tuple[dict[str, NDArray[Any]], tuple[CommonError, ...]]:
        """Merge the exposures in some rows and columns: what there is of each pixel, and the common errors."""
        maps = [self.conversion.to_luminance(part.frame, window) for part in self.exposures]
        luminance = np.stack([part.luminance_cd_m2 for part in maps])
        sound = np.stack([_usable(part) for part in maps])
        exposure_s = np.array([part.frame.exposure_s for part in self.exposures], np.float32)[:, None, None]
        expected = _mean(luminance, sound * exposure_s)
        spread = self._each(lambda part: part.variance_at(expected))
        limit = self._each(lambda part: self.conversion.to_luminance(part.full, window).luminance_cd_m2)
        # Pixels that the expected luminance does not saturate, noise considered.
        usable = sound & (expected + _SATURATION_MARGIN * np.sqrt(spread) < limit)
        # Where no exposure is left, the shortest unsaturated one is used; where there is none, the shortest.
        nothing = ~usable.any(axis=0)
        shortest = sound.argmax(axis=0)[None]
        np.put_along_axis(usable, shortest, np.take_along_axis(usable | (sound & nothing), shortest, axis=0), axis=0)
        nothing = ~usable.any(axis=0)
        weights = np.where(usable, 1 / spread, np.float32(0))
        weights[0][nothing] = 1
        weights /= weights.sum(axis=0)
        mean = _mean(luminance, weights)
        flags = np.stack([part.invalid for part in maps])
        invalid = np.bitwise_and.reduce(np.where(usable, flags, np.uint8(0xFF)), axis=0)
        invalid = np.where(nothing, flags[0], invalid)
        invalid[self._inconsistent(luminance, usable, mean)] |= Invalid.INCONSISTENT.value
        magnitude = np.maximum(np.abs(mean), np.float32(1e-30))
        variance, slow, fixed, common2 = (np.zeros(mean.shape, np.float32) for _ in range(4))
        for part, seen, weight in zip(maps, luminance, weights, strict=True):
            slow += np.square(weight * part.slow_cd_m2)
            fixed += weight * part.fixed_cd_m2
            of_frame = np.maximum(part.random_rel**2 - part.fixed_rel**2, 0) * np.square(seen)
            noise = np.maximum(of_frame - np.square(part.fixed_cd_m2), 0)
            variance += np.where(weight > 0, np.square(weight) * noise, 0)
        shares = luminance * weights / np.where(mean < 0, -magnitude, magnitude)
        common = _common([part.common_in(WHOLE) for part in maps], shares)
        for error in common:
            common2 += np.square(error.relative)
        return {
            "mean": mean,
            "random_rel": np.sqrt((variance + fixed**2) / magnitude**2 + np.float32(self.fixed_rel) ** 2),
            "slow_cd_m2": np.sqrt(slow),
            "fixed_cd_m2": fixed,
            "common_rel": np.sqrt(common2),
            "invalid": invalid,
            "n_used": usable.sum(axis=0, dtype=np.uint8),
        }, common

    def _each(self, compute: Callable[[_Exposure], NDArray[Any]]) -> NDArray[Any]:
        """Values of all frames, computed once for those that are alike, shape (frames, height, width)."""
        values: list[NDArray[Any]] = []
        for number, exposure in enumerate(self.exposures):
            values.append(compute(exposure) if exposure.first == number else values[exposure.first])
        return np.stack(values)

    def _inconsistent(self, luminance: _Array, usable: NDArray[np.bool_], mean: _Array) -> NDArray[np.bool_]:
        from scipy.special import chdtri

        by_tolerance = np.square(np.float32(SMALL_EFFECT_REL) * mean)
        # The dark signal's error of a pixel is the same in all frames: their squares add to one square of it.
        dark = np.float32(len(self.exposures))
        variance = self._each(
            lambda exposure: exposure.variance_at(mean) + dark * np.float32(exposure.dark_cd_m2**2) + by_tolerance
        )
        chi_squared = np.sum(np.square(luminance - mean) / variance, axis=0, where=usable)
        chance = _CHANCE / (self.shape[0] * self.shape[1])
        limits = [np.inf, np.inf, *(chdtri(k - 1, chance) for k in range(2, len(luminance) + 1))]
        contradicts: NDArray[np.bool_] = chi_squared > np.array(limits)[usable.sum(axis=0)]
        return contradicts


def _usable(luminance: LuminanceMap) -> NDArray[np.bool_]:
    usable: NDArray[np.bool_] = np.equal(luminance.invalid & (Invalid.SATURATED | Invalid.DEFECT), 0)
    return usable


def _mean(luminance: _Array, weights: _Array) -> _Array:
    total = weights.sum(axis=0)
    mean: _Array = np.einsum("iyx,iyx->yx", luminance, weights) / np.where(total > 0, total, 1)
    return mean


def _noise(exposed: LuminanceMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Knots of the variance of an exposure's pixels over the luminance, as a sample of them has it."""
    good = np.flatnonzero(_usable(exposed))
    sample = good[:: max(good.size // _SAMPLES, 1)]
    luminance = exposed.luminance_cd_m2.ravel()[sample].astype(float)
    relative = np.sqrt(np.maximum(exposed.random_rel.ravel()[sample].astype(float) ** 2 - exposed.fixed_rel**2, 0))
    finite = np.isfinite(relative)  # a pixel without signal may have no relative uncertainty
    luminance, variance = luminance[finite], (relative[finite] * luminance[finite]) ** 2
    if luminance.size == 0:
        return np.zeros(1), np.ones(1)
    order = np.argsort(luminance)
    parts = [part for part in np.array_split(order, _KNOTS) if part.size]
    knots, values = (np.array([of[part].mean() for part in parts]) for of in (luminance, variance))
    return knots, np.maximum(values, max(float(values.max()), 1e-30) * 1e-12)


def _common(of_each: Sequence[tuple[CommonError, ...]], shares: _Array) -> tuple[CommonError, ...]:
    """Weight the errors of the exposures as the exposures are."""
    totals: list[CommonError] = []
    for errors in zip(*of_each, strict=True):
        if all(np.ndim(e.relative) == 0 and e.relative == errors[0].relative for e in errors):
            totals.append(errors[0])
        else:
            parts = (share * e.relative for share, e in zip(shares, errors, strict=True))
            totals.append(replace(errors[0], relative=sum(parts, start=np.zeros((), np.float32))))
    return tuple(totals)


def _findings(exposures_s: tuple[float, ...], combined: LuminanceMap, share: float) -> tuple[Finding, ...]:
    findings = [warning("exposures-inconsistent", share=share)] if share > _REPORTED_SHARE else []
    saturated = float(np.mean(np.not_equal(combined.invalid & Invalid.SATURATED, 0)))
    if saturated > 0:
        findings.append(warning("pixels-saturated", share=saturated, exposure_s=exposures_s[0]))
    return tuple(findings)
