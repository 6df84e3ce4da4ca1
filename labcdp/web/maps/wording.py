"""Statistics of regions as HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from math import nan

from ...core.roi import Roi
from ...metrics.regions.limits import limit_verdict
from ...regions import Shape
from ...report.digits import Z_95, printable, share_percent, shortened, significant
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
            found = means.get(roi)
            if found is None or found.light is None:
                cells = [(found.error if found else "") or "…", *[""] * 5]
                verdict = ""
            else:
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
                    "" if limits is None else f"{limits[0]:g} to {limits[1]:g} {verdict}",
                ]
            chosen = " class='chosen'" if shape.name == selected else ""
            name = shortened(roi.name, 20)
            rows.append(
                f"<tr{chosen} data-region='{_text(roi.name)}'><th scope='row'>{_text(name)}</th>"
                + "".join(f"<td>{_text(cell)}</td>" for cell in cells[:-1])
                + f"<td class='{verdict}'>{_text(cells[-1])}</td>"
                + "</tr>"
            )
    if not rows:
        return "<p class='quiet'>Draw regions to see their luminance, and give them limits to pass or fail.</p>"
    head = "".join(f"<th scope='col'>{_text(text)}</th>" for text in _HEADS)
    unit = (
        f"<p class='quiet'>{_text(image.unit_text)}; a verdict needs all of ± U (95 %) on one side of the limits.</p>"
    )
    return f"<table class='dense'><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>{unit}"


def _text(text: str) -> str:
    return escape(printable(text), quote=True)
