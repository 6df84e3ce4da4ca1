"""Inflation of the variance of a mean by the correlation of near pixels, summed over lags."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import log10, sqrt

import numpy as np
from numpy.typing import NDArray

#: A correlation is significant above this many times sqrt(log10(n) / pairs); the sum ends where this many consecutive
#: lags are below (Politis 2003, with the recommended constants, but pairs instead of n: a mask may leave far fewer).
_SIGNIFICANT, _LAGS_BELOW = 2.0, 5
#: Critical value, in standard deviations, for the correlation along whole rows or columns: 1 % false positives.
_LINE_SIGNIFICANT = 2.3
_Array = NDArray[np.float64]


def products_by_lag(image: _Array) -> _Array:
    """Sum of the products of an image with itself at each lag, shape (2 height, 2 width).

    The lag (dy, dx) stands at [dy, dx], negative ones from the ends, as Python counts.
    """
    shape = 2 * image.shape[0], 2 * image.shape[1]
    products: _Array = np.fft.irfft2(np.square(np.abs(np.fft.rfft2(image, shape))), shape)
    return products


@dataclass(frozen=True, eq=False)
class Lags:
    """Lags between the pixels of a mask.

    Parameters
    ----------
    pairs : ndarray of float, shape (2 height, 2 width)
        Number of pairs of its pixels by lag; see `products_by_lag`.
    """

    pairs: _Array

    @classmethod
    def of(cls, mask: NDArray[np.bool_]) -> Lags:
        """Count the pairs of pixels of a mask."""
        return cls(np.rint(products_by_lag(mask.astype(float))))

    @cached_property
    def _there(self) -> _Array:
        """1 where there are pairs, else 0: without pairs there is nothing but rounding errors."""
        return (self.pairs > 0).astype(float)

    @cached_property
    def _along(self) -> tuple[_Array, _Array]:
        """Pairs of pixels in a column, and in a row, by lag."""
        return self.pairs[:, 0].copy(), self.pairs[0].copy()

    @cached_property
    def _least(self) -> tuple[_Array, _Array]:
        """Least significant correlation along y and x, for lags up to a quarter of the lines.

        Fewer pairs than pixels have a larger scatter.
        """
        n = float(self.pairs[0, 0])
        down, right = (
            _SIGNIFICANT * sqrt(log10(n) / n) / n * np.sqrt(n * one[: one.size // 8 + 1]) for one in self._along
        )
        return down, right

    def inflation(self, scores: _Array) -> float:
        """Factor by which the correlation at near lags raises the variance of the mean of pixels.

        Parameters
        ----------
        scores : ndarray of float, shape (height, width)
            Pixels less their mean, 0 outside the mask.

        Returns
        -------
        float
            1 for independent pixels, or if all scores are 0; about 9 for noise averaged over 3 x 3 pixels; never below
            1.

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
        products = products_by_lag(scores) * self._there
        scatter, n = float(products[0, 0]), float(self.pairs[0, 0])
        if not scatter > 0:
            return 1.0
        down, right = self._least
        reaches = _reach(products[:, 0], down * scatter), _reach(products[0], right * scatter)
        weights = _weights(reaches, products.shape)
        whole = (
            _lines_count(products, self._along, weights, reaches[0]),
            _lines_count(products.T, self._along[::-1], weights[::-1], reaches[1]),
        )
        if not any((*reaches, *whole)):
            return 1.0

        def factor(weights: tuple[_Array, _Array], whole: tuple[bool, bool] = (False, False)) -> float | None:
            """Sum over the selected lags, corrected for the estimated mean; None if that is not possible."""
            share = _weighted(self.pairs, weights, whole) / n**2
            return _weighted(products, weights, whole) / scatter * (1 - 1 / n) / (1 - share) if share < 1 else None

        found = factor(weights, whole)
        if found is not None:
            return max(found, 1.0)
        # The sum over all lags is the square of the sum of the scores, 0. Near lags never cover all pairs: the weight
        # of a region's farthest lag is less than 1.
        nearer = (
            factor(_weights((min(reaches[0], most), min(reaches[1], most)), products.shape))
            for most in range(max(reaches) + 1)
        )
        return max(1.0, *(one for one in nearer if one is not None))


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


def _weighted(of_lags: _Array, weights: tuple[_Array, _Array], whole: tuple[bool, bool]) -> float:
    """Weighted sum over all lags; one selected by both axes is counted once."""
    down, right = weights
    by_columns = of_lags @ right
    both = float(down @ by_columns)
    every = float(by_columns.sum()) if whole[0] else both
    return every + float(down @ of_lags.sum(axis=1)) - both if whole[1] else every


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
    means, means_across = (one / np.maximum(of, 1.0) * (of > 0) for one, of in zip(weights, pairs, strict=True))
    squares = np.square(across[0] * means_across * (means @ products))
    return total > _LINE_SIGNIFICANT * sqrt(2 * far_pairs * float(squares.sum()))
