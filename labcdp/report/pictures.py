"""Figures that are images: the target with its regions, and the luminance map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..luminance import Invalid, LuminanceMap
from ..roi import Roi
from .digits import fixed, printable, shortened
from .drawing import (
    LABEL_SIZE,
    ORANGE,
    SMALL_SIZE,
    block_mean,
    label,
    missing_glyphs_allowed,
    new_figure,
    plain_numbers,
    png,
    reduction,
    taken_literally,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from ..evaluate import SessionEvaluation

#: Width of the pictures without what stands beside them.
_WIDTH_IN = 8.0

#: Names in the legend of the target are cut at this length; the tables have them whole.
_LONGEST_NAME = 28


def target_figure(evaluation: SessionEvaluation) -> bytes:
    """Draw the target in grey, logarithmic, with its regions and their names.

    Where a name is wider than its region, all regions get numbers, and the names stand beside the picture.
    """
    from matplotlib.colors import LogNorm

    seen = evaluation.map.luminance_cd_m2
    figure, axes = _image_axes(evaluation, f"Target: {printable(evaluation.observed.configuration.target.name)}")
    levels = [row.calibrated.luminance_cd_m2 for row in evaluation.patches]
    norm = LogNorm(0.4 * min(levels), 1.2 * max(levels), clip=True)
    mean = block_mean(seen, reduction(evaluation.observed_shape if False else _shape(seen)))
    axes.imshow(np.maximum(mean, norm.vmin), cmap="gray", norm=norm, extent=_extent(_shape(seen)))
    _draw_regions(figure, axes, [row.region for row in evaluation.patches])
    return png(figure)
