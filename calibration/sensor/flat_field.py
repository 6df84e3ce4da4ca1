"""Vignetting from frames of a uniform source: flat field and radial polynomial."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.clock import exposure_text
from ...core.dn import Response
from ...core.errors import CalibrationError
from ...core.result import Finding, info
from ...core.vignetting import FlatField, RadialVignetting, middle_of
from ..frames.measure import MeasuredFrames
from .dark_fit import as_rows
from .defects import block_means, median_around, pixel_pattern, structure_findings

Array = NDArray[np.float64]

#: Largest share of pixels without usable values that are treated as defects.
_MAX_UNKNOWN_SHARE = 0.01
#: Responsivity relative to the neighbours below which a pixel is dead and replaced by theirs.
_DEAD = 0.05
#: Critical value, in standard deviations, of the non-radial part of the map.
_SIGNIFICANT = 3.0


@dataclass(frozen=True, eq=False)
class MeasuredVignetting:
    """Results for V from frames of a uniform source.

    Parameters
    ----------
    flat : FlatField
        The measured map.
    radial : RadialVignetting
        The polynomial through it.
    chosen : FlatField or RadialVignetting
        Selected vignetting.
    findings : tuple of Finding
        The reason, with the standard deviations of the responsivity from pixel to pixel (EMVA 1288: PRNU) and of smooth
        residuals of the polynomial, noise removed; then steps, spots and other artefacts.
    """

    flat: FlatField
    radial: RadialVignetting
    chosen: FlatField | RadialVignetting
    findings: tuple[Finding, ...]


def measure_vignetting(
    lights: Sequence[MeasuredFrames],
    darks: Sequence[MeasuredFrames],
    source_nonuniformity_rel: float,
    response: Response | None = None,
) -> MeasuredVignetting:
    """Make a flat field from frames of a uniform source, fit the radial polynomial, and select one of them.

    The dark signal is subtracted pixel by pixel at each exposure. Exposures are normalised by their medians and
    averaged with inverse noise variances as weights, without clipped pixels. The flat field is selected if it contains
    significant structure that the polynomial does not: the pattern of the pixels, or smooth non-radial changes.

    Parameters
    ----------
    lights : sequence of MeasuredFrames
        Of the uniform source, one for each exposure, at least 2 frames each, best at half of saturation.
    darks : sequence of MeasuredFrames
        Of dark frames at the same exposures.
    source_nonuniformity_rel : float
        Relative standard uncertainty of the source's uniformity by its certificate, for example 0.01.
    response : Response or None
        Response of the camera; None for linear.

    Raises
    ------
    CalibrationError
        If there are no light frames, dark frames are missing for an exposure, cameras or settings differ, frames are
        not repeated, or too many pixels are clipped at every exposure.
    """
    level, mean_variance, unknown = _averaged(_signals(lights, darks, response or Response()))
    if unknown.mean() > _MAX_UNKNOWN_SHARE:
        raise CalibrationError(
            f"{unknown.mean():.1%} of the pixels are saturated or black in all light frames: add a shorter or longer "
            "exposure, best with the source at half of saturation"
        )
    scale = level[middle_of(level.shape)].mean()
    relative = _repaired(level / scale, unknown)
    random_rel = float(np.median(np.sqrt(mean_variance) / scale / relative))
    relative /= relative[middle_of(relative.shape)].mean()
    n_frames = sum(light.n_frames for light in lights)
    flat = FlatField(relative.astype(np.float32), random_rel, source_nonuniformity_rel, n_frames)
    prnu_rel = pixel_pattern(relative, random_rel)
    pixel_rel = hypot(random_rel, prnu_rel)
    radial, not_radial_rel = _fit_radial(relative, pixel_rel, source_nonuniformity_rel)
    shape = "flat-field-for-shape" if not_radial_rel > random_rel else "flat-field-radial"
    code = "flat-field-for-pixels" if prnu_rel > random_rel else shape
    sizes = {"prnu_rel": prnu_rel, "not_radial_rel": not_radial_rel, "noise_rel": random_rel}
    findings = info(code, **sizes, n_frames=n_frames), *structure_findings(relative, radial, pixel_rel)
    return MeasuredVignetting(flat, radial, radial if code == "flat-field-radial" else flat, findings)


class _Signal(NamedTuple):
    """Linearised signal above dark of one exposure, its variance for a typical pixel, and what is clipped."""

    net: Array
    variance: float
    clipped: NDArray[np.bool_]


def _signals(
    lights: Sequence[MeasuredFrames], darks: Sequence[MeasuredFrames], response: Response
) -> Iterator[_Signal]:
    if not lights:
        raise CalibrationError("there is no light frame: take frames of a uniform source")
    by_exposure = {dark.exposure_s: dark for dark in darks}
    for light in lights:
        at = exposure_text(light.exposure_s)
        lights[0].state.require(light.state, "the first light frames", f"the set at {at}")
        if light.exposure_s not in by_exposure:
            raise CalibrationError(f"there are no dark frames at {at}, the exposure of light frames: take at least 2")
        dark = by_exposure[light.exposure_s]
        light.state.require_alike([dark], "the light frames")
        if min(light.n_frames, dark.n_frames) < 2:
            raise CalibrationError(
                f"there is a single frame at {at}: take at least 2 light and 2 dark frames, so that noise can be "
                "distinguished from pattern"
            )
        above = light.image_dn.astype(float) - dark.image_dn
        slope = float(response.slope(np.median(above)))
        noise = light.pixel_mean_variance_dn2 + dark.pixel_mean_variance_dn2
        yield _Signal(response.linearise(above), slope**2 * noise, light.clipped)


def _averaged(signals: Iterable[_Signal]) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Noise-weighted mean of the exposures at the level of the first usable one, its variance, and what is unknown."""
    every = [*signals]
    usable = [group for group in every if group.clipped.mean() < 1]
    total, weight = np.zeros((2, *every[0].net.shape))
    for group in usable:
        both = ~(usable[0].clipped | group.clipped)
        if not both.any():
            continue
        # Ratio of medians over the same pixels, so that clipped pixels of one do not shift it.
        scale = float(np.median(group.net[both]) / np.median(usable[0].net[both]))
        if not scale > 0:
            raise CalibrationError("light frames are not brighter than the dark ones: take frames of a uniform source")
        w = np.where(group.clipped, 0.0, scale**2 / group.variance)
        total += w * group.net / scale
        weight += w
    unknown = weight == 0
    weight[unknown] = 1.0
    return total / weight, 1 / weight, unknown


