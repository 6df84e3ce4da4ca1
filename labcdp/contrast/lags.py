"""Sums of the products of pairs of pixels, by the lag between the two."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import log2

import numpy as np
from numpy.typing import NDArray

from .kept import kept_by_mask

#: A Fourier transform there and back of N numbers takes as long as so many products by themselves, so many more for
#: each N log2(N), measured for regions of 10 x 10 to 1000 x 1000 pixels.
_PRODUCTS_OF_TRANSFORM, _PRODUCTS_OF_STEP = 4e5, 12.0
_Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Lags:
    """Sums of the products of all pairs of pixels of an image at a lag (dy, dx).

    Sums that were asked for once are kept.

    Parameters
    ----------
    values : ndarray of float, shape (height, width)
        The image; what does not count is 0.
    """

    values: _Array
    _lines: dict[int, _Array] = field(default_factory=dict, init=False, repr=False)
    _tables: dict[str, _Array] = field(default_factory=dict, init=False, repr=False)
    _summed: dict[int, Lags] = field(default_factory=dict, init=False, repr=False)

    @property
    def shape(self) -> tuple[int, ...]:
        """Height and width of the image."""
        return self.values.shape

    @cached_property
    def at_0(self) -> float:
        """Sum of the squares."""
        flat = self.values.ravel()
        return float(flat @ flat)

    @cached_property
    def _transposed(self) -> _Array:
        return np.ascontiguousarray(self.values.T)

    def summed(self, axis: int) -> Lags:
        """Return the image summed along an axis: its products are those at all lags along it together."""
        if axis not in self._summed:
            self._summed[axis] = Lags(self.values.sum(axis=axis, keepdims=True))
        return self._summed[axis]

    def line(self, axis: int, count: int) -> _Array:
        """Return the sums at the first lags along an axis, from 0; shape (count,)."""
        known = self._lines.get(axis)
        if known is None or known.size < count:
            known = self._line(axis, count)
            self._lines[axis] = known
        return known[:count]

    def near(self, down: int, right: int) -> _Array:
        """Return the sums at all lags below `down` and `right`, of both signs; shape (2 down - 1, 2 right - 1)."""
        table = self.table(down, right)
        y, x = table.shape[0] // 2, table.shape[1] // 2
        return table[y + 1 - down : y + down, x + 1 - right : x + right]

    def table(self, down: int, right: int) -> _Array:
        """Return the sums as `near`, and at farther lags if these were asked for before; lag 0 is in the middle."""
        known = self._tables.get("near")
        if known is not None:
            of_known = known.shape[0] // 2 + 1, known.shape[1] // 2 + 1
            if down <= of_known[0] and right <= of_known[1]:
                return known
            down, right = max(down, of_known[0]), max(right, of_known[1])
        table = self._near(down, right)
        self._tables["near"] = table
        for axis, line in ((0, table[down - 1 :, right - 1]), (1, table[down - 1, right - 1 :])):
            if axis not in self._lines or self._lines[axis].size < line.size:
                self._lines[axis] = line.copy()
        return table

    def _line(self, axis: int, count: int) -> _Array:
        return _sums(self._transposed if axis == 0 else self.values, 1, count)[0, count - 1 :].copy()

    def _near(self, down: int, right: int) -> _Array:
        return np.array([[self.at_0]]) if down == right == 1 else _sums(self.values, down, right)


def _sums(values: _Array, down: int, right: int) -> _Array:
    """Compute the sums at all lags of both signs, by whichever way is the quicker."""
    height, width = values.shape
    # Of two lags of opposite signs one is enough.
    products = (2 * down - 1) * (2 * right - 1) // 2 * height * (width + right - 1)
    # Half of a transform holds no lags beyond the image.
    if products > _PRODUCTS_OF_TRANSFORM and down <= height:
        n = (height + down - 1) * (width + right - 1)
        if products > _PRODUCTS_OF_TRANSFORM + _PRODUCTS_OF_STEP * n * log2(n):
            return _by_transform(values, down, right)
    from .lags_kernel import sums_at_lags

    return sums_at_lags(np.ascontiguousarray(values), down, right)


def _by_transform(values: _Array, down: int, right: int) -> _Array:
    from scipy import fft

    # Padded so far that no lag asked for wraps around.
    rows, columns = (
        fft.next_fast_len(length + count - 1, real=True)
        for length, count in zip(values.shape, (down, right), strict=True)
    )
    spectrum = fft.rfft(values, columns, axis=1)
    if down == 1:
        of_rows = _power(spectrum).sum(axis=0, keepdims=True)
    else:
        # Power is real: only half of its transform differs, and of that only the lags asked for go on.
        of_rows = fft.rfft(_power(fft.fft(spectrum, rows, axis=0)), axis=0)[:down].conj() / rows
    sums = fft.irfft(of_rows, columns, axis=1)
    half = np.concatenate([sums[:, columns - right + 1 :], sums[:, :right]], axis=1)
    return np.concatenate([half[:0:-1, ::-1], half])


def _power(spectrum: NDArray[np.complex128]) -> _Array:
    power = np.square(spectrum.real)
    power += np.square(spectrum.imag)
    return power


class _MaskLags(Lags):
    """Numbers of pairs of pixels of a mask."""

    @cached_property
    def _full(self) -> bool:
        return bool(self.values.all())

    def _line(self, axis: int, count: int) -> _Array:
        if not self._full:
            return np.rint(super()._line(axis, count))
        return self._of_length(axis, count) * self.shape[1 - axis]

    def _near(self, down: int, right: int) -> _Array:
        if not self._full:
            return np.rint(super()._near(down, right))
        return np.multiply.outer(*(both_signs(self._of_length(axis, n)) for axis, n in enumerate((down, right))))

    def _of_length(self, axis: int, count: int) -> _Array:
        return np.maximum(self.shape[axis] - np.arange(count, dtype=np.float64), 0)


@kept_by_mask
def lags_of_mask(mask: NDArray[np.bool_]) -> Lags:
    """Return the numbers of pairs of pixels of a mask."""
    return _MaskLags(mask.astype(np.float64))


def both_signs(by_lag: _Array) -> _Array:
    """Return values of lags from 0 on, for those below 0 too: shape (2 n - 1,)."""
    return np.concatenate([by_lag[:0:-1], by_lag])
