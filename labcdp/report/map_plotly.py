"""What all drawings of plotly share: axes, texts, and what is shown under the pointer."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..evaluate.map_axes import MapAxis
from ..evaluate.map_snr import known_values
from .map_scales import cell_edges
from .map_wording import axis_label, shown, variable_name

if TYPE_CHECKING:
    from xarray import Dataset


def axis_settings(axis: MapAxis) -> dict[str, Any]:
    """Title, kind and ends of a drawn axis."""
    kind = ("log" if axis.log else "linear") if axis.numeric else "category"
    settings: dict[str, Any] = {"title": escaped(axis_label(axis)), "type": kind}
    if axis.numeric:
        ends = shown(axis, cell_edges(axis)[[0, -1]])
        settings |= {"tickformat": "~g", "range": (np.log10(ends) if axis.log else ends).tolist()}
    return settings


def hover_rows(section: Dataset, names: Sequence[str], first: int) -> list[str]:
    """Lines of what is shown under the pointer; the values are columns of the custom data from `first` on."""
    return [
        f"{escaped(variable_name(section, name))}: %{{customdata[{number}]:.4~g}}"
        for number, name in enumerate(names, start=first)
    ]


def hover_values(section: Dataset, names: Sequence[str]) -> list[NDArray[np.float64]]:
    """Values of each variable for the pointer; an SNR without noise is not a number."""
    return [known_values(name, section[name].values) for name in names]


def escaped(text: str) -> str:
    """Escape what plotly would take for a tag or, in a template of the hover, for a variable."""
    return escape(text, quote=False).replace("%{", "% {")