def _repaired(relative: Array, unknown: NDArray[np.bool_]) -> Array:
    """Give pixels without a usable value that of their neighbours."""
    around = median_around(np.where(unknown, 1.0, relative))
    bad = unknown | (relative < _DEAD * around)
    if around.min() <= 0:
        raise CalibrationError("parts of the light frames are not brighter than the dark ones: light the whole sensor")
    return np.where(bad, around, relative)


def _fit_radial(relative: Array, pixel_rel: float, slow_rel: float) -> tuple[RadialVignetting, float]:
    """Least-squares fit of b0 (1 + a2 r^2 + a4 r^4 + a6 r^6) to means of blocks, with relative errors.

    Residuals are treated as noise, of which a pixel has `pixel_rel`. The covariance of the coefficients follows from
    the residuals (GUM, H.3), b0 being fixed by the middle.
    """
    shape = (relative.shape[0], relative.shape[1])
    r2 = block_means(RadialVignetting(0, 0, 0).squared_radius(shape))
    means = block_means(relative)
    pixels = relative.size / means.size
    design = np.column_stack([r2.ravel() ** power for power in range(4)])
    design /= means.reshape(-1, 1)
    parameters, *_ = np.linalg.lstsq(design, np.ones(means.size))
    left = 1 - design @ parameters
    dof = max(left.size - 4, 1)
    variance = float(left @ left) / dof
    inverse = np.linalg.inv(design.T @ design)
    coefficients = parameters[1:] / parameters[0]
    by_parameter = np.column_stack([-coefficients / parameters[0], np.eye(3) / parameters[0]])
    covariance = by_parameter @ (variance * inverse) @ by_parameter.T
    of_noise = pixel_rel**2 / pixels
    # The standard deviation of a variance is sqrt(2 / dof) of it.
    significant = variance > of_noise * (1 + _SIGNIFICANT * sqrt(2 / dof))
    not_radial = sqrt(variance - of_noise) if significant else 0.0
    a2, a4, a6 = coefficients.tolist()
    return RadialVignetting(a2, a4, a6, None, as_rows(covariance), hypot(slow_rel, not_radial)), not_radial
