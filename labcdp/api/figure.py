"""The figure of results of pictures, videos and sessions: CDP of each pair with its interval."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import xarray as xr

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LABELS = {"frame": "frame", "contrast": "Weber contrast to be detected", "pair": "bright region / dark region"}
#: Most lines that a legend names.
_MOST_NAMED = 12


def draw_pairs(dataset: xr.Dataset) -> Figure:
    """Draw CDP over the frames, over several contrasts, or of pairs side by side; a line for each of all others."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import PercentFormatter

    sizes = dataset["cdp"].sizes
    along = next((name for name in ("frame", "contrast") if sizes.get(name, 0) > 1), "pair")
    others = [str(name) for name in sizes if name != along]
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    for position in product(*(range(sizes[name]) for name in others)):
        pair = dataset.isel(dict(zip(others, position, strict=True)))
        values, low, high = (pair[name].values.ravel() for name in ("cdp", "cdp_low", "cdp_high"))
        x = pair[along].values if along in pair.coords else range(values.size)
        named = (f"{float(pair[name]):.4g}" if name == "contrast" else str(pair[name].values) for name in others)
        line = "none" if along == "pair" else "-"
        # A bound may be the value itself, but for rounding.
        errors = [(values - low).clip(0), (high - values).clip(0)]
        axes.errorbar(x, values, errors, marker="o", ms=3, lw=1, ls=line, capsize=2, label=", ".join(named))
    axes.set(xlabel=_LABELS[along], ylabel="CDP", ylim=(-0.02, 1.02))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    if along == "contrast":
        axes.xaxis.set_major_formatter(PercentFormatter(1.0))
    if others and len(axes.containers) <= _MOST_NAMED:
        axes.legend()
    return figure
