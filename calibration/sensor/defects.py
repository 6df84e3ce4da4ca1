"""Defect pixels by robust limits in dark and flat frames; spots and steps of a flat field."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.result import Finding, warning
from ...core.vignetting import RadialVignetting
from ..frames.defects import Defect, DefectMap
from ..frames.measure import MeasuredFrames

Array = NDArray[np.float64]

#: Robust standard deviations from the median beyond which a pixel of the dark image is hot. None of five million normal
#: pixels is expected there.
HOT_LIMIT = 8.0
#: Responsivity over that of the neighbourhood below or above which a pixel is dead.
DEAD_LIMITS = (0.5, 1.5)
#: False-alarm probability of a noisy pixel.
NOISY_CHANCE = 1e-9
#: Fewest frames of one exposure for detecting noisy pixels.
MIN_FRAMES_NOISY = 8
#: Blocks along the longer side of the image for smooth changes.
_BLOCKS = 32
#: Critical value of steps and spots, in standard deviations, for the many positions of a megapixel image.
_SURE = 8.0
#: Relative size from which a spot or a step, and non-radial changes, are relevant.
_MATTERS_REL, _NOT_RADIAL_REL = 0.01, 0.01
#: Side of the window for spots, and of its surroundings, in pixels.
_SPOT, _AROUND = 7, 41


def find_defects(dark: MeasuredFrames, light: MeasuredFrames | None = None) -> DefectMap:
    """Find defect pixels.

    EMVA 1288 leaves the limits to the user but recommends robust ones; here they are multiples of 1.4826 times the
    median absolute deviation, which the defects do not affect. hot: the mean dark value is more than `HOT_LIMIT` of
    them above or below the median. dead: the responsivity is outside `DEAD_LIMITS` times the median of the 5 x 5 pixels
    around. stuck: the pixel has the same value in light as in the dark, or is constant while its neighbours vary.
    noisy: the variance over the frames exceeds that expected with probability `NOISY_CHANCE` for a normal pixel (chi^2
    distribution); only from `MIN_FRAMES_NOISY` frames on.

    Parameters
    ----------
    dark : MeasuredFrames
        Of dark frames, best at the longest exposure in use.
    light : MeasuredFrames or None
        Of frames of a uniform source at half of saturation; None detects only hot and noisy pixels.

    Raises
    ------
    CalibrationError
        If the two are of different sizes, or the light is not brighter than the dark.
    """
    reasons = np.zeros(dark.shape, dtype=np.uint8)
    deviation = dark.image_dn - np.median(dark.image_dn)
    # Not below noise and rounding of a mean over the frames.
    robust_std = max(1.4826 * float(np.median(np.abs(deviation))), sqrt(dark.pixel_mean_variance_dn2))
    reasons[np.abs(deviation) > HOT_LIMIT * robust_std] |= Defect.HOT.value
    reasons[_noisy(dark)] |= Defect.NOISY.value
    if light is not None:
        if light.shape != dark.shape:
            raise CalibrationError(f"the dark frames are {dark.shape} pixels, the light frames {light.shape}")
        net = light.image_dn - dark.image_dn
        around = median_around(net)
        typical = float(np.median(net))
        if typical < 5 * sqrt(dark.typical_variance_dn2 + dark.rounding_dn2_of_pixel):
            raise CalibrationError(
                f"the light frames are {typical:.3g} DN above the dark ones, too little to find dead pixels: light the "
                "sensor to half of its saturation"
            )
        low, high = DEAD_LIMITS
        reasons[(net < low * around) | (net > high * around)] |= Defect.DEAD.value
        unmoved = (light.variance_image_dn2 == 0) & (np.median(light.variance_image_dn2) > 0.5) & (light.n_frames > 3)
        same = np.abs(net) <= 0.02 * np.maximum(around, 0)
        reasons[same | unmoved] |= Defect.STUCK.value
        reasons[_noisy(light)] |= Defect.NOISY.value
    return DefectMap.of(reasons)


def _noisy(statistics: MeasuredFrames) -> NDArray[np.bool_]:
    """Pixels whose variance is too large compared with neighbours of equal signal."""
    from scipy.special import chdtri

    if statistics.n_frames < MIN_FRAMES_NOISY:
        return np.zeros(statistics.shape, dtype=np.bool_)
    dof = statistics.n_frames - 1
    typical = statistics.typical_variance_dn2
    brightest = max(
        float(np.quantile(statistics.image_dn, 0.99)) / max(float(np.median(statistics.image_dn)), 1e-9), 1.0
    )
    limit = typical * brightest * float(chdtri(dof, NOISY_CHANCE)) / dof
    noisy: NDArray[np.bool_] = statistics.variance_image_dn2 > max(limit, statistics.rounding_dn2_of_pixel)
    return noisy


def median_around(image: NDArray[np.floating[Any]]) -> Array:
    """Median of the 5 x 5 pixels around each pixel; pixels beyond the edge repeat those at it."""
    import cv2

    around: Array = cv2.medianBlur(image.astype(np.float32), 5).astype(np.float64)
    return around


def block_means(image: Array) -> Array:
    """Means over about 32 blocks along the longer side; a rest at the lower and right edge is left out."""
    side = max(max(image.shape) // _BLOCKS, 1)
    height, width = (n // side * side for n in image.shape)
    blocks: Array = image[:height, :width].reshape(height // side, side, width // side, side).mean((1, 3))
    return blocks


def pixel_pattern(relative: Array, random_rel: float) -> float:
    """Estimate the standard deviation of the responsivity from pixel to pixel, noise removed.

    From second differences along the rows, (1, -2, 1), which suppress smooth changes; the median of their magnitude is
    robust against defects.
    """
    differences = np.diff(relative, n=2, axis=1) / relative[:, 1:-1]
    together = 1.4826 * float(np.median(np.abs(differences))) / sqrt(6)
    return sqrt(max(together**2 - random_rel**2, 0.0))


def structure_findings(relative: Array, radial: RadialVignetting, pixel_rel: float) -> tuple[Finding, ...]:
    """Return warnings about spots, steps and non-radial changes.

    Parameters
    ----------
    relative : ndarray of float, shape (height, width)
        The flat field.
    radial : RadialVignetting
        The polynomial through it.
    pixel_rel : float
        Standard deviation of a pixel by noise and its own pattern.
    """
    shape = (relative.shape[0], relative.shape[1])
    flattened = relative / radial.relative_illuminance(shape)
    return (*_not_radial(flattened), *_steps(flattened, pixel_rel), *_spots(flattened, pixel_rel))


def _not_radial(flattened: Array) -> list[Finding]:
    smooth = block_means(flattened)
    spread = float(np.ptp(smooth))
    if spread <= 2 * _NOT_RADIAL_REL:
        return []
    position = np.unravel_index(int(np.argmax(np.abs(smooth - np.median(smooth)))), smooth.shape)
    row, column = (3 * int(at) // n for at, n in zip(position, smooth.shape, strict=True))
    where = f"{('top', 'middle', 'bottom')[row]} {('left', 'middle', 'right')[column]}"
    return [warning("flat-not-radial", change_rel=spread, where=where)]


def _steps(flattened: Array, pixel_rel: float) -> list[Finding]:
    """Rows or columns of a brightness step, as between sensor taps of different gain."""
    findings = []
    for axis, name in ((0, "column"), (1, "row")):
        profile = flattened.mean(axis=axis)
        half = 8
        if profile.size <= 2 * half:
            continue
        sums = np.concatenate([[0.0], np.cumsum(profile)])
        means = (sums[half:] - sums[:-half]) / half
        change = means[half:] - means[:-half]  # of the 8 from an index on, and the 8 before
        at = int(np.argmax(np.abs(change)))
        noise = pixel_rel / sqrt(flattened.shape[axis]) * sqrt(2 / half)
        # A smooth change persists farther away; a step does not.
        smooth = float(np.median(np.abs(change)))
        if abs(change[at]) > max(_SURE * noise, 4 * smooth, 0.5 * _MATTERS_REL):
            step_rel = float(abs(change[at]))
            findings.append(warning("flat-step", f"{name} {at + half}", step_rel=step_rel))
    return findings


def _spots(flattened: Array, pixel_rel: float) -> list[Finding]:
    """Small dark spots, as by dust."""
    import cv2

    if min(flattened.shape) < 2 * _AROUND:
        return []
    image = flattened.astype(np.float32)
    limit = max(_SURE * pixel_rel / _SPOT, _MATTERS_REL)
    around = cv2.blur(image, (_AROUND, _AROUND))
    dark = (cv2.blur(cv2.medianBlur(image, 3), (_SPOT, _SPOT)) < around - limit).astype(np.uint8)
    n, labels = cv2.connectedComponents(dark)
    if n == 1:
        return []
    y, x = (int(v.mean()) for v in np.nonzero(labels == 1))
    return [warning("flat-spots", count=n - 1, limit_rel=limit, x_px=x, y_px=y)]
