"""Spectral mismatch of a luminance by its colour, as errors that luminances of one camera share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.luminance import CommonError

#: Harmonics of the hue: mismatch errors of simulated cameras are nearly independent from 45 degrees of hue on.
_HARMONICS = 4
#: R, G and B at equal angles, scaled so that the magnitude is the standard deviation of the three.
_AXES = np.sqrt(2) / 3 * np.exp(2j * np.pi * np.arange(3) / 3)


def colourfulness(by_colour: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return standard deviation over mean of the luminances by R, G and B, along the last axis."""
    return np.abs(_chromaticity(by_colour))


def mismatch_errors(by_colour: NDArray[np.floating[Any]], spectral_rel: float) -> tuple[CommonError, ...]:
    """Return the errors of luminances by their colour, in patches and maps alike.

    Each harmonic of the hue, times the colourfulness, is an independent error. Together they have the standard
    uncertainty `spectral_rel` times the colourfulness. Between two luminances of one chromaticity they cancel; between
    unlike ones the correlation falls from 0.2 at 30 degrees of hue to about 0. Noise of grey pixels, which have any
    hue, averages out.

    Parameters
    ----------
    by_colour : ndarray of float, shape (..., 3)
        Luminances by R, G and B alone, equal for light of the calibration's spectrum.
    spectral_rel : float
        Relative standard uncertainty per unit of colourfulness.
    """
    if spectral_rel == 0:
        return ()
    chromaticity = _chromaticity(by_colour)
    size = np.abs(chromaticity)
    direction = chromaticity / np.maximum(size, 1e-30)
    patterns = [spectral_rel / np.sqrt(_HARMONICS) * size * direction**m for m in range(1, _HARMONICS + 1)]
    return tuple(
        CommonError("spectral mismatch", part if part.ndim else float(part))
        for pattern in patterns
        for part in (pattern.real, pattern.imag)
    )


def _chromaticity(by_colour: NDArray[np.floating[Any]]) -> NDArray[np.complex128]:
    """Hue and colourfulness as angle and magnitude; 0 for grey."""
    result: NDArray[np.complex128] = by_colour @ _AXES / np.maximum(np.abs(by_colour.mean(axis=-1)), 1e-30)
    return result
