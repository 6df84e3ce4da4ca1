"""How well a template fits where it is put, compiled: see `labcdp.tracking.alignment`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled
from .level_kernel import Bounds, Pixels, first_light, nothing_seen, sample
from .select_kernel import median

#: Residual of a pixel that is still found again: times the noise, and in parts of the structure.
_AGREES_NOISE, _AGREES_STRUCTURE = 2.5, 0.25
#: Deviation of a region's own pixels from which on they are covered: times the noise, and in parts of the structure.
_COVERED_NOISE, _COVERED_STRUCTURE = 5.0, 0.2
#: Own pixels below which none is said to be covered.
_OWN_LEAST = 4


@compiled
def judge(
    image: NDArray[np.float32], bounds: Bounds, pixels: Pixels, to_view: NDArray[np.float64],
    guesses: NDArray[np.float64], carries: NDArray[np.float32], inside: NDArray[np.bool_],
) -> tuple[float, float, float, float, float, NDArray[np.float32], NDArray[np.float32]]:  # fmt: skip
    """Say how well the pixels fit at `to_view`.

    Parameters
    ----------
    carries : ndarray of float32, shape (n,)
        Structure that each pixel carries.
    inside : ndarray of bool, shape (n,)
        Which pixels are the region's own.

    Returns
    -------
    gain, offset, quality, covered, in_image : float
        See `labcdp.tracking.alignment.Fit`; gain 0 if nothing is found.
    agrees : ndarray of float32, shape (n,)
        How far each pixel is found again; nan outside the image.
    values : ndarray of float32, shape (n,)
        The view under each pixel.
    """
    n = pixels.trust.size
    seen = nothing_seen(n)
    sample(image, bounds, to_view, pixels, seen)
    agrees = seen.robust
    light = first_light(pixels, seen, guesses)
    gain = light[0]
    if gain == 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, agrees, seen.values
    structure, noise = pixels.structure, pixels.noise * np.sqrt(1 + 1 / gain**2)
    over = np.float32(1 / np.hypot(_AGREES_NOISE * noise, _AGREES_STRUCTURE * structure))
    one = np.float32(1)
    whole = found = 0.0
    n_seen = 0
    for i in range(n):
        ratio = seen.residuals[i] * over
        squared = ratio * ratio
        agrees[i] = one / (one + squared * squared)
        whole += carries[i] * pixels.trust[i]
        found += carries[i] * seen.trusted[i] * agrees[i]
        if seen.trusted[i] == 0:
            agrees[i] = np.nan
        else:
            n_seen += 1
    # Whatever there is agrees with noise as strong as the structure.
    quality = found / max(whole, 1e-9) * min(1.0, (structure / max(_AGREES_NOISE * noise, 1e-9)) ** 2)
    most = np.hypot(_COVERED_NOISE * noise, _COVERED_STRUCTURE * structure)
    covered = _share_off(seen.residuals, agrees, inside, most)
    return gain, light[1], quality, covered, n_seen / n, agrees, seen.values


@compiled
def _share_off(
    residuals: NDArray[np.float32], agrees: NDArray[np.float32], inside: NDArray[np.bool_], most: float
) -> float:
    """Share of a region's own pixels in the image that are more than `most` off their median."""
    own = np.empty_like(residuals)
    n = 0
    for i in range(residuals.size):
        if inside[i] and not np.isnan(agrees[i]):
            own[n] = residuals[i]
            n += 1
    if n < _OWN_LEAST:
        return 0.0
    own = own[:n]
    middle = median(own)
    off = 0
    for i in range(n):
        off += abs(own[i] - middle) > most
    return off / n
