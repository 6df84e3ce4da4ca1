"""Inflation of the variance of a region's mean by correlated noise, in slowly changing light."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import isqrt, log10, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from .arrays import image_array, mask_array, window_of

#: Ratio of mean squares from which on a change across a region is not noise. Smooth noise exceeds 13 in 1 % of cases.
_USUAL_CHANGE = 36.0
#: 99 % quantile of the standard normal distribution.
_Z_99 = 2.33
#: Relative variance attributed to floating-point rounding.
_ROUNDING = 1e-10
#: Sufficient number of blocks of pixels, and the least share of a region that they must cover.
_FEWEST_BLOCKS, _IN_BLOCKS_LEAST = 1500, 0.75
#: Fewest degrees of freedom for a test.
_FEWEST = 4.0
#: Degree of the surface for slowly changing light, and of those tested for noise.
_SLOW_DEGREE, _NOISE_DEGREE = 2, 4
#: Relative size below which a surface is linearly dependent on others in a region of few rows or columns.
_SAME_SURFACE = 1e-10
#: A correlation is significant above this many times sqrt(log10(n) / pairs); the sum ends where this many consecutive
#: lags are below (Politis 2003, with the recommended constants, but pairs instead of n: a mask may leave far fewer).
_SIGNIFICANT, _LAGS_BELOW = 2.0, 5
#: Critical value, in standard deviations, for the correlation along whole rows or columns: 1 % false positives.
_LINE_SIGNIFICANT = 2.3
#: Number of masks that are kept for the next frames of a video, and pixels from which one is not, to limit memory.
_MASKS, _TOO_LARGE = 32, 2**18
#: Degrees along y and x of the terms of each surface.
_TERMS = {
    degree: np.nonzero(np.add.outer(*2 * [np.arange(_NOISE_DEGREE + 1)]) <= degree)
    for degree in (_SLOW_DEGREE, _NOISE_DEGREE)
}
_Array = NDArray[np.float64]


def variance_inflation(image: ArrayLike, mask: ArrayLike) -> float:
    """Factor by which spatially correlated noise raises the variance of a region's mean.

    Parameters
    ----------
    image : array_like of int or float, shape (height, width)
        Image; only its pixels in `mask` are used.
    mask : array_like of bool, shape (height, width)
        Pixels of the region, of any shape.

    Returns
    -------
    float
        1 where no correlation is found or all pixels are equal; about 9 for noise averaged over 3 x 3 pixels. The mean
        is as precise as that of n / factor independent pixels.

    Raises
    ------
    InputError
        If the image is not of two dimensions, or the mask not boolean, of another shape or empty, or contains a
        non-finite pixel.

    Notes
    -----
    The factor is the largest of three, if any of them is significant for independent pixels: the sum of the correlation
    over near lags (`lag_inflation`); the mean square of the surfaces of the first to the fourth
    degree (Legendre polynomials) over the variance of the pixels; and the same of the sums of rows and of columns.
    Correlated noise has excess power at low spatial frequencies, in its mean as in such a surface. The first factor is
    the most precise for short correlation lengths, and too small where the correlation length is comparable to the
    region.

    The factor is itself uncertain. As for a mean of few readings (JCGM 101:2008, 6.4.9.4), it is raised by k / (k - 2)
    for the k surfaces used, and by (m - 1) / (m - 3) for m = n / factor independent pixels.

    Regions of 6000 pixels and more are reduced to blocks of pixels, at most 3400. The block means, times the root of
    the pixels per block, have the variance of a pixel if the noise is independent; any excess is due to correlation
    within the blocks (E. Carlstein, The use of subseries values for estimating the variance of a general statistic from
    a stationary sequence, Ann. Stat. 14, 1986), by which the first factor is multiplied.

    A slow change across the region, of the light or by vignetting, is the same in each picture, and not noise. Smooth
    noise contributes about equally to the surface of second degree and, without it, to surfaces of the third and fourth
    degree, to rows, to columns and to the correlation. So where the mean square of that surface is R times what these
    say, the factor is at most max(1, 36 / R) times theirs: a decision at one R would let it jump from picture to
    picture.

    In simulations of regions of 30 x 30 to 300 x 300 pixels, independent noise and noise smoothed by a Gaussian of 0.6
    to 3 px, of large ones to 6 px, the 95 % intervals of means covered the truth in 91 to 99 % of the cases, and of
    contrasts and CDP in 93 to 99 %.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.ndimage import uniform_filter
    >>> from labcdp.metrics import variance_inflation
    >>> noise, mask = np.random.default_rng(0).normal(size=(60, 60)), np.ones((60, 60), dtype=bool)
    >>> variance_inflation(noise, mask), round(variance_inflation(uniform_filter(noise, 3), mask), 1)
    (1.0, 12.8)
    """
    pixels = image_array(image)
    marked = mask_array(mask, pixels.shape, "mask")
    if not np.isfinite(pixels[marked]).all():
        raise InputError("the region holds pixels that are not finite numbers: leave them out")
    return region_inflation(pixels.astype(np.float64), marked)


def region_inflation(image: _Array, mask: NDArray[np.bool_]) -> float:
    """Return `variance_inflation` of a region whose pixels are known to be finite."""
    grid = _grid(mask) if mask.size >= _TOO_LARGE else _kept_grid(mask.shape, mask.tobytes())
    n, side = grid.n_pixels, grid.side
    level, any_differ = _centred(image[grid.window], grid.mask)
    variance = float(np.vdot(level, level)) / n
    if side > 1:
        level, any_differ = _centred(_block_sums(level, side) / side, grid.whole_blocks)
    if not any_differ:
        return 1.0
    level = np.ascontiguousarray(level[grid.blocks_window])
    slow, slow_square, square = _fit_surfaces(grid, level)
    slow_rank, rank = grid.ranks
    plain = _with_lags(level, grid, _by_lines(level, grid, 1, (square, rank - 1), variance), variance)
    if plain == 1:
        return 1.0
    rest = (level - slow) * grid.blocks
    # Scaled blocks of noise scatter as pixels do; the mean square of a surface grows with the pixels per block.
    less = variance - slow_square / (grid.n_blocks * side**2)
    if min(float(np.vdot(rest, rest)) / grid.n_blocks, less) <= _ROUNDING * variance:
        return 1.0
    change = slow_square / (slow_rank - 1) / less if slow_rank > 1 else 0.0
    all_of_it = _widened(plain, rank - 1, n)
    # Noise, whose factor is at least 1, may have such a change.
    if 0 < change <= _USUAL_CHANGE / plain:
        return all_of_it

    def most(noise: float) -> float:
        """Return the largest factor that noise, and the change on top of it, may have."""
        return _widened(max(noise, _USUAL_CHANGE * noise**2 / change if change > 0 else noise), rank - slow_rank, n)

    others = max(square - slow_square, 0.0), rank - slow_rank
    by_lines = _by_lines(rest, grid, _SLOW_DEGREE + 1, others, less)
    # Lags, which take most of the time, can only raise it.
    if by_lines[1] and most(max(by_lines[0], 1.0)) >= all_of_it:
        return all_of_it
    return min(all_of_it, most(_with_lags(rest, grid, by_lines, less)))


def _centred(image: _Array, mask: NDArray[np.bool_]) -> tuple[_Array, bool]:
    """Image less the mean of its pixels in a mask, 0 outside; and whether these are not all equal."""
    values = image[mask]
    level = np.zeros(image.shape)
    level[mask] = values - values.sum() / values.size
    return level, bool(values.min() < values.max())


def _block_sums(level: _Array, side: int) -> _Array:
    """Return sums of square blocks; divided by `side`, those of independent pixels have the variance of a pixel."""
    height, width = level.shape[0] // side * side, level.shape[1] // side * side
    starts = ((y, x) for y in range(side) for x in range(side))
    return sum((level[y:height:side, x:width:side] for y, x in starts), np.zeros((height // side, width // side)))


def _by_lines(
    level: _Array, grid: _Grid, known: int, surfaces: tuple[float, int], variance: float
) -> tuple[float, bool]:
    """Largest factor by surfaces, columns and rows, and whether any is significant.

    `known` degrees of freedom were subtracted along each axis. `surfaces` are the sum of squares of their coefficients
    and its degrees of freedom. `variance` is that of the pixels, for comparison with that of blocks.
    """
    powers = [(float(np.vdot(level, level)), float(grid.n_blocks)), surfaces]
    for sums, lines in zip((level.sum(axis=0), level.sum(axis=1)), grid.lines, strict=True):
        powers.append((float(sums @ sums) * lines / grid.n_blocks, lines - known))
    means = [(total / dof / variance, 2 / (9 * dof)) for total, dof in powers if dof > 0]
    # 99 % quantile for independent values (Wilson and Hilferty 1931).
    chance = any(mean > (1 - spread + _Z_99 * sqrt(spread)) ** 3 for mean, spread in means)
    return max(mean for mean, _ in means), chance


def _with_lags(level: _Array, grid: _Grid, by_lines: tuple[float, bool], variance: float) -> float:
    """Largest factor by lags, surfaces, columns and rows; 1 where none is significant."""
    near = lag_inflation(level, grid.pairs)
    by_lags = near * float(np.vdot(level, level)) / (grid.n_blocks * variance) if near > 1 else 1.0
    largest, significant = by_lines
    return max(1.0, by_lags, largest) if significant or by_lags > 1 else 1.0


def _widened(inflation: float, dof: float, n: int) -> float:
    """Raise a factor for its own uncertainty."""
    if inflation == 1:
        return 1.0
    dof = max(dof, _FEWEST)
    inflation *= dof / (dof - 2)
    independent = max(n / inflation, _FEWEST)
    return inflation * (independent - 1) / (independent - 3)


@dataclass(frozen=True, eq=False)
class _Grid:
    """The mask of a region, with the blocks of pixels that are compared and the surfaces on them; kept for next frames.

    Parameters
    ----------
    window : tuple of slice
        Bounding box of the region.
    mask : ndarray of bool
        Mask of its pixels in the box.
    n_pixels : int
        Their number.
    side : int
        Pixels of a block along each side; 1 where the pixels themselves are compared.
    whole_blocks : ndarray of bool
        Which blocks of the box lie entirely in the mask; the means of others would be biased by a gradient of the
        light.
    blocks_window : tuple of slice
        Bounding box of these blocks.
    blocks : ndarray of bool, shape (height, width)
        Mask of them in that box.
    n_blocks : int
        Their number.
    lines : tuple of float
        Equivalent number of columns, and rows, of equal length.
    polynomials : (ndarray, ndarray) of float, shape (degrees, height) and (degrees, width)
        Legendre polynomials along y and x. A surface is a product of two, and so is the product of two surfaces, so
        none has to be evaluated.
    inverses : dict of int to ndarray of float
        Of each degree of surface, the inverse of the products of its terms with each other.
    ranks : (int, int)
        Independent terms of the slow surface and of that of all degrees; fewer in a region of few rows or columns.
    pairs : ndarray of float, shape (2 height, 2 width)
        Pairs of blocks by lag, as `pairs_by_lag` counts them.
    """

    window: tuple[slice, slice]
    mask: NDArray[np.bool_]
    n_pixels: int
    side: int
    whole_blocks: NDArray[np.bool_]
    blocks_window: tuple[slice, slice]
    blocks: NDArray[np.bool_]
    n_blocks: int
    lines: tuple[float, float]
    polynomials: tuple[_Array, _Array]
    inverses: dict[int, _Array]
    ranks: tuple[int, int]
    pairs: _Array


@lru_cache(maxsize=_MASKS)
def _kept_grid(shape: tuple[int, ...], pixels: bytes) -> _Grid:
    return _grid(np.frombuffer(pixels, dtype=np.bool_).reshape(shape))


def _grid(mask: NDArray[np.bool_]) -> _Grid:
    window = window_of(mask)
    whole_blocks = mask = mask[window].copy()
    n_pixels = int(np.count_nonzero(mask))
    side = max(isqrt(n_pixels // _FEWEST_BLOCKS), 1)
    if side > 1:
        whole = _block_sums(mask.astype(float), side) == side**2
        # A thin region contains no blocks.
        if np.count_nonzero(whole) * side**2 >= _IN_BLOCKS_LEAST * n_pixels:
            whole_blocks = whole
        else:
            side = 1
    blocks_window = window_of(whole_blocks)
    blocks = whole_blocks[blocks_window].copy()
    in_columns, in_rows = blocks.sum(axis=0), blocks.sum(axis=1)
    n_blocks, count = int(in_rows.sum()), _NOISE_DEGREE + 1
    centres = [(2 * np.arange(length) + 1) / length - 1 for length in blocks.shape]
    down, right = (np.ascontiguousarray(np.polynomial.legendre.legvander(x, _NOISE_DEGREE).T) for x in centres)
    pairs = [(line[:, None] * line).reshape(-1, line.shape[1]) for line in (down, right)]
    each_other = (pairs[0] @ blocks.astype(float) @ pairs[1].T).reshape((count,) * 4).transpose(0, 2, 1, 3)
    inverses, ranks = {}, []
    for degree in (_SLOW_DEGREE, _NOISE_DEGREE):
        y, x = _TERMS[degree]
        products = each_other[y[:, None], x[:, None], y, x]
        sizes, directions = np.linalg.eigh(products)
        kept = np.abs(sizes) > _SAME_SURFACE * np.abs(sizes).max()
        inverses[degree] = directions[:, kept] / sizes[kept] @ directions[:, kept].T
        ranks.append(int(np.count_nonzero(kept)))
    return _Grid(
        window=window,
        mask=mask,
        n_pixels=n_pixels,
        side=side,
        whole_blocks=whole_blocks,
        blocks_window=blocks_window,
        blocks=blocks,
        n_blocks=n_blocks,
        lines=(n_blocks**2 / float(np.square(in_columns).sum()), n_blocks**2 / float(np.square(in_rows).sum())),
        polynomials=(down, right),
        inverses=inverses,
        ranks=(ranks[0], ranks[1]),
        pairs=pairs_by_lag(blocks),
    )


def _fit_surfaces(grid: _Grid, level: _Array) -> tuple[_Array, float, float]:
    """Slow surface by least squares, and the sums of squares over the region of it and of that of all degrees."""
    down, right = grid.polynomials
    products, factors = down @ level @ right.T, np.zeros((len(down), len(right)))
    every = products[_TERMS[_NOISE_DEGREE]]
    factors[_TERMS[_SLOW_DEGREE]] = grid.inverses[_SLOW_DEGREE] @ products[_TERMS[_SLOW_DEGREE]]
    square = float(every @ grid.inverses[_NOISE_DEGREE] @ every)
    return down.T @ factors @ right, float(np.vdot(factors, products)), square


def products_by_lag(image: _Array) -> _Array:
    """Sum of the products of an image with itself at each lag, shape (2 height, 2 width).

    The lag (dy, dx) stands at [dy, dx], negative ones from the ends, as Python counts.
    """
    shape = 2 * image.shape[0], 2 * image.shape[1]
    products: _Array = np.fft.irfft2(np.square(np.abs(np.fft.rfft2(image, shape))), shape)
    return products


def pairs_by_lag(mask: NDArray[np.bool_]) -> _Array:
    """Count the pairs of pixels of a mask by lag, shape (2 height, 2 width); see `products_by_lag`."""
    return np.rint(products_by_lag(mask.astype(float)))


def lag_inflation(scores: _Array, pairs: _Array) -> float:
    """Factor by which the correlation at near lags raises the variance of the mean of pixels.

    Parameters
    ----------
    scores : ndarray of float, shape (height, width)
        Pixels less their mean, 0 outside the mask.
    pairs : ndarray of float, shape (2 height, 2 width)
        Pairs of pixels of the mask by lag; see `pairs_by_lag`.

    Returns
    -------
    float
        1 for independent pixels, or if all scores are 0; about 9 for noise averaged over 3 x 3 pixels; never below 1.

    Notes
    -----
    The factor is the sum of the autocorrelation over lags (dy, dx), each lag at the number of pairs of pixels the
    mask has for it. The lags used are selected from the data, separately for rows and columns: q is the last lag
    along the axis before five consecutive ones whose correlation is below 2 sqrt(log10(n) / pairs), and the weight
    is 1 up to q + 1 and falls to 0 at 2 (q + 1), and only lag 0 is used if q is 0 (after D. N. Politis, Adaptive
    bandwidth choice, J. Nonparametr. Stat. 15, 2003; one lag more, as the last correlations are often below the
    critical value). The weight of a lag is the product of those, u and v, for both axes. A pattern of rows or
    columns correlates little at each lag but over all lags; if the lags beyond 2 (q + 1) together exceed 0 by 2.3
    standard deviations, all lags along that axis are used: the weight is then that for the other axis, or
    u + v - u v if this holds for both. As the mean is itself an estimate, the sum is too small by the share of all
    n^2 pairs that it covers, which is corrected. Where it covers all pairs, as for all lags along a region of one
    row, the sum is 0 whatever the noise; the factor is then the largest for any q from 0 to the selected one.
    """
    # Without pairs there is nothing but rounding errors.
    products = products_by_lag(scores) * (pairs > 0)
    scatter, n = float(products[0, 0]), float(pairs[0, 0])
    if not scatter > 0:
        return 1.0
    along = pairs[:, 0].copy(), pairs[0].copy()
    # Least significant correlation along y and x, for lags up to a quarter of the lines. Fewer pairs than pixels have
    # a larger scatter.
    down, right = (
        _SIGNIFICANT * sqrt(log10(n) / n) / n * np.sqrt(n * counts[: counts.size // 8 + 1]) for counts in along
    )
    reaches = _reach(products[:, 0], down * scatter), _reach(products[0], right * scatter)
    weights = _weights(reaches, products.shape)
    whole = (
        _lines_count(products, along, weights, reaches[0]),
        _lines_count(products.T, along[::-1], weights[::-1], reaches[1]),
    )
    if not any((*reaches, *whole)):
        return 1.0

    def factor(weights: tuple[_Array, _Array], whole: tuple[bool, bool] = (False, False)) -> float | None:
        """Return the sum over the selected lags, corrected for the estimated mean; None if that is not possible."""
        share = _weighted(pairs, weights, whole) / n**2
        return _weighted(products, weights, whole) / scatter * (1 - 1 / n) / (1 - share) if share < 1 else None

    inflation = factor(weights, whole)
    if inflation is not None:
        return max(inflation, 1.0)
    # The sum over all lags is the square of the sum of the scores, 0. Near lags never cover all pairs: the weight of a
    # region's farthest lag is less than 1.
    nearer = (
        factor(_weights((min(reaches[0], most), min(reaches[1], most)), products.shape))
        for most in range(max(reaches) + 1)
    )
    return max(1.0, *(factor for factor in nearer if factor is not None))


def _reach(products: _Array, least: _Array) -> int:
    """Last lag along an axis before consecutive ones with a small mean product."""
    reach = 0
    for lag in (np.flatnonzero(np.abs(products[1 : least.size]) > least[1:]) + 1).tolist():
        if lag - reach > _LAGS_BELOW:
            break
        reach = lag
    return reach


def _weights(reaches: tuple[int, int], shape: tuple[int, ...]) -> tuple[_Array, _Array]:
    """Weights of the lags along y and x: 1 up to the one after a reach, falling to 0 at twice that."""
    return _falling(reaches[0], shape[0]), _falling(reaches[1], shape[1])


@lru_cache(maxsize=128)
def _falling(reach: int, size: int) -> _Array:
    places = np.arange(size)
    lags = np.minimum(places, size - places)
    # Only lag 0 is used where none is significant.
    falling = np.minimum(np.maximum(2 - lags / (reach + 1), 0.0), 1.0) if reach else (lags == 0).astype(np.float64)
    falling.flags.writeable = False
    return falling


def _weighted(by_lag: _Array, weights: tuple[_Array, _Array], whole: tuple[bool, bool]) -> float:
    """Weighted sum over all lags; one selected by both axes is counted once."""
    down, right = weights
    by_columns = by_lag @ right
    both = float(down @ by_columns)
    every = float(by_columns.sum()) if whole[0] else both
    return every + float(down @ by_lag.sum(axis=1)) - both if whole[1] else every


def _lines_count(products: _Array, pairs: tuple[_Array, _Array], weights: tuple[_Array, _Array], reach: int) -> bool:
    """Whether the sum over the far lags along y exceeds a number of standard deviations.

    Their variance is Bartlett's formula, summed over lags along the line. Pairs at a lag (dy, dx) are taken as those at
    (dy, 0) times those at (0, dx) over all pixels.
    """
    along, across = pairs
    far = slice(2 * reach + 3, along.size - 2 * reach - 2)
    total = float(products[far, 0].sum())
    if total <= 0 or (far_pairs := float(along[far].sum())) < 0.5:
        return False
    means, means_across = (weight / np.maximum(of, 1.0) * (of > 0) for weight, of in zip(weights, pairs, strict=True))
    squares = np.square(across[0] * means_across * (means @ products))
    return total > _LINE_SIGNIFICANT * sqrt(2 * far_pairs * float(squares.sum()))
