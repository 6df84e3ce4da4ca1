"""What a lens does to the image beside vignetting: defocus and a halo."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .world import World

Array = NDArray[np.float64]
#: Points along each side of a pixel over which the edge of a disc is averaged, and standard deviations of a halo.
_POINTS, _REACH = 5, 3


def spread(light: Array, world: World) -> Array:
    """Spread the light of each point over a disc and a halo; beyond the image it goes on as at its border.

    A defocused lens makes a disc of each point, evenly lit if it is free of aberrations (geometrical optics; M. Born
    and E. Wolf, Principles of Optics, chapter 4). Light scattered at surfaces close to the sensor, and a damp or dusty
    lens, make a halo: a Gaussian one here, which takes its light from the point (glare spread function of ISO 9358).
    For grey scenes: filters would have to be applied after it.
    """
    if not (world.blur_px or world.halo_rel):
        return light
    pad = _half_width(world.blur_px, world.halo_px if world.halo_rel else 0.0)
    return _convolved(np.pad(light, pad, mode="edge"), _kernel(world.blur_px, world.halo_rel, world.halo_px))


def _half_width(blur_px: float, halo_px: float) -> int:
    return int(np.ceil(max(blur_px + 1, _REACH * halo_px)))


@lru_cache(maxsize=8)
def _kernel(blur_px: float, halo_rel: float, halo_px: float) -> Array:
    """Light of a point on the pixels around it, of sum 1."""
    half = _half_width(blur_px, halo_px if halo_rel else 0.0)
    fine = (np.arange((2 * half + 1) * _POINTS) + 0.5) / _POINTS - half - 0.5
    r2 = fine[:, None] ** 2 + fine[None, :] ** 2
    # A sharp point fills its pixel.
    sharp = np.maximum(np.abs(fine[:, None]), np.abs(fine[None, :])) < 0.5
    disc = r2 <= blur_px**2 if blur_px > 0.5 else sharp
    point = disc / disc.sum()
    if halo_rel:
        halo = np.exp(-r2 / (2 * halo_px**2))
        point = (1 - halo_rel) * point + halo_rel * halo / halo.sum()
    by_pixel: Array = point.reshape(2 * half + 1, _POINTS, 2 * half + 1, _POINTS).sum(axis=(1, 3))
    return by_pixel


def _convolved(padded: Array, kernel: Array) -> Array:
    """Convolution where the kernel lies inside, shape of the image without its border."""
    spectrum = np.fft.rfft2(padded) * np.fft.rfft2(kernel, padded.shape)
    size = kernel.shape[0] - 1
    inside = np.fft.irfft2(spectrum, padded.shape)[size:, size:]
    return np.maximum(inside, 0.0)
