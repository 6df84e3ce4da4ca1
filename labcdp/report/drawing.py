"""What all figures share: size, fonts, PNG, and images made small enough to draw."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

#: Resolution of all figures.
DPI = 150

#: Font sizes in points.
TITLE_SIZE, LABEL_SIZE, SMALL_SIZE = 11.0, 10.0, 9.0

#: Colours that colour-blind readers tell apart (M. Okabe and K. Ito, Color Universal Design, 2008).
BLUE, ORANGE, VERMILLION, GREEN = "#0072B2", "#E69F00", "#D55E00", "#009E73"

#: Largest side of a drawn image in pixels: no more than a figure has for it, so that none is lost.
_LARGEST_SIDE = 850


def new_figure(width_in: float, height_in: float, simulated: bool) -> Figure:
    """Make a figure that is drawn by Agg and knows no other figure; one of a simulated bench says so."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # "compressed" is the constrained layout, which also keeps what surrounds a picture close to it.
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="compressed")
    FigureCanvasAgg(figure)
    if simulated:
        mark_simulated(figure, "bench")
    return figure


def mark_simulated(figure: Figure, what: str) -> None:
    """Say above a figure without a title of its own that a bench, or a chain, is simulated."""
    figure.suptitle(f"simulated {what}", x=0.01, ha="left", fontsize=SMALL_SIZE, color=VERMILLION)


def png(figure: Figure) -> bytes:
    """Draw a figure, without empty margins."""
    file = BytesIO()
    with missing_glyphs_allowed():
        figure.savefig(file, format="png", dpi=DPI, bbox_inches="tight", pad_inches=0.08)
    return file.getvalue()


@contextmanager
def missing_glyphs_allowed() -> Iterator[None]:
    """Draw a box, without a word, for a character the font does not have."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        warnings.filterwarnings("ignore", "Matplotlib currently does not support", UserWarning)
        yield


def label(axes: Axes, x: str, y: str, title: str) -> None:
    """Set title and axis labels, as they are written: a name with $ signs is no formula."""
    axes.set_title(title, fontsize=TITLE_SIZE, parse_math=False)
    axes.set_xlabel(x, fontsize=LABEL_SIZE)
    axes.set_ylabel(y, fontsize=LABEL_SIZE)
    axes.tick_params(labelsize=SMALL_SIZE)


def plain_numbers(axis: Any) -> None:
    """Write 0.1, 1, 10 and not powers of ten at an axis."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    axis.set_major_formatter(FuncFormatter(lambda value, _position: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def taken_literally(legend: Legend) -> None:
    """Make a legend show its texts as they are written."""
    for text in legend.get_texts():
        text.set_parse_math(False)


def reduction(shape: tuple[int, int]) -> int:
    """Pixels of an image of `shape` (height, width), along each side, that one drawn pixel stands for."""
    return ceil(max(shape) / _LARGEST_SIDE)


def block_mean(image: NDArray[Any], side: int) -> NDArray[np.float64]:
    """Mean over blocks of `side` x `side` pixels; blocks at the lower and right edge may be smaller.

    A mean keeps what is smaller than a block, where taking every n-th pixel could miss it.

    Parameters
    ----------
    image : ndarray of float or bool, shape (height, width)
        For a mask, the result is the share of its pixels.
    side : int
        At least 1.

    Returns
    -------
    ndarray of float, shape (ceil(height / side), ceil(width / side))
    """
    dtype = np.float64 if image.dtype.kind == "f" else np.int64
    rows, columns = (np.arange(0, n, side) for n in image.shape)
    sums = np.add.reduceat(np.add.reduceat(image, rows, axis=0, dtype=dtype), columns, axis=1)
    sizes = [np.diff(starts, append=n) for starts, n in zip((rows, columns), image.shape, strict=True)]
    means: NDArray[np.float64] = sums / np.outer(*sizes)
    return means
