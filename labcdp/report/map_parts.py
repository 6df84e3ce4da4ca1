"""The parts of a map that pictures, page and spreadsheet show side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..evaluate.map_axes import At, MapAxis, MapLayout, map_axis, sections
from ..evaluate.map_snr import LARGEST_SNR, SNR_VARIABLES
from .drawing import BLUE, GREEN, ORANGE, VERMILLION

if TYPE_CHECKING:
    from xarray import Dataset

    from ..evaluate.maps import MapAnalysis

#: More panels than this are too small to read.
MOST_PANELS = 12

#: One colour a curve; no reader tells more of them apart.
COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, "#CC79A7", "#56B4E9", "#000000", "#8C7500")

#: Colours of the SNR of a single curve, none of them that of its CDP.
SNR_COLOURS = {"snr_dark": GREEN, "snr_bright": "#CC79A7", "csnr": "#000000"}


def axes_of(dataset: Dataset) -> dict[str, MapAxis]:
    """All axes of a map by name."""
    return {str(name): map_axis(dataset, str(name)) for name in dataset["cdp"].dims}


def panels_of(dataset: Dataset, layout: MapLayout) -> list[tuple[At, Dataset]]:
    """Sections of a map over the two axes of its picture.

    Raises
    ------
    InputError
        If there are more than 12.
    """
    return _at_most(MOST_PANELS, "panels", list(sections(dataset, layout.spanned)), layout)


def curves_of(dataset: Dataset, layout: MapLayout) -> list[tuple[At, Dataset]]:
    """Sections of a map along the one axis of its picture.

    Raises
    ------
    InputError
        If there are more than 8.
    """
    return _at_most(len(COLOURS), "curves", list(sections(dataset, layout.spanned)), layout)


def snr_of(dataset: Dataset, analysis: MapAnalysis, n_curves: int) -> list[str]:
    """Which SNR are drawn below CDP: all the map has, of many curves only that in which dips were looked for."""
    names = [name for name in SNR_VARIABLES if name in dataset]
    return names if n_curves == 1 else [name for name in names if name in analysis.dip_variables]


def _at_most(most: int, what: str, parts: list[tuple[At, Dataset]], layout: MapLayout) -> list[tuple[At, Dataset]]:
    if len(parts) > most:
        raise InputError(
            f"the map needs {len(parts)} {what} over {', '.join(layout.others)}, at most {most} can be drawn: "
            f"fix a value of {layout.others[-1]}"
        )
    return parts


def decibels(ratio: NDArray[Any]) -> NDArray[np.float64]:
    """20 log10 of a ratio, as EMVA 1288 gives SNR; nan where it is 0 or there is no noise."""
    values = np.asarray(ratio, dtype=np.float64)
    fits = (values > 0) & (values <= LARGEST_SNR)
    return 20 * np.log10(np.where(fits, values, np.nan))
