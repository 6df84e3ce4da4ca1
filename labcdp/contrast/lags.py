"""Sums of the products of pairs of pixels, by the lag between the two."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

#: For more lags than this, for each axis with lags, a Fourier transform is quicker than one pass over the pixels for
#: each lag.
_MOST_PASSES = 40


@dataclass(frozen=True, eq=False)
class Lags:
    """Sums of the products of all pairs of pixels of an image at a lag (dy, dx).

    Parameters
    ----------
    values : ndarray of float, shape (height, width)
        The image; what does not count is 0.
    """

    values: NDArray[np.float64]
    _known: dict[tuple[int, int], NDArray[np.float64]] = field(default_factory=dict, init=False, repr=False)

    @property
    def shape(self) -> tuple[int, ...]:
        """Height and width of the image."""
        return self.values.shape

    @cached_property
    def at_0(self) -> float:
        """Sum of the squares."""
        flat = self.values.ravel()
        return float(flat @ flat)

    def summed(self, axis: int) -> Lags:
        """Return the image summed along an axis: its products are those at all lags along it together."""
        return Lags(self.values.sum(axis=axis, keepdims=True))

    def line(self, axis: int, count: int) -> NDArray[np.float64]:
        """Return the sums at the first lags along an axis, from 0; shape (count,)."""
        return self.near(count, 1)[count - 1 :, 0] if axis == 0 else self.near(1, count)[0, count - 1 :]

    def near(self, down: int, right: int) -> NDArray[np.float64]:
        """Return the sums at all lags below `down` and `right`, of both signs; shape (2 down - 1, 2 right - 1)."""
        if (down, right) not in self._known:
            self._known[down, right] = self._near(down, right)
        return self._known[down, right]

    def _near(self, down: int, right: int) -> NDArray[np.float64]:
        if down == right == 1:
            return np.array([[self.at_0]])
        # Of two lags of opposite signs one is enough.
        lags = (2 * down - 1) * (2 * right - 1) // 2
        if lags > _MOST_PASSES * ((down > 1) + (right > 1)):
            half = self._by_transform(down, right)
        else:
            half = self._by_passes(down, right)
        return np.concatenate([half[:0:-1, ::-1], half])

    def _by_passes(self, down: int, right: int) -> NDArray[np.float64]:
        """Return the sums at lags dy from 0 on."""
        height, width = self.shape
        # Zeros between the rows: shifted as one long row, no pixel meets one of a row that it should not meet.
        row = width + right - 1
        padded = np.zeros((height, row))
        padded[:, :width] = self.values
        flat = padded.ravel()
        sums = np.zeros((down, 2 * right - 1))
        for dy in range(min(down, height)):
            for dx in range(0 if dy == 0 else 1 - right, right):
                shift = dy * row + dx
                sums[dy, right - 1 + dx] = flat[shift:] @ flat[: flat.size - shift]
        sums[0, : right - 1] = sums[0, : right - 1 : -1]
        return sums

    def _by_transform(self, down: int, right: int) -> NDArray[np.float64]:
        """Return the sums at lags dy from 0 on."""
        from scipy import fft

        # Padded so far that no lag asked for wraps around; an axis without lags need not be transformed.
        counts = (down, right)
        axes = [axis for axis in (0, 1) if counts[axis] > 1]
        lengths = [fft.next_fast_len(self.shape[axis] + counts[axis] - 1, real=True) for axis in axes]
        spectrum = fft.rfftn(self.values, lengths, axes)
        power = np.square(spectrum.real) + np.square(spectrum.imag)
        for axis in {0, 1} - set(axes):
            power = power.sum(axis=axis, keepdims=True)
        sums = fft.irfftn(power, lengths, axes)[:down]
        return np.concatenate([sums[:, sums.shape[1] - right + 1 :], sums[:, :right]], axis=1)


class _MaskLags(Lags):
    """Numbers of pairs of pixels of a mask."""

    def _near(self, down: int, right: int) -> NDArray[np.float64]:
        if not self.values.all():
            return np.rint(super()._near(down, right))
        pairs = [
            np.maximum(length - both_signs(np.arange(count, dtype=np.float64)), 0)
            for length, count in zip(self.shape, (down, right), strict=True)
        ]
        return np.multiply.outer(*pairs)


def lags_of_mask(mask: NDArray[np.bool_]) -> Lags:
    """Return the numbers of pairs of pixels of a mask."""
    return _MaskLags(mask.astype(np.float64))


def both_signs(by_lag: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values of lags from 0 on, for those below 0 too: shape (2 n - 1,)."""
    return np.concatenate([by_lag[:0:-1], by_lag])
