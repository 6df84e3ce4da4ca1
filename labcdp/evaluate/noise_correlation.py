"""How much less the pixels of a region know of its mean where their noise is correlated, and its light changes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import isfinite, isqrt, sqrt

import numpy as np
from numpy.typing import NDArray

from ..contrast.correlation import inflation_of_scores
from ..errors import InputError
from .kept import kept_by_mask

#: Degree of the surface that light which changes slowly may have, and of that in which noise is looked for.
_SLOW_DEGREE, _NOISE_DEGREE = 2, 4
#: Ratio of mean squares from which a change across a region is none of noise. Smooth noise reaches 13 in 1 % of cases.
_SIGNIFICANT_CHANGE = 30.0
#: 99 % quantile of the standard normal distribution.
_Z_99 = 2.33
#: Share of a variance that is due to the digits of floats.
_ROUNDING = 1e-10
#: Relative size below which a surface is one of the others on a region of few rows or columns.
_SAME_SURFACE = 1e-10
#: Blocks of pixels that are enough, and the least share of a region that has to lie in them.
_FEWEST_BLOCKS, _IN_BLOCKS_LEAST = 1500, 0.75
#: Fewest degrees of freedom that something is said for.
_FEWEST = 4.0
_Array = NDArray[np.float64]


def noise_inflation(image: _Array, mask: NDArray[np.bool_]) -> float:
    """Factor by which noise that is correlated from pixel to pixel raises the variance of a region's mean.

    Parameters
    ----------
    image : ndarray of float, shape (height, width)
        Rows and columns that hold the region.
    mask : ndarray of bool, shape (height, width)
        Its pixels.

    Returns
    -------
    float
        1 where no correlation is found or all pixels are equal.

    Raises
    ------
    InputError
        If a pixel of the region is not finite.

    Notes
    -----
    The factor is the largest of three, if any of them is more than chance makes of independent pixels:
    `labcdp.contrast.variance_inflation`, which sums the correlation over the lags; the mean square of the surfaces of
    the first to the fourth degree (Legendre polynomials) over the variance of the pixels; and the same of the sums of
    rows and of columns. Correlated noise is strong in all that changes slowly, its mean just as such a surface. The
    first is the most precise for noise of short reach, and too small where the noise reaches far into the region.

    The factor is itself uncertain. As for a mean of few readings (JCGM 101:2008, 6.4.9.4), it is raised by
    k / (k - 2) for the k surfaces it rests on, and by (m - 1) / (m - 3) for m = n / factor independent pixels.

    Of regions of 6000 pixels and more, blocks of pixels are looked at in their place, 3400 of them at the most. Their
    means, times the root of the pixels of a block, have the variance of a pixel if the noise is independent; what they
    have more is correlation within the blocks (E. Carlstein, The use of subseries values for estimating the variance
    of a general statistic from a stationary sequence, Ann. Stat. 14, 1986), by which the first factor is multiplied.

    A slow change across the region, of the light or by the lens' fall-off, is the same in each picture, and no noise.
    The surface of second degree is taken off where its mean square is 30 times what the rest has in surfaces of the
    third and fourth degree, in rows, in columns and by its correlation: smooth noise has about as much in all of these.

    In simulations of regions of 30 x 30 to 300 x 300 pixels, independent noise and noise smoothed by a Gaussian of 0.6
    to 3 px, of large ones to 6 px, the 95 % intervals of means covered the truth in 91 to 99 % of the cases, and of
    contrasts and CDP in 93 to 99 %.
    """
    from .noise_kernel import centred, in_blocks, less_surface, with_surfaces

    level, any_differ = centred(image.astype(np.float64, order="C"), mask)
    n = int(np.count_nonzero(mask))
    variance = float(np.vdot(level, level)) / n
    if not isfinite(variance):
        raise InputError("the region holds pixels that are not finite numbers: leave them out")
    side, inside = max(isqrt(n // _FEWEST_BLOCKS), 1), mask
    if side > 1:
        blocks, whole = in_blocks(level, mask, side)
        # A thin region has no blocks.
        if np.count_nonzero(whole) * side**2 >= _IN_BLOCKS_LEAST * n:
            (level, any_differ), inside = centred(blocks, whole), whole
        else:
            side = 1
    if not any_differ:
        return 1.0
    region = _region(inside)
    level = np.ascontiguousarray(level[region.window])
    products = with_surfaces(level, region.down, region.right)
    slow, all_degrees = (solution.fit(products) for solution in region.fits)
    plain = _Noise.of(level, region, 1, _Power(all_degrees.square, all_degrees.rank - 1), variance)
    if not plain.found:
        return 1.0
    rest = less_surface(level, region.mask, region.down, region.right, slow.factors)
    power = _Power(max(all_degrees.square - slow.square, 0.0), all_degrees.rank - slow.rank)
    # Blocks of noise scatter as pixels do, blocks of a surface as many times more as they have pixels.
    less = variance - slow.square / (region.n * side**2)
    without = _Noise.of(rest, region, _SLOW_DEGREE + 1, power, less)
    if min(without.square / region.n, less) <= _ROUNDING * variance:
        return 1.0
    # Sums over lags take their time: the least that the factor can be is often enough to say that a change is noise.
    most = _Power(slow.square, slow.rank - 1).mean / (_SIGNIFICANT_CHANGE * without.variance)
    if most > without.least and most > without.inflation:
        return _widened(without.inflation, power.freedom, n)
    return _widened(plain.inflation, all_degrees.rank - 1, n)


@dataclass(frozen=True)
class _Power:
    """Sum of squares of values that are zero on average, and how many there are."""

    square: float
    freedom: float

    @property
    def mean(self) -> float:
        return self.square / self.freedom if self.freedom > 0 else 0.0

    def beyond_chance(self, variance: float) -> bool:
        """Whether independent values of this variance have less in 99 % of cases (Wilson and Hilferty 1931)."""
        if not self.freedom > 0:
            return False
        spread = 2 / (9 * self.freedom)
        return self.mean > variance * (1 - spread + _Z_99 * sqrt(spread)) ** 3


@dataclass(frozen=True, eq=False)
class _Noise:
    """Noise of a region, and where correlation may be seen in it.

    Parameters
    ----------
    level : ndarray of float, shape (height, width)
        The noise, 0 outside the region.
    region : _Region
        The region.
    square : float
        Sum of its squares.
    variance : float
        Of the pixels, which that of blocks is compared with.
    powers : tuple of _Power
        Of blocks, of surfaces, of sums of columns and of sums of rows.
    """

    level: _Array
    region: _Region
    square: float
    variance: float
    powers: tuple[_Power, ...]

    @classmethod
    def of(cls, level: _Array, region: _Region, known: int, surfaces: _Power, variance: float) -> _Noise:
        """Take noise that lost so many degrees of freedom along each axis."""
        from .noise_kernel import sums_along_axes

        square, *sums = sums_along_axes(level)
        of_lines = (
            _Power(float(one @ one) * lines / region.n, lines - known)
            for one, lines in zip(sums, region.lines, strict=True)
        )
        # Pixels have no more power than they have.
        return cls(level, region, square, variance, (_Power(square, region.n), surfaces, *of_lines))

    @cached_property
    def beyond_chance(self) -> bool:
        """Whether blocks, surfaces, columns or rows show correlation."""
        return any(power.beyond_chance(self.variance) for power in self.powers)

    @cached_property
    def by_lags(self) -> float:
        """Factor by the correlation at near lags; 1 where there is none, or all pixels are equal."""
        factor = inflation_of_scores(self.level, self.region.mask)
        return factor * self.square / (self.region.n * self.variance) if factor > 1 else 1.0

    @property
    def found(self) -> bool:
        """Whether there is any correlation."""
        return self.beyond_chance or self.by_lags > 1

    @property
    def least(self) -> float:
        """What the inflation is at least, by blocks, surfaces, columns and rows alone."""
        return max(1.0, *(power.mean / self.variance for power in self.powers)) if self.beyond_chance else 1.0

    @property
    def inflation(self) -> float:
        """Largest of the factors; 1 where none is more than chance makes."""
        if not self.found:
            return 1.0
        return max(1.0, self.by_lags, *(power.mean / self.variance for power in self.powers))


def _widened(inflation: float, freedom: float, n: int) -> float:
    """Raise a factor for what is uncertain about it."""
    if inflation == 1:
        return 1.0
    freedom = max(freedom, _FEWEST)
    inflation *= freedom / (freedom - 2)
    independent = max(n / inflation, _FEWEST)
    return inflation * (independent - 1) / (independent - 3)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Surface that fits best: its factors, by the degrees along y and x, its sum of squares and degrees of freedom."""

    factors: _Array
    square: float
    rank: int


