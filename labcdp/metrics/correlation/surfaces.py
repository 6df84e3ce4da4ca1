"""Surfaces that change slowly across a region: sums of products of Legendre polynomials along y and x."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..image import window_of

#: Number of masks that are kept for the next frames of a video, and pixels from which one is not, to limit memory.
_MASKS, _TOO_LARGE = 16, 2**18
#: Degree of the surface for slowly changing light, and of those tested for noise.
SLOW_DEGREE, _NOISE_DEGREE = 2, 4
#: Relative size below which a surface is linearly dependent on others in a region of few rows or columns.
_SAME_SURFACE = 1e-10
_Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Fit:
    """Least-squares surface: coefficients by degree along y and x, sum of squares and degrees of freedom."""

    factors: _Array
    square: float
    rank: int


@dataclass(frozen=True, eq=False)
class _Solution:
    """Precomputed fit of a surface of a degree.

    Parameters
    ----------
    along_y, along_x : ndarray of int, shape (k,)
        Degrees along y and x of its terms.
    directions, sizes : ndarray of float, shape (k, n) and (n,)
        Eigenvectors and eigenvalues of their Gram matrix; only n of k, where some are linearly dependent in a region of
        few rows or columns.
    """

    along_y: NDArray[np.intp]
    along_x: NDArray[np.intp]
    directions: _Array
    sizes: _Array

    @classmethod
    def of(cls, with_each_other: _Array, degree: int) -> _Solution:
        along_y, along_x = np.nonzero(np.add.outer(*2 * [np.arange(_NOISE_DEGREE + 1)]) <= degree)
        sizes, directions = np.linalg.eigh(with_each_other[along_y[:, None], along_x[:, None], along_y, along_x])
        apart = sizes > _SAME_SURFACE * sizes[-1]
        return cls(along_y, along_x, directions[:, apart], sizes[apart])

    def fit(self, with_image: _Array) -> _Fit:
        wanted = with_image[self.along_y, self.along_x]
        found = self.directions @ (wanted @ self.directions / self.sizes)
        factors = np.zeros(with_image.shape)
        factors[self.along_y, self.along_x] = found
        return _Fit(factors, float(found @ wanted), self.sizes.size)


@dataclass(frozen=True, eq=False)
class Region:
    """Properties of a region that depend only on its mask.

    Parameters
    ----------
    window : tuple of slice
        Its bounding box.
    mask : ndarray of bool, shape (height, width)
        Mask of its pixels in the box.
    n : int
        Number of its pixels.
    lines : tuple of float
        Equivalent number of columns, and rows, of equal length.
    down, right : ndarray of float, shape (degrees, height) and (degrees, width)
        Legendre polynomials along y and x. A surface is a product of two, and so is the product of two surfaces, so
        none has to be evaluated.
    fits : tuple of _Solution
        Fits of the slow surface and of that of all degrees.
    """

    window: tuple[slice, slice]
    mask: NDArray[np.bool_]
    n: int
    lines: tuple[float, float]
    down: _Array
    right: _Array
    fits: tuple[_Solution, _Solution]


def region_of(mask: NDArray[np.bool_]) -> Region:
    """Return the properties of a region's mask."""
    return _region(mask) if mask.size >= _TOO_LARGE else _kept(mask.shape, mask.tobytes())


@lru_cache(maxsize=_MASKS)
def _kept(shape: tuple[int, ...], pixels: bytes) -> Region:
    return _region(np.frombuffer(pixels, dtype=np.bool_).reshape(shape))


def _region(mask: NDArray[np.bool_]) -> Region:
    window = window_of(mask)
    inside = mask[window].copy()
    pixels = [inside.sum(axis=axis) for axis in (0, 1)]
    n = int(pixels[0].sum())
    down, right = map(_polynomials, inside.shape)
    pairs = [(line[:, None] * line).reshape(-1, line.shape[1]) for line in (down, right)]
    count = _NOISE_DEGREE + 1
    each_other = (pairs[0] @ inside.astype(float) @ pairs[1].T).reshape((count,) * 4).transpose(0, 2, 1, 3)
    return Region(
        window=window,
        mask=inside,
        n=n,
        lines=(n**2 / float(np.square(pixels[0]).sum()), n**2 / float(np.square(pixels[1]).sum())),
        down=down,
        right=right,
        fits=(_Solution.of(each_other, SLOW_DEGREE), _Solution.of(each_other, _NOISE_DEGREE)),
    )


@lru_cache(maxsize=64)
def _polynomials(length: int) -> _Array:
    """Legendre polynomials along a line of pixels, shape (degrees, length)."""
    places = (2 * np.arange(length) + 1) / length - 1
    return np.ascontiguousarray(np.polynomial.legendre.legvander(places, _NOISE_DEGREE).T)
