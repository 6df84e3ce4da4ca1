"""All regions of the live image against all, as of a chart of many patches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, FactorRange, HoverTool, LinearColorMapper
from bokeh.palettes import Viridis256
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.roi import Roi
from ...metrics.matrix import cdp_matrix
from ...metrics.region import SATURATED_SHARE
from ..html import small_plot
from ..regions.page_image import PageImage
from .pair import Target

_Array = NDArray[np.float64]
#: Regions from which all pairs are shown together: fewer are chosen pair by pair.
FEWEST_REGIONS = 7
#: Pixels of a row of the map, beside its axis.
_ROW_PX, _AXIS_PX = 9, 70


@dataclass(frozen=True, eq=False)
class LiveMatrix:
    """CDP of all pairs of regions in an image.

    Parameters
    ----------
    names : tuple of str
        The regions, the brightest first.
    cdp, target, measured : ndarray of float, shape (n, n)
        CDP, the contrast to be detected, and the measured one; nan where a region is saturated or there is no contrast.
    """

    names: tuple[str, ...]
    cdp: _Array
    target: _Array
    measured: _Array

    @property
    def weakest(self) -> tuple[str, float] | None:
        """Regions next to each other in brightness with the lowest CDP, and this; None if none has one."""
        steps = np.diagonal(self.cdp, 1)
        if not np.isfinite(steps).any():
            return None
        at = int(np.nanargmin(steps))
        return f"{self.names[at]} / {self.names[at + 1]}", float(steps[at])


def live_matrix(image: PageImage, rois: Sequence[Roi], target: Target) -> Iterator[LiveMatrix | None]:
    """Yield the matrix of regions of an image, once; None if fewer than two can be measured.

    Parameters
    ----------
    image : PageImage
        The image.
    rois : sequence of Roi
        The regions.
    target : Target
        What is to be detected: of several contrasts the first one, or the measured contrast of each pair.
    """
    light: dict[str, Any] = {}
    saturated: list[bool] = []
    for roi in rois:
        # A region outside the image has a message of its own.
        with suppress(InputError):
            light[roi.name] = image.light_in(roi).astype(np.float64)
            saturated.append(bool(roi.select(image.saturated).mean() > SATURATED_SHARE))
    if len(light) < 2:
        yield None
        return
    order = np.argsort([-float(values.mean()) for values in light.values()], kind="stable")
    names, full = list(light), np.array(saturated)[order]
    contrast = None if target.contrasts is None else target.contrasts[0]
    matrix = cdp_matrix({names[at]: light[names[at]] for at in order.tolist()}, contrast, target.epsilon)
    apart = ~(full | full[:, None])
    cdp, measured = (np.where(apart, matrix[name].values, np.nan) for name in ("cdp", "measured_contrast"))
    targets = np.broadcast_to(matrix["contrast"].values, cdp.shape)
    yield LiveMatrix(tuple(str(name) for name in matrix["bright"].values), cdp, targets, measured)


class MatrixPlot:
    """Map of the matrix, in one tab."""

    def __init__(self) -> None:
        self._shown: LiveMatrix | None = None
        self._values = ColumnDataSource(data=dict.fromkeys(("bright", "dark", "cdp", "target", "measured"), ()))
        self._across, self._down = FactorRange(), FactorRange()
        self.figure = small_plot(300, name="matrix", x_range=self._across, y_range=self._down)
        colours = LinearColorMapper(palette=Viridis256, low=0, high=1, nan_color="#e8e8e8")
        fill = {"field": "cdp", "transform": colours}
        self.figure.rect("bright", "dark", 1, 1, source=self._values, line_color=None, fill_color=fill)
        self.figure.add_tools(HoverTool(tooltips=[
            ("bright / dark", "@bright / @dark"), ("CDP", "@cdp{0.000}"), ("target contrast", "@target{0.0} %"),
            ("measured contrast", "@measured{0.0} %"),
        ]))  # fmt: skip
        self.figure.xaxis.axis_label, self.figure.yaxis.axis_label = "bright region (colour: CDP)", "dark region"
        self.figure.xaxis.major_label_orientation = 1.57
        self.figure.axis.major_label_text_font_size = "8px"
        self.figure.grid.grid_line_color = None

    def update(self, matrix: LiveMatrix | None) -> None:
        """Show a matrix if it is another one than before."""
        if matrix is None or matrix is self._shown:
            return
        self._shown = matrix
        names = list(matrix.names)
        if names != list(self._across.factors):
            self._across.factors, self._down.factors = names, names[::-1]
            self.figure.height = _AXIS_PX + max(_ROW_PX * len(names), 150)
        bright, dark = np.triu_indices(len(names), 1)
        self._values.data = {
            "bright": [names[at] for at in bright.tolist()],
            "dark": [names[at] for at in dark.tolist()],
            "cdp": matrix.cdp[bright, dark],
            "target": 100 * matrix.target[bright, dark],
            "measured": 100 * matrix.measured[bright, dark],
        }
