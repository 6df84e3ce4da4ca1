"""Where the pixels of a sensor clip, by the histogram of its DN: what a file says of it is often too high."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Pixels above this quantile may be defects, such as hot ones.
_DEFECTS = 2e-5
#: Pixels that are piled up, at the least, and how many times as many as below a level.
_LEAST, _TIMES = 50, 4.0
#: Parts of the range above black: the lowest place of a pile, and how far the planes' piles may differ.
_FROM, _ALIKE = 0.8, 0.03


def planes_of(dn: NDArray[Any], colour_filter: str | None) -> list[NDArray[Any]]:
    """Pixels of each colour, in the order of the first 2 x 2; all pixels of a sensor without a colour filter."""
    return [dn] if colour_filter is None else [dn[y::2, x::2] for y in (0, 1) for x in (0, 1)]


@dataclass(frozen=True)
class PlaneClipping:
    """End of the histogram of the pixels of one colour.

    Parameters
    ----------
    largest_dn : int
        Largest DN.
    at_largest : int
        Pixels that have it.
    pile : (int, int) or None
        Lowest and highest DN of the pile of clipped pixels, None if the histogram fades out.
    share : float
        Share of the pixels in the pile and above.
    """

    largest_dn: int
    at_largest: int
    pile: tuple[int, int] | None
    share: float

    @classmethod
    def of(cls, dn: NDArray[Any], black_dn: float, white_dn: float) -> PlaneClipping:
        """Look at the pixels of one colour."""
        largest, pile = int(dn.max()), _pile(dn, black_dn, white_dn)
        share = 0.0 if pile is None else float(np.mean(dn >= pile[0]))
        return cls(largest, int(np.count_nonzero(dn == largest)), pile, share)


def clipping_dn(dn: NDArray[Any], colour_filter: str | None, black_dn: float, white_dn: float) -> float | None:
    """DN from which pixels are clipped, None if no pile of them shows it.

    A sensor that clips piles up pixels at the end of the histogram: at one DN, or spread over a few where the camera
    corrects its DN afterwards. A bright surface does so too, but at other DN in each colour; a spread pile therefore
    counts only where two colours have it at the same DN.

    Parameters
    ----------
    dn : ndarray of uint8 or uint16, shape (height, width)
        All pixels.
    colour_filter : str or None
        Whether they lie behind a Bayer pattern.
    black_dn, white_dn : float
        Levels that the file states.
    """
    piles = [_pile(plane, black_dn, white_dn) for plane in planes_of(dn, colour_filter)]
    sharp = [low for low, high in filter(None, piles) if low == high]
    # The two greens see the same light.
    second_green = {None: 4, "RG": 2, "BG": 2, "GR": 3, "GB": 3}[colour_filter]
    colours = [pile for at, pile in enumerate(piles) if at != second_green]
    lowest = [pile[0] for pile in colours if pile is not None]
    alike = _ALIKE * (white_dn - black_dn)
    found = sharp + [min(a, b) for a, b in combinations(lowest, 2) if abs(a - b) <= alike]
    return float(min(found)) if found else None


def _pile(dn: NDArray[Any], black_dn: float, white_dn: float) -> tuple[int, int] | None:
    """Lowest and highest DN of a pile at the end of a histogram, None if it just fades out."""
    counts = np.bincount(dn.ravel()).astype(float)
    end = int(np.searchsorted(np.cumsum(counts), (1 - _DEFECTS) * dn.size))
    lowest = black_dn + _FROM * (white_dn - black_dn)
    if end < lowest:
        return None
    # Some cameras leave DN out: levels count in steps, not one by one.
    step = max(round((white_dn - black_dn) / 256), 1)
    if counts[end] >= max(_LEAST, _TIMES * counts[max(end - 2 * step, 0) : end].max(initial=0)):
        return end, end
    usual = _TIMES * max(float(counts[max(end - 40 * step, 0) : max(end - 8 * step, 1)].mean()), dn.size * 1e-7)
    over = np.convolve(counts[: end + 1], np.full(step, 1 / step))[: end + 1] > usual
    if not over[end]:
        return None
    start = max(end - int(np.argmin(over[::-1])) - step + 2, 0)
    low = start + int(np.argmax(counts[start : end + 1] > usual))
    return (low, end) if low >= lowest and counts[low : end + 1].sum() >= _LEAST else None
