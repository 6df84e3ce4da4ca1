"""What integers look like whose file does not say it: made for screens, above a black level, or a mosaic."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.companding import Companding
from ..core.result import Finding, FindingValue, warning
from .stored_image import SCREEN_BITS
from .transfer import Encoding, decoded, encoding_name

#: Pixels that are looked at: rows are left out of larger pictures.
_LOOKED_AT = 2_000_000
#: Pictures for screens use all of the scale, and most of their pixels are between dark and bright, of all levels there;
#: light itself is dark in most places, as the middle of sRGB is 21 % of white. Shares of the scale, for the darkest and
#: the brightest pixels and for what is between. Of 24 photographs 10 are known by that; of their light one; no
#: targets of some patches, no noise and no gradient.
_DARK, _BRIGHT, _BETWEEN = 0.2, 0.8, (0.2, 0.8)
#: Share of the pixels that are dark, and bright, at least; between; and in each of the levels between.
_ENDS, _MOST, _EACH, _LEVELS = 0.01, 0.65, 0.01, 12
#: Fewer pixels have no histogram.
_FEWEST = 1000
#: Black levels of cameras, as a share of the scale; pictures that begin above have no dark place.
_LEAST_BLACK, _MOST_BLACK = 0.01, 0.125
#: End of the scale of values of any number of bits.
_ANY_BITS = 65535
#: Share of the pixels that may be below the black level, by noise and defects.
_BELOW = 1e-4
#: Relative difference of the pixels of a mosaic, and how alike its two green ones are.
_OF_MOSAIC, _ALIKE = 0.03, 0.015
#: Pixels along a side from which a mosaic can be seen.
_SMALLEST = 16
#: Steps of a curve that is read backwards.
_STEPS = 2**14
#: Relative difference of two contrasts from which it matters how values are read.
_MATTERS = 0.02
#: Codes of the warnings that values may be read otherwise; ``-pair`` and ``-frames`` may follow.
ENCODING, BLACK_LEVEL, MOSAIC = "encoding-assumed", "black-level-doubtful", "mosaic-doubtful"
#: Patterns of a colour filter by where the two green pixels are: beside the diagonal from the upper left, or on it.
_PATTERNS = ("RGGB or BGGR", "GRBG or GBRG")


@dataclass(frozen=True)
class Doubts:
    """What is doubtful about values, and two of them to show what that matters.

    Parameters
    ----------
    encoding : str
        How they are taken to be encoded.
    other_encoding : str or None
        How they may be encoded as well; None where a file states it.
    black_dn : float or None
        Where the histogram of linear values begins, if that may be a black level that nothing states.
    mosaic : str
        Patterns of a colour filter that grey pixels may lie behind; empty for none.
    low, high : float
        Means of the darker and of the brighter half of the values, as shares of the scale.
    black : float
        `black_dn` as a share of the scale.
    """

    encoding: Encoding = "linear"
    other_encoding: Encoding | None = None
    black_dn: float | None = None
    mosaic: str = ""
    low: float = 0.0
    high: float = 0.0
    black: float = 0.0

    @property
    def colour_filter(self) -> str | None:
        """One of the filters of the mosaic: of both, green is at the same places."""
        return self.mosaic[:2] or None

    @property
    def codes(self) -> tuple[str, ...]:
        """Codes of the warnings, one for each way in which values may be read otherwise."""
        doubtful = {ENCODING: self.other_encoding is not None, BLACK_LEVEL: self.black_dn is not None}
        return tuple(code for code, is_so in {**doubtful, MOSAIC: bool(self.mosaic)}.items() if is_so)

    def _read_by(self, code: str) -> tuple[Encoding, float]:
        """Return encoding and black level, a share of the scale, as a code says; as taken for none."""
        other = self.other_encoding if code == ENCODING else None
        return other or self.encoding, self.black if code == BLACK_LEVEL else 0.0

    def contrast(self, code: str = "") -> float:
        """Weber contrast of the brighter half of the values to the darker one, read otherwise if a code is given."""
        encoding, black = self._read_by(code)
        low, high, zero = decoded([self.low, self.high, black], encoding)
        return float((high - zero) / (low - zero) - 1) if low > zero else inf

    def light(self, taken: float, code: str) -> float:
        """Return light, as a share of the scale, that was taken as such, if its value is read otherwise."""
        encoding, black = self._read_by(code)
        value = float(np.interp(taken, *_curve(self.encoding)))
        return float(decoded([value], encoding)[0]) - black

    def finding(self, code: str, taken: float, otherwise: float, pair: str = "", **of_frames: FindingValue) -> Finding:
        """Return the warning, about a pair of regions if it is named, of a video with what is said of its frames."""
        about: dict[str, FindingValue] = {"mosaic": self.mosaic}
        if code == ENCODING:
            about = {"encoding": encoding_name(self.encoding), "other": encoding_name(self.other_encoding or "")}
        elif code == BLACK_LEVEL:
            about = {"black_dn": self.black_dn}
        kind = f"{code}-frames" if of_frames else f"{code}-pair" if pair else code
        return warning(kind, pair, taken=taken, otherwise=otherwise, **about, **of_frames)


def contrast_matters(taken: float, otherwise: float) -> bool:
    """Whether a contrast and that by another reading of the values differ so that it matters."""
    return abs(otherwise - taken) > _MATTERS * (1 + min(taken, otherwise)) * (taken > 0)


@cache
def _curve(encoding: Encoding) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Light and values of an encoding, in small steps."""
    values = np.linspace(0.0, 1.0, _STEPS)
    return decoded(values, encoding), values


#: Nothing is.
CERTAIN = Doubts()


