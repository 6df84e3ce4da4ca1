"""Point spread of a lens: its modulation transfer function (MTF), and the blur of a sampled scene."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.disk.files import shown
from ..core.errors import InputError

FloatArray = NDArray[np.float64]
#: Pairs of spatial frequency on the sensor in line pairs per mm, and modulation.
MtfTable = tuple[tuple[float, float], ...]

#: Highest frequency of a measured MTF: above what any lens passes, so that those per m are refused.
_MOST_LP_PER_MM = 10_000
#: Most modulation, of cameras that sharpen.
_MOST_MODULATION = 4.0

#: Most periods of the sampling on each side whose frequencies are folded into one, and the modulation that is left out.
_MOST_FOLDS, _NO_MODULATION = 12, 1e-3
#: Smallest and largest side of the kernel, in samples; twice the width of the blur lies between them.
_SMALLEST_SIDE, _LARGEST_SIDE = 64, 1024


def diffraction_mtf(frequency_per_m: FloatArray, wavelength_m: float, working_f_number: float) -> FloatArray:
    """MTF of an ideal lens with a round aperture; J. W. Goodman, Introduction to Fourier Optics, 3rd ed., eq. 6-32."""
    relative = np.minimum(np.abs(frequency_per_m) * wavelength_m * working_f_number, 1.0)
    mtf: FloatArray = 2 / pi * (np.arccos(relative) - relative * np.sqrt(1 - relative**2))
    return mtf


def gaussian_mtf(frequency_per_m: FloatArray, sigma_m: float) -> FloatArray:
    """MTF of a Gaussian point spread of a standard deviation."""
    mtf: FloatArray = np.exp(-2 * (pi * sigma_m * frequency_per_m) ** 2)
    return mtf


def disc_mtf(frequency_per_m: FloatArray, diameter_m: float) -> FloatArray:
    """Transfer function of a uniform disc, the geometric point spread of a defocus; below 0 contrast reverses."""
    from scipy.special import j1

    argument = pi * diameter_m * np.asarray(frequency_per_m, dtype=np.float64)
    transfer: FloatArray = np.divide(2 * j1(argument), argument, out=np.ones_like(argument), where=argument != 0)
    return transfer


def checked_mtf(table: Any) -> MtfTable:
    """Return a measured MTF in its hashable form.

    Raises
    ------
    InputError
        If it is not empty, nor pairs of a frequency that rises from 0, up to 10 000, and a modulation from 0 to 4 that
        begins with 1.
    """
    how = (
        "give pairs of line pairs per mm, rising from 0 to at most 10000, and modulation from 0 to 4, the first [0, 1]"
    )
    try:
        pairs = np.asarray(table, dtype=object).reshape(-1, 2).astype(np.float64)
    except (TypeError, ValueError):
        raise InputError(f"mtf is {shown(table)}: {how}", key="mtf") from None
    if not pairs.size:
        return ()
    frequency, modulation = pairs.T
    rising = pairs.shape[0] > 1 and frequency[-1] <= _MOST_LP_PER_MM and (np.diff(frequency) > 0).all()
    possible = ((modulation >= 0) & (modulation <= _MOST_MODULATION)).all()
    if not (rising and possible and frequency[0] == 0 and modulation[0] == 1):
        raise InputError(f"mtf is {shown(pairs.tolist())}: {how}", key="mtf")
    return tuple((float(lp_per_mm), float(mtf)) for lp_per_mm, mtf in pairs)


def measured_mtf(frequency_per_m: FloatArray, table: Sequence[tuple[float, float]]) -> FloatArray:
    """Measured MTF, linear between its points and 0 beyond the last."""
    lp_per_mm, modulation = np.asarray(table).T
    mtf: FloatArray = np.interp(np.abs(frequency_per_m) * 1e-3, lp_per_mm, modulation, right=0.0)
    return mtf


def blur_kernel(transfer: Any, sample_m: float, width_m: float) -> FloatArray:
    """Kernel by which convolution of a scene of uniform square samples gives the means of its blurred image.

    Its transfer function is the lens' times that of two squares, the sample of the scene and that of the image, with
    the frequencies beyond the sampling folded back; so it is exact for scenes that are uniform on each sample.

    Parameters
    ----------
    transfer : callable
        Takes spatial frequencies on the sensor in 1/m, any shape, and returns the lens' transfer function.
    sample_m : float
        Side of a sample on the sensor in metres.
    width_m : float
        About how wide the point spread is.

    Returns
    -------
    ndarray, shape (side, side)
        With its middle at ``side // 2``; its sum is 1.
    """
    side = int(min(max(2 * ceil(2 * width_m / sample_m), _SMALLEST_SIDE), _LARGEST_SIDE))
    base = np.fft.fftfreq(side)
    folds = _folds(transfer, sample_m)
    folded, covered = np.zeros((2, side, side))
    for row in range(-folds, folds + 1):
        for column in range(-folds, folds + 1):
            weight = np.outer(np.sinc(base + row) ** 2, np.sinc(base + column) ** 2)
            folded += transfer(np.hypot((base + row)[:, None], base + column) / sample_m) * weight
            covered += weight
    # All weights of a frequency add up to 1; those beyond have the modulation of the outermost.
    folded += (1 - covered) * transfer(np.array((folds + 0.5) / sample_m))
    kernel: FloatArray = np.fft.fftshift(np.fft.ifft2(folded).real)
    return kernel


def _folds(transfer: Any, sample_m: float) -> int:
    """Count the periods on each side that hold all frequencies the lens transfers."""
    frequency = np.arange(0.5, _MOST_FOLDS + 0.5, 0.05) / sample_m
    passed = np.abs(transfer(frequency)) > _NO_MODULATION
    highest = frequency[passed].max(initial=0.0) * sample_m
    return int(min(ceil(highest + 0.5), _MOST_FOLDS))


def blurred(scene: NDArray[Any], kernel: FloatArray) -> NDArray[Any]:
    """Convolve a scene with a kernel; beyond its border the scene continues with its outermost samples."""
    from scipy.signal import oaconvolve

    behind = kernel.shape[0] // 2
    padded = np.pad(scene.astype(np.float64), (kernel.shape[0] - 1 - behind, behind), mode="edge")
    image = oaconvolve(padded, kernel, mode="valid")
    # Less than no light comes of rounding in the transform, and of a sharpened edge in the dark.
    return np.maximum(image, 0.0).astype(scene.dtype, copy=False)


def pixel_means(samples: NDArray[Any], oversampling: int) -> NDArray[Any]:
    """Mean of each pixel's samples, `oversampling` a side, shape (height, width)."""
    if oversampling == 1:
        return samples
    height, width = (size // oversampling for size in samples.shape)
    blocks = samples.reshape(height, oversampling, width, oversampling)
    means: NDArray[Any] = blocks.mean(axis=(1, 3), dtype=np.float64).astype(samples.dtype, copy=False)
    return means
