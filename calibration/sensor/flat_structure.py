"""Artefacts of a flat field: steps, spots, slopes."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.result import Finding, warning
from ...core.vignetting import RadialVignetting

#: Blocks along the longer side of the image for smooth changes.
_BLOCKS = 32
#: Critical value of steps and spots, in standard deviations, for the many positions of a megapixel image.
_SURE = 8.0
#: Relative size from which a spot or a step, and non-radial changes, are relevant.
_MATTERS_REL, _NOT_RADIAL_REL = 0.01, 0.01
#: Side of the window for spots, and of its surroundings, in pixels.
_SPOT, _AROUND = 7, 41


def block_means(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over about 32 blocks along the longer side; a rest at the lower and right edge is left out."""
    side = max(max(image.shape) // _BLOCKS, 1)
    height, width = (n // side * side for n in image.shape)
    blocks: NDArray[np.float64] = image[:height, :width].reshape(height // side, side, width // side, side).mean((1, 3))
    return blocks


def pixel_pattern(relative: NDArray[np.float64], random_rel: float) -> float:
    """Estimate the standard deviation of the responsivity from pixel to pixel, noise removed.

    From second differences along the rows, (1, -2, 1), which suppress smooth changes; the median of their magnitude is
    robust against defects.
    """
    differences = np.diff(relative, n=2, axis=1) / relative[:, 1:-1]
    together = 1.4826 * float(np.median(np.abs(differences))) / sqrt(6)
    return sqrt(max(together**2 - random_rel**2, 0.0))


def structure_findings(
    relative: NDArray[np.float64], radial: RadialVignetting, pixel_rel: float
) -> tuple[Finding, ...]:
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


def _not_radial(flattened: NDArray[np.float64]) -> list[Finding]:
    smooth = block_means(flattened)
    spread = float(np.ptp(smooth))
    if spread <= 2 * _NOT_RADIAL_REL:
        return []
    row, column = np.unravel_index(int(np.argmax(np.abs(smooth - np.median(smooth)))), smooth.shape)
    where = f"{_place(row, smooth.shape[0], 'top', 'bottom')} {_place(column, smooth.shape[1], 'left', 'right')}"
    return [warning("flat-not-radial", change_rel=spread, where=where)]


def _place(index: np.intp, n: int, low: str, high: str) -> str:
    third = 3 * int(index) // n
    return low if third == 0 else "middle" if third == 1 else high


def _steps(flattened: NDArray[np.float64], pixel_rel: float) -> list[Finding]:
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


def _spots(flattened: NDArray[np.float64], pixel_rel: float) -> list[Finding]:
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
