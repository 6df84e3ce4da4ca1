"""One luminance map from several exposures of a still scene (high dynamic range)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.finding import Finding, warning
from ...core.frame import Frame
from ...core.luminance import CommonError, Conversion, Invalid, LuminanceMap, Window, require_alike
from ..frames.observations import CameraState

#: Required distance of a pixel's expected value from saturation, in standard deviations of its noise.
_SATURATION_MARGIN = 3.0
#: Tolerated relative difference of exposures, by errors of exposure times and linearity.
TOLERANCE_REL = 0.002
#: p-value of chi^2 below which the exposures of a pixel are inconsistent.
_CHANCE = 1e-6
#: Share of inconsistent pixels that is reported.
_REPORTED_SHARE = 1e-4
#: Number of pixels for the noise model of an exposure.
_SAMPLES = 20_000

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


class CalibratedCamera(Conversion, Protocol):
    """Conversion of a camera in one state."""

    @property
    def state(self) -> CameraState:
        """Camera and settings."""
        ...


def bracket_luminance(conversion: CalibratedCamera, frames: Sequence[Frame]) -> Bracket:
    """Luminance of a still scene from frames at several exposures.

    Each pixel is the mean of its exposures with the inverse of their variances as weights, which minimises its
    variance. Saturated and defect pixels are excluded. The weights follow from the mean luminance, not from each
    exposure's value, as noise would give low values more weight. For the same reason an exposure is excluded where
    saturation is expected within three standard deviations of the mean luminance. Common errors are the same in all
    exposures and are weighted like these; so is the noise of flat field and dark library, treated as one error of a
    pixel at all exposures. Exposures that differ by more than noise and `TOLERANCE_REL` (chi^2) are flagged: something
    moved or flickered.

    Parameters
    ----------
    conversion : Calibration or ColourCalibration
        A calibration, or another conversion.
    frames : sequence of Frame
        At least one, of one camera and setting; several of one exposure are averaged.

    Raises
    ------
    CalibrationError
        If there is no frame, or one is not of the conversion's camera and setting.
    """
    if not frames:
        raise CalibrationError("there is no frame: give the frames of a bracket, at best at 3 exposures or more")
    ordered = sorted(frames, key=lambda frame: frame.exposure_s)
    maps = [conversion.to_luminance(frame) for frame in ordered]
    require_alike(maps)
    usable = [_usable(one) for one in maps]
    first = _combined(
        maps, [np.where(use, np.float32(f.exposure_s), 0) for use, f in zip(usable, ordered, strict=True)]
    )
    usable = [
        use & _unsaturated(conversion, frame, one, first) for use, frame, one in zip(usable, ordered, maps, strict=True)
    ]
    # Where no exposure is left, the shortest unsaturated one is used.
    nothing = ~np.any(usable, axis=0)
    for i, one in enumerate(maps):
        fallback = nothing & _usable(one)
        usable[i] = usable[i] | fallback
        nothing &= ~fallback
    weights = _normalised([np.where(use, 1 / _variance(one, first), 0) for use, one in zip(usable, maps, strict=True)])
    weights[0] = np.where(nothing, 1, weights[0])
    mean = _combined(maps, weights)
    inconsistent = _inconsistent(maps, usable, mean)
    share = float(inconsistent.mean())
    combined = _map(maps, weights, mean, _flags(maps, usable, nothing, inconsistent))
    n_used: NDArray[np.uint8] = np.asarray(usable).sum(axis=0, dtype=np.uint8)
    exposures_s = tuple(frame.exposure_s for frame in ordered)
    return Bracket(combined, n_used, exposures_s, share, _findings(exposures_s, combined, share))


def _usable(one: LuminanceMap) -> NDArray[np.bool_]:
    usable: NDArray[np.bool_] = np.equal(one.invalid & (Invalid.SATURATED | Invalid.DEFECT), 0)
    return usable


def _normalised(weights: Sequence[_Array]) -> list[_Array]:
    total = np.sum(weights, axis=0)
    return [weight / np.where(total > 0, total, 1) for weight in weights]


def _combined(maps: Sequence[LuminanceMap], weights: Sequence[_Array]) -> _Array:
    shares = _normalised(weights)
    mean: _Array = np.sum([share * one.luminance_cd_m2 for share, one in zip(shares, maps, strict=True)], axis=0)
    return mean


def _unsaturated(conversion: CalibratedCamera, frame: Frame, one: LuminanceMap, expected: _Array) -> NDArray[np.bool_]:
    """Pixels that the expected luminance does not saturate, noise considered."""
    saturation_dn = min(frame.saturation_dn, conversion.state.saturation_dn)
    full = frame.with_pixels(np.full_like(frame.dn, int(saturation_dn)))
    limit = conversion.to_luminance(full).luminance_cd_m2
    unsaturated: NDArray[np.bool_] = expected + _SATURATION_MARGIN * np.sqrt(_variance(one, expected)) < limit
    return unsaturated


def _variance(one: LuminanceMap, expected: _Array) -> _Array:
    """Variance of an exposure's pixels over the luminance: a + b L, as photons and dark signal make it."""
    good = np.flatnonzero(_usable(one))
    if good.size == 0:
        return np.full(expected.shape, 1.0)
    sample = good[:: max(good.size // _SAMPLES, 1)]
    luminance = one.luminance_cd_m2.ravel()[sample].astype(float)
    relative = np.sqrt(np.maximum(one.random_rel.ravel()[sample].astype(float) ** 2 - one.fixed_rel**2, 0))
    finite = np.isfinite(relative)  # a pixel without signal may have no relative uncertainty
    luminance, variance = luminance[finite], (relative[finite] * luminance[finite]) ** 2
    least = max(float(variance.max(initial=0)), 1e-30) * 1e-12
    variance = np.maximum(variance, least)
    design = np.column_stack([np.ones_like(luminance), luminance])
    if luminance.size < 2 or np.ptp(luminance) == 0:
        return np.full(expected.shape, float(variance.mean()) if variance.size else 1.0)
    a, b = np.linalg.lstsq(design / variance[:, None], np.ones_like(variance))[0]
    fitted: _Array = np.maximum(a + b * np.maximum(expected, 0), float(variance.min()))
    return fitted


def _inconsistent(maps: Sequence[LuminanceMap], usable: Sequence[NDArray[np.bool_]], mean: _Array) -> NDArray[np.bool_]:
    from scipy.special import chdtri

    chi_squared, n = np.zeros(mean.shape), np.zeros(mean.shape, dtype=np.int64)
    for one, use in zip(maps, usable, strict=True):
        variance = _variance(one, mean) + (TOLERANCE_REL * mean) ** 2
        chi_squared += np.where(use, (one.luminance_cd_m2 - mean) ** 2 / variance, 0)
        n += use
    limits = np.array([np.inf, np.inf, *(float(chdtri(k - 1, _CHANCE)) for k in range(2, len(maps) + 1))])
    contradicts: NDArray[np.bool_] = chi_squared > limits[n]
    return contradicts


def _flags(
    maps: Sequence[LuminanceMap],
    usable: Sequence[NDArray[np.bool_]],
    nothing: NDArray[np.bool_],
    inconsistent: NDArray[np.bool_],
) -> NDArray[np.uint8]:
    """Return the flags that all exposures in use have, or where none is, those of the shortest."""
    flags = np.full(nothing.shape, 0xFF, dtype=np.uint8)
    for one, use in zip(maps, usable, strict=True):
        flags &= np.where(use, one.invalid, 0xFF).astype(np.uint8)
    flags = np.where(nothing, maps[0].invalid, flags).astype(np.uint8)
    flags[inconsistent] |= Invalid.INCONSISTENT.value
    return flags


def _map(
    maps: Sequence[LuminanceMap], weights: Sequence[_Array], mean: _Array, invalid: NDArray[np.uint8]
) -> LuminanceMap:
    fixed_rel = max(one.fixed_rel for one in maps)
    magnitude = np.maximum(np.abs(mean), 1e-30)
    variance, slow, fixed = np.zeros(mean.shape), np.zeros(mean.shape), np.zeros(mean.shape)
    for one, weight in zip(maps, weights, strict=True):
        slow += np.square(weight * one.slow_cd_m2)
        fixed += weight * one.fixed_cd_m2
        of_frame = np.maximum(one.random_rel**2 - one.fixed_rel**2, 0) * np.square(one.luminance_cd_m2)
        variance += np.where(weight > 0, weight**2 * np.maximum(of_frame - np.square(one.fixed_cd_m2), 0), 0)
    random_rel = np.sqrt((variance + fixed**2) / magnitude**2 + fixed_rel**2)

    def common(window: Window) -> tuple[CommonError, ...]:
        """Weight the errors of the exposures as the exposures are."""
        totals: list[CommonError] = []
        for errors in zip(*(one.common_in(window) for one in maps), strict=True):
            if all(np.ndim(e.relative) == 0 and e.relative == errors[0].relative for e in errors):
                totals.append(errors[0])
                continue
            parts = (
                w[window] * one.luminance_cd_m2[window] * e.relative
                for e, w, one in zip(errors, weights, maps, strict=True)
            )
            signed = np.where(mean[window] < 0, -magnitude[window], magnitude[window])
            totals.append(replace(errors[0], relative=sum(parts, start=np.zeros(())) / signed))
        return tuple(totals)

    return LuminanceMap(
        mean.astype(np.float32),
        random_rel.astype(np.float32),
        common,
        invalid,
        slow_rel=max(one.slow_rel for one in maps),
        slow_cd_m2=np.sqrt(slow),
        fixed_rel=fixed_rel,
        fixed_cd_m2=fixed,
        step=maps[0].step,
    )


def _findings(exposures_s: tuple[float, ...], combined: LuminanceMap, share: float) -> tuple[Finding, ...]:
    findings = []
    if share > _REPORTED_SHARE:
        findings.append(warning("exposures-inconsistent", share=share))
    saturated = float(np.mean(np.not_equal(combined.invalid & Invalid.SATURATED, 0)))
    if saturated > 0:
        findings.append(warning("pixels-saturated", share=saturated, exposure_s=exposures_s[0]))
    return tuple(findings)