@dataclass(frozen=True, eq=False)
class _Solution:
    """How a surface of a degree is fitted.

    Parameters
    ----------
    along_y, along_x : ndarray of int, shape (k,)
        Degrees along y and x of the surfaces that it is the sum of.
    directions, sizes : ndarray of float, shape (k, n) and (n,)
        Eigenvectors and eigenvalues of the matrix of their products with each other; only n of k, where some surfaces
        are the same as others on a region of few rows or columns.
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
class _Region:
    """What of a region does not depend on its pixels' values.

    Parameters
    ----------
    window : tuple of slice
        Rows and columns that it spans.
    mask : ndarray of bool, shape (height, width)
        Its pixels in these.
    n : int
        Number of its pixels.
    lines : tuple of float
        As many columns, and rows, of equal length as would have the same scatter.
    down, right : ndarray of float, shape (degrees, height) and (degrees, width)
        Legendre polynomials along y and x. A surface is a product of two, and so is the product of two surfaces: none
        has to be made.
    fits : tuple of _Solution
        What makes, of its products with an image, the slow surface that fits best, and that of all degrees.
    """

    window: tuple[slice, slice]
    mask: NDArray[np.bool_]
    n: int
    lines: tuple[float, float]
    down: _Array
    right: _Array
    fits: tuple[_Solution, _Solution]


@kept_by_mask
def _region(mask: NDArray[np.bool_]) -> _Region:
    pixels = [mask.sum(axis=axis) for axis in (0, 1)]
    columns, rows = (np.flatnonzero(count) for count in pixels)
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    inside = mask[window].copy()
    n = int(pixels[0].sum())
    down, right = map(_polynomials, inside.shape)
    pairs = [(line[:, None] * line).reshape(-1, line.shape[1]) for line in (down, right)]
    count = _NOISE_DEGREE + 1
    each_other = (pairs[0] @ inside.astype(float) @ pairs[1].T).reshape((count,) * 4).transpose(0, 2, 1, 3)
    return _Region(
        window=window,
        mask=inside,
        n=n,
        lines=(n**2 / float(np.square(pixels[0]).sum()), n**2 / float(np.square(pixels[1]).sum())),
        down=down,
        right=right,
        fits=(_Solution.of(each_other, _SLOW_DEGREE), _Solution.of(each_other, _NOISE_DEGREE)),
    )


@lru_cache(maxsize=64)
def _polynomials(length: int) -> _Array:
    """Legendre polynomials along a line of pixels, shape (degrees, length)."""
    places = (2 * np.arange(length) + 1) / length - 1
    return np.ascontiguousarray(np.polynomial.legendre.legvander(places, _NOISE_DEGREE).T)
