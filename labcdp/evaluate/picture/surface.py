"""The luminance of a picture as a 3-D surface: an interactive page that needs nothing else."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...report.drawing import block_mean
from ...report.html import render_page
from ...report.layout import Page, Script, Section
from ...report.text import shortened, significant
from .figures import luminance_label

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from ...core.luminance import LuminanceMap

#: Largest side of the surface in points: as many as a browser opens and turns without a wait.
MOST_POINTS = 200
#: Height of the surface over the longer side of the picture.
_HEIGHT = 0.45


def surface_page(luminance: LuminanceMap, name: str, unit: str) -> str:
    """Draw a luminance map as a surface that can be turned.

    A large map is drawn by blocks of pixels. Their means are shown, or by a button their largest values, and the
    brightest pixel of all is marked at its place and height, as a mean alone would hide it.

    Parameters
    ----------
    luminance : LuminanceMap
        The map.
    name : str
        Subject.
    unit : str
        Unit of its values, ``cd/m²`` or ``relative``.

    Returns
    -------
    str
        HTML 5, with the drawing program (plotly.js, 4.8 MB) inside; its security policy forbids to load anything.
    """
    values = np.asarray(luminance.luminance_cd_m2)
    side = ceil(max(values.shape) / MOST_POINTS)
    figure = _figure(values, side, luminance.step, luminance_label(unit))
    lines = Section("", _lines(values, side, luminance.step, unit))
    title = shortened(name, 120)
    return render_page(Page("Luminance as a surface", title, lead=[_script(figure)], sections=[lines]))


def _script(figure: Figure) -> Script:
    figure.update_layout(template="plotly_white")
    # plotly's own button would upload the figure to plotly's servers.
    config = {"displaylogo": False, "responsive": True, "showSendToCloud": False}
    return Script(figure.to_html(full_html=False, include_plotlyjs=True, div_id="figure", config=config))


def block_max(values: NDArray[Any], side: int) -> NDArray[Any]:
    """Largest value of each block of `side` x `side` pixels; nan where a block holds none that is a number."""
    rows, columns = (np.arange(0, n, side) for n in values.shape)
    return np.asarray(np.fmax.reduceat(np.fmax.reduceat(values, rows, axis=0), columns, axis=1))


def brightest(values: NDArray[Any]) -> tuple[int, int]:
    """Row and column of the largest value that is a finite number."""
    row, column = np.unravel_index(np.argmax(np.where(np.isfinite(values), values, -np.inf)), values.shape)
    return int(row), int(column)


def _lines(values: NDArray[Any], side: int, step: int, unit: str) -> list[str]:
    height, width = (length * step for length in values.shape)
    row, column = brightest(values)
    where = f"x = {(column + 0.5) * step:g}, y = {(row + 0.5) * step:g}"
    lines = [
        f"{width} x {height} pixels. Drag to turn, scroll to zoom, and point to read a value. The red mark is the "
        f"brightest pixel of all, {significant(float(values[row, column]), 4)} "
        f"{'(relative)' if unit == 'relative' else unit} at {where}, at its own height."
    ]
    if side > 1:
        block = side * step
        lines.append(
            f"So that the page opens and turns smoothly, each point stands for a block of {block} x {block} pixels of "
            "the picture: the button “means” shows the mean of each block, “maxima” its brightest pixel. A mean "
            "hides anything smaller than a block; the pointer shows both."
        )
    if not np.isfinite(values).all():
        lines.append("Pixels that are not numbers are left out; a block with no other pixels is a hole.")
    return lines


def _figure(values: NDArray[Any], side: int, step: int, label: str) -> Figure:
    from plotly.graph_objects import Figure, Scatter3d, Surface

    finite = np.isfinite(values)
    usable = np.where(finite, values, np.nan)
    # Means of the numbers in each block; nan where there is none.
    with np.errstate(divide="ignore", invalid="ignore"):
        means = (block_mean(np.where(finite, values, 0.0), side) / block_mean(finite, side)).astype(np.float32)
    maxima = block_max(usable, side).astype(np.float32)
    height, width = values.shape
    x, y = (_middles(length, side, step) for length in (width, height))
    row, column = brightest(values)
    peak = float(values[row, column])
    low, high = _range(means, peak)

    def surface(z: NDArray[Any], other: NDArray[Any], names: tuple[str, str]) -> Surface:
        texts = [f"{names[0]} %{{z:.4g}}", f"{names[1]} %{{customdata:.4g}}", "x %{x:.0f}", "y %{y:.0f}"]
        return Surface(
            x=x,
            y=y,
            z=z,
            customdata=other,
            hovertemplate="<br>".join(texts if side > 1 else texts[:1] + texts[2:]) + "<extra></extra>",
            colorscale="Viridis",
            cmin=low,
            cmax=high if not np.isfinite(z).any() else max(float(np.nanmax(z)), low + 1e-9),
            colorbar={"title": {"text": label, "side": "right"}, "thickness": 18, "len": 0.7},
            # Lines under the pointer are slow to draw and add little.
            contours={axis: {"highlight": False} for axis in "xyz"},
            visible=names[0] == "mean",
        )

    surfaces = [surface(means, maxima, ("mean", "largest"))]
    if side > 1:
        surfaces.append(surface(maxima, means, ("largest", "mean")))
    mark = Scatter3d(
        x=[(column + 0.5) * step] * 2,
        y=[(row + 0.5) * step] * 2,
        z=[low, peak],
        mode="lines+markers",
        line={"color": "#D55E00", "width": 4},
        marker={"color": "#D55E00", "size": [0.1, 7]},
        hovertemplate="brightest pixel %{z:.4g}<br>x %{x:.1f}<br>y %{y:.1f}<extra></extra>",
        name="brightest pixel",
        showlegend=False,
    )
    figure = Figure([*surfaces, mark])
    figure.update_layout(
        height=680, margin={"l": 0, "r": 0, "t": 40, "b": 0}, scene=_scene(width, height, step, (low, high), label)
    )
    if side > 1:
        buttons = [
            {"label": name, "method": "restyle", "args": [{"visible": visible}, [0, 1]]}
            for name, visible in (("means", [True, False]), ("maxima", [False, True]))
        ]
        menu = {"type": "buttons", "direction": "right", "buttons": buttons, "x": 0, "xanchor": "left", "y": 1.06}
        figure.update_layout(updatemenus=[menu])
    return figure


def _scene(width: int, height: int, step: int, ends: tuple[float, float], label: str) -> dict[str, Any]:
    longest = max(width, height)
    return {
        "xaxis": {"title": "x in pixels", "range": [0, width * step]},
        # As the picture: y runs down, towards the eye.
        "yaxis": {"title": "y in pixels", "range": [height * step, 0]},
        "zaxis": {"title": label, "range": list(ends), "tickformat": "~g"},
        "aspectmode": "manual",
        "aspectratio": {"x": width / longest, "y": height / longest, "z": _HEIGHT},
        "camera": {"eye": {"x": 0.27, "y": -1.12, "z": 0.84}, "center": {"x": 0.0, "y": 0.0, "z": -0.16}},
    }


def _middles(length: int, side: int, step: int) -> NDArray[np.float32]:
    """Middles of the blocks along an axis, in pixels of the picture."""
    starts = np.arange(0, length, side)
    return np.asarray(step * (starts + np.minimum(starts + side, length)) / 2, dtype=np.float32)


def _range(means: NDArray[np.float32], peak: float) -> tuple[float, float]:
    """Return the ends of the axis of luminance, with the brightest pixel inside."""
    lowest = float(np.nanmin(means)) if np.isfinite(means).any() else 0.0
    low = min(0.0, lowest)
    high = peak if peak > low else low + 1.0
    return low, high + 0.03 * (high - low)