def histogram_of(values: NDArray[np.unsignedinteger[Any]]) -> NDArray[np.int64]:
    """Count grey values, or colours, of some rows of a large image: pixels by value.

    Parameters
    ----------
    values : ndarray of uint8 or uint16, shape (height, width) or (height, width, 3)
        The values.
    """
    some = values[:: max(values.size // _LOOKED_AT, 1)]
    return np.bincount(some.ravel())


def _quantile(counts: NDArray[np.int64], share: float) -> float:
    """Return the value up to which a share of the pixels lies."""
    return float(np.searchsorted(np.cumsum(counts), share * counts.sum(), side="left"))


def _is_for_screens(counts: NDArray[np.int64], top_dn: float) -> bool:
    """Whether a histogram looks like that of a picture for screens, and not of light."""
    n = counts.sum()
    if n < _FEWEST:
        return False
    if _quantile(counts, _ENDS) > _DARK * top_dn or _quantile(counts, 1 - _ENDS) < _BRIGHT * top_dn:
        return False
    levels, _ = np.histogram(np.arange(counts.size) / top_dn, np.linspace(*_BETWEEN, _LEVELS + 1), weights=counts)
    return bool(levels.sum() >= _MOST * n and levels.min() >= _EACH * n)


def _black_dn(counts: NDArray[np.int64], top_dn: float) -> float | None:
    """Where a histogram begins, if that may be a black level; None for at 0, or far above."""
    begins, largest = _quantile(counts, _BELOW), counts.size - 1
    # Of 16 bits, how many of them a camera uses is often not known.
    top_dn = top_dn if top_dn < _ANY_BITS else 2.0 ** largest.bit_length() - 1
    return begins if _LEAST_BLACK * top_dn <= begins <= _MOST_BLACK * top_dn else None


def _halves(counts: NDArray[np.int64], top_dn: float) -> tuple[float, float]:
    """Means of the darker and of the brighter half of the pixels, as shares of the scale."""
    values = np.arange(counts.size)
    behind = np.clip(np.cumsum(counts) - counts.sum() // 2, 0, counts)
    low, high = (float(np.average(values, weights=part)) if part.any() else 0.0 for part in (counts - behind, behind))
    return low / top_dn, high / top_dn


def doubts_of(
    values: NDArray[np.unsignedinteger[Any]],
    top_dn: float,
    encoding: Encoding,
    other_encoding: Encoding | None,
    histogram: NDArray[np.int64] | None = None,
    *,
    as_stored: bool,
) -> Doubts:
    """Look for what is doubtful about values.

    Parameters
    ----------
    values : ndarray of uint8 or uint16, shape (height, width) or (height, width, 3)
        Grey, or colours.
    top_dn : float
        End of the scale.
    encoding, other_encoding
        As of `Doubts`.
    histogram : ndarray of int, shape (n,), or None
        Of the values, if it is known.
    as_stored : bool
        Whether they are grey values of which neither a black level nor a colour filter is known.
    """
    counts = histogram_of(values) if histogram is None else histogram
    if as_stored and isinstance(encoding, Companding):
        # The curve makes colours of bright places alike.
        values = encoding.light(encoding.file_bits).astype(np.float32)[values]
    mosaic = mosaic_of(values) if as_stored else ""
    if mosaic and other_encoding is not None:
        # Nobody develops a picture behind its colour filter.
        encoding, other_encoding = "linear", None
    has_no_black = encoding == "linear" or (isinstance(encoding, Companding) and encoding.black_dn == 0)
    black_dn = _black_dn(counts, top_dn) if as_stored and has_no_black else None
    return Doubts(encoding, other_encoding, black_dn, mosaic, *_halves(counts, top_dn), (black_dn or 0.0) / top_dn)


def encodings(
    histogram: NDArray[np.int64], top_dn: float, bits: int, coloured: bool
) -> tuple[Encoding, Encoding | None]:
    """Return how values are taken to be encoded that a file does not state, and how else they may be.

    Grey of up to 8 bits is a camera's, in proportion to light, and colours of 8 bits are sRGB, unless the histogram
    looks otherwise; more bits are mostly a camera's.
    """
    for_screens = _is_for_screens(histogram, top_dn)
    if bits <= SCREEN_BITS:
        return ("srgb", "linear") if coloured or for_screens else ("linear", "srgb")
    if coloured:
        return ("srgb", "linear") if for_screens else ("linear", "srgb")
    return "linear", "srgb" if for_screens else None


def mosaic_of(values: NDArray[Any]) -> str:
    """Return which patterns of a colour filter grey values may lie behind; empty for none.

    The four pixels of groups of 2 x 2 are alike in most places of pictures. Behind a filter those of green are, on a
    diagonal; on the other one red and blue are different. A pattern of single pixels has two equal ones there.

    Parameters
    ----------
    values : ndarray of int or float, shape (height, width)
        The pixels.
    """
    height, width = (length // 2 * 2 for length in values.shape)
    if min(height, width) < _SMALLEST:
        return ""
    step = 2 * max(height * width // _LOOKED_AT, 1)
    pixels = np.array([
        [values[row:height:step, column:width:2] for column in (0, 1)] for row in (0, 1)
    ], dtype=np.float32)  # fmt: skip
    mean = pixels.mean(axis=(0, 1))
    lit = mean > 0
    if not lit.any():
        return ""
    # Of lines and edges, which may lie on every second pixel, most groups have nothing.
    means = np.median(pixels[:, :, lit] / mean[lit], axis=2)
    diagonals = (means[0][1], means[1][0]), (means[0][0], means[1][1])
    apart = [abs(float(a) - float(b)) for a, b in diagonals]
    for green, other in ((0, 1), (1, 0)):
        if apart[green] < _ALIKE and apart[other] > _OF_MOSAIC:
            return _PATTERNS[green]
    return ""
