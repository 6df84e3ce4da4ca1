"""Common parts of figures: size, fonts, PNG output, and downsampled images."""

from __future__ import annotations

import warnings
from io import BytesIO
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .layout import ReportFigure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend


#: Resolution of figures, and of those with fixed axes, which are drawn faster; an image has at least `_LARGEST_SIDE`
#: pixels in the latter.
DPI, SCREEN_DPI = 150, 138

#: Font sizes in points.
TITLE_SIZE, LABEL_SIZE, SMALL_SIZE = 11.0, 10.0, 9.0

#: Colours distinguishable by colour-blind readers (M. Okabe and K. Ito, Color Universal Design, 2008).
BLUE, ORANGE, VERMILLION, GREEN = "#0072B2", "#E69F00", "#D55E00", "#009E73"

#: Largest side of a drawn image in pixels: what a figure resolves (6.2 inches).
_LARGEST_SIDE = 680


def new_figure(width_in: float, height_in: float, simulated: str = "") -> Figure:
    """Make a figure drawn by Agg, independent of pyplot; simulated data is labelled as such."""
    # "compressed" is the constrained layout that also keeps decorations close to an image.
    return _figure(width_in, height_in, simulated, dpi=DPI, layout="compressed")


def placed_figure(width_in: float, height_in: float, simulated: str = "") -> Figure:
    """Make a figure with fixed axes; without a layout engine it is drawn in a third of the time."""
    return _figure(width_in, height_in, simulated, dpi=SCREEN_DPI)


def _figure(width_in: float, height_in: float, simulated: str, **how: Any) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), **how)
    FigureCanvasAgg(figure)
    if simulated:
        figure.suptitle(f"simulated {simulated}", x=0.01, ha="left", fontsize=SMALL_SIZE, color=VERMILLION)
    return figure


def png(figure: Figure) -> bytes:
    """Draw a figure, cropped to its content unless its axes are fixed."""
    file = BytesIO()
    placed = figure.get_layout_engine() is None
    with warnings.catch_warnings():
        # A character missing in the font is drawn as a box.
        warnings.filterwarnings("ignore", "Glyph .* missing from|Matplotlib currently does not support", UserWarning)
        # Noise compresses hardly better at a higher level, which takes its time.
        how = {"compress_level": 1} if placed else {}
        margins = None if placed else "tight"
        figure.savefig(file, format="png", dpi=figure.dpi, bbox_inches=margins, pad_inches=0.08, pil_kwargs=how)
    return file.getvalue()


def reported(name: str, figure: Figure, caption: str, alternative: str = "") -> ReportFigure:
    """Draw a figure for a page; its caption is also its alternative, unless another one is given."""
    return ReportFigure(f"{name}.png", png(figure), caption, alternative or caption)


def label(axes: Axes, x: str, y: str, title: str) -> None:
    """Set title and axis labels verbatim: a name with $ signs is no formula."""
    axes.set_title(title, fontsize=TITLE_SIZE, parse_math=False)
    axes.set_xlabel(x, fontsize=LABEL_SIZE)
    axes.set_ylabel(y, fontsize=LABEL_SIZE)
    axes.tick_params(labelsize=SMALL_SIZE)


def finish(axes: Axes, x: str, y: str, title: str, **legend: Any) -> None:
    """Add labels, grid and, where curves have names, a legend with matplotlib's settings `legend` to a plot."""
    label(axes, x, y, title)
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        add_legend(axes, **legend)


def plain_numbers(axis: Any) -> None:
    """Label an axis with 0.1, 1, 10 instead of powers of ten."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    axis.set_major_formatter(FuncFormatter(lambda value, _position: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def logarithmic(*drawn: Any) -> None:
    """Make axes with what is drawn logarithmic, with numbers at decades, on a short axis also between them."""
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

    for axis in drawn:
        axis.axes.set(**{f"{axis.axis_name}scale": "log"})
        low, high = sorted(axis.get_view_interval())
        decades = np.log10(high / low)
        if decades <= 2.5:
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades > 1 else (1.0, 2.0, 3.0, 5.0, 7.0)))
        if low < 1e-4 or high > 1e5:
            axis.set_major_formatter(LogFormatterSciNotation())
            axis.set_minor_formatter(NullFormatter())
        else:
            plain_numbers(axis)


def add_legend(owner: Axes | Figure, *entries: Any, **how: Any) -> None:
    """Add a legend in the small size, with its texts verbatim; arguments are those of matplotlib."""
    taken_literally(owner.legend(*entries, fontsize=SMALL_SIZE, **how))


def taken_literally(legend: Legend) -> None:
    """Make a legend show its texts verbatim."""
    for text in legend.get_texts():
        text.set_parse_math(False)


def reduction(shape: tuple[int, int]) -> int:
    """Pixels of an image of `shape` (height, width), along each side, per drawn pixel."""
    return ceil(max(shape) / _LARGEST_SIDE)


def block_mean(image: NDArray[Any], side: int) -> NDArray[np.float64]:
    """Mean over blocks of `side` x `side` pixels; blocks at the lower and right edge may be smaller.

    A mean keeps details smaller than a block, which taking every n-th pixel could miss.

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
    sums = _sums_of_rows(_sums_of_rows(image, side).T, side).T
    sizes = [np.diff(np.arange(0, n, side), append=n) for n in image.shape]
    return np.asarray(sums / np.outer(*sizes))


def _sums_of_rows(image: NDArray[Any], side: int) -> NDArray[Any]:
    """Sum each `side` successive rows; a quarter of the time of ``np.add.reduceat``."""
    sums = image[::side].astype(np.float64 if image.dtype.kind == "f" else np.int64)
    for k in range(1, side):
        rows = image[k::side]
        sums[: len(rows)] += rows
    return sums
