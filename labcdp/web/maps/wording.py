"""Statistics of regions as HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import nan

from ...core.roi import Roi
from ...metrics.regions.limits import limit_verdict
from ...regions import Shape
from ...report.digits import Z_95, share_percent, shortened, significant
from ..html import Cell, region_row, table, text
from ..regions.measurements import Evaluated, Means
from ..regions.page_image import PageImage

_HEADS = ("Region", "mean", "lowest", "highest", "SNR", "saturated", "limits")


def statistics_table(
    image: PageImage, shapes: Sequence[Shape], means: Mapping[Roi, Means], evaluated: Evaluated, selected: str | None
) -> str:
    """Write the luminance of each region: mean, range, SNR, saturated share, and whether it is within its limits."""
    rows = []
    for shape in shapes:
        for roi in shape.rois():
            head, found = text(shortened(roi.name, 20)), means.get(roi)
            cells: list[Cell] = [(found.error if found else "") or "…", *[""] * 5]
            if found is not None and found.light is not None:
                evaluation = evaluated.regions.get(roi)
                result = None if evaluation is None else evaluation.result
                expanded = nan if result is None else Z_95 * result.standard_uncertainty
                limits, light = shape.limits_cd_m2, found.light
                judged = limits is not None and image.unit == "cd/m^2"
                verdict = limit_verdict(light, expanded, limits) if limits is not None and judged else ""
                cells = [
                    significant(light),
                    significant(found.lowest or 0.0),
                    significant(found.highest or 0.0),
                    f"{light / found.light_std:.3g}" if found.light_std else "",
                    share_percent(found.saturated),
                    ("" if limits is None else f"{limits[0]:g} to {limits[1]:g} {verdict}", verdict),
                ]
            rows.append(region_row(roi.name, head, cells, shape.name == selected))
    if not rows:
        return "<p class='quiet'>Draw regions to see their luminance, and give them limits to pass or fail.</p>"
    unit = f"{image.unit_text}; a verdict needs all of ± U (95 %) on one side of the limits."
    return f"{table(_HEADS, rows, 'dense')}<p class='quiet'>{text(unit)}</p>"
