"""Positions of the patches: smooth patterns over the image, and errors of the vignetting."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.vignetting import AnyVignetting, FlatField, RadialVignetting

Array = NDArray[np.floating[Any]]


def smooth_patterns(shape: tuple[int, int], centres_px: Sequence[tuple[float, float]]) -> Array:
    """Dominant patterns of slow changes over an image, r^2, x and y, at P positions.

    Each has the mean 0 and the root mean square 1 over the image.

    Parameters
    ----------
    shape : (int, int)
        Height and width in pixels.
    centres_px : sequence of (float, float)
        The places (x, y), P of them.

    Returns
    -------
    ndarray of float, shape (P, 3)
    """
    size = np.array([shape[1], shape[0]], dtype=float)
    # From -1 to 1 over width and height, where x^2 has the mean 1/3 and the variance 4/45.
    xy = 2 * np.array(centres_px, dtype=float).reshape(-1, 2) / size - 1
    part = size**2 / (size @ size)
    r2 = (xy**2 @ part - 1 / 3) / sqrt(4 / 45 * (part @ part))
    return np.column_stack([r2, sqrt(3) * xy])


def slow_rel(vignetting: AnyVignetting | None) -> float:
    """Relative standard uncertainty of slow residuals of a measured vignetting."""
    return vignetting.slow_rel if isinstance(vignetting, FlatField | RadialVignetting) else 0.0


def vignetting_errors(
    vignetting: AnyVignetting | None, shape: tuple[int, int], centres_px: Sequence[tuple[float, float]]
) -> Array:
    """Signed relative errors of luminances at P places by the polynomial's coefficients, shape (k, P); k may be 0.

    Parameters
    ----------
    vignetting : AnyVignetting or None
        The vignetting; only a polynomial with a covariance has such errors.
    shape : (int, int)
        Height and width in pixels.
    centres_px : sequence of (float, float)
        The places (x, y), P of them.
    """
    if not isinstance(vignetting, RadialVignetting):
        return np.zeros((0, len(centres_px)))
    return -np.array([vignetting.common_errors_at(shape, place) for place in centres_px]).T.reshape(-1, len(centres_px))
