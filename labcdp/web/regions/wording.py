"""Tables and sentences of regions, as HTML; all text of files and names is escaped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite, nan

from ...core.result import Finding, unique
from ...metrics.pair import Pair
from ...metrics.region import SATURATED_SHARE
from ...metrics.uncertainty import limit_verdict
from ...regions import Shape
from ...report.text import (
    Z_95,
    bounded,
    capitalised,
    cdp_decimals,
    cdp_interval,
    finding_sentence,
    fixed,
    measured_contrast_text,
    measured_text,
    share_percent,
    shortened,
    significant,
)
from ..html import Cell, items, table, table_row, text
from .drawing import Drawing
from .measurements import MOST_MEASURED, Measured, RegionNumbers, is_saturated
from .page_image import PageImage

#: Colours of the two regions of the pair, of other regions and of proposals, distinguishable by colour-blind readers
#: (M. Okabe and K. Ito, Color Universal Design, 2008) and from a grey picture.
PAIR_COLOURS = ("#56B4E9", "#E69F00")
OTHER_COLOUR, PROPOSAL_COLOUR = "#2FC79B", "#F0E442"

_LONGEST_NAME = 28


def colour(drawing: Drawing, name: str) -> str:
    """Colour of a region."""
    for chosen, its in zip(drawing.pair, PAIR_COLOURS, strict=True):
        if name == chosen:
            return its
    return OTHER_COLOUR


def region_table(image: PageImage, drawing: Drawing, measured: Measured, selected: str | None) -> str:
    """Table of the regions, with DN and luminance."""
    if not drawing.shapes:
        return "<p class='quiet'>No regions yet. Choose Polygon or Rectangle and draw on the picture.</p>"
    rows = _region_rows(drawing, measured, selected, lambda _shape, numbers: _cells(numbers))
    value = "DN" if image.is_dn else "value"
    heads = ("Region", "pixels", f"mean {value}", f"std {value}", f"mean {image.unit_text}")
    note = ""
    if len(rows) > MOST_MEASURED:
        note = f"<p class='quiet'>Of more than {MOST_MEASURED} regions only A and B are measured.</p>"
    return table(heads, rows) + note


def pair_table(drawing: Drawing, measured: Measured) -> str:
    """Contrast and CDP of the two chosen regions."""
    chosen = drawing.pair_rois
    if len(chosen) < 2:
        return "<p class='quiet'>Choose two regions.</p>"
    evaluation = measured.pair
    if evaluation is None or (evaluation.first, evaluation.second) != chosen:
        return "<p class='quiet'>Measuring …</p>"
    pair = evaluation.result
    if pair is None:
        return f"<p class='warning'>{text(evaluation.error)}</p>"
    if is_saturated(pair.a, pair.b):
        return f"<p class='warning'>Measured contrast {contrast_text(pair)}: a region is saturated.</p>"
    measured_target, rows = pair.targets_measured_contrast, []
    for cdp in pair.cdp:
        target = significant(100 * cdp.contrast) if measured_target else f"{100 * cdp.contrast:.6g}"
        rows.append(table_row(f"{target} %", ((fixed(cdp.cdp, cdp_decimals(cdp)), "cdp"), cdp_interval(cdp))))
    csnr = pair.csnr
    facts = [f"Measured contrast {contrast_text(pair)}"]
    if isfinite(csnr.value):
        facts.append(f"CSNR {measured_text(csnr.value, csnr.u)}")
    bright = text(pair.bright_region.roi.name)
    head = "Target contrast (measured)" if measured_target else "Target contrast"
    if not rows:
        return f"<p>{'; '.join(facts)}. Without a target contrast there is no CDP.</p>"
    return f"{table((head, 'CDP', '95 % interval'), rows)}<p>{'; '.join(facts)}. The brighter region is {bright}.</p>"


def warning_list(image: PageImage, drawing: Drawing, measured: Measured) -> str:
    """Write the findings as a list; empty if there are none."""
    rois = drawing.rois
    findings: list[Finding] = []
    errors = []
    for roi in rois:
        numbers = measured.regions.get(roi, RegionNumbers())
        findings += numbers.findings
        if error := numbers.error:
            errors.append(capitalised(error))
    pair = measured.pair
    if pair is not None and pair.result is not None and pair.first in rois and pair.second in rois:
        # Those of a region are already shown above.
        known = {(finding.code, finding.subject) for finding in findings}
        findings += [finding for finding in pair.result.findings if (finding.code, finding.subject) not in known]
    return items([*errors, *map(finding_sentence, unique((*findings, *image.findings)))])


def _cells(numbers: RegionNumbers | None) -> tuple[str, ...]:
    if numbers is None:
        return ("…",) * 4
    value = "" if numbers.value is None else f"{numbers.value:.5g}"
    std = "" if numbers.value_std is None else f"{numbers.value_std:.3g}"
    light = "" if numbers.light is None else significant(numbers.light)
    if numbers.result is not None:
        light = measured_text(numbers.result.mean, numbers.result.u, numbers.result.bound)
    elif numbers.light is not None and numbers.saturated > SATURATED_SHARE:
        light = bounded(numbers.light, ">")
    elif light and not numbers.evaluated:
        light += " …"
    return str(numbers.n_pixels or ""), value, std, light


def contrast_text(pair: Pair) -> str:
    """Contrast with U (95 %); without it, and only as a bound, if a region is saturated."""
    return measured_contrast_text(pair.contrast, pair.bound)


_HEADS = ("Region", "mean", "lowest", "highest", "SNR", "saturated", "limits")


def statistics_table(image: PageImage, drawing: Drawing, measured: Measured, selected: str | None) -> str:
    """Write the luminance of each region: mean, range, SNR, saturated share, and whether it is within its limits."""
    if not drawing.shapes:
        return "<p class='quiet'>Draw regions to see their luminance; set limits to get pass or fail.</p>"
    rows = _region_rows(drawing, measured, selected, partial(_statistics, image.unit == "cd/m^2"))
    unit = f"{image.unit_text}; pass or fail only if the whole ± U (95 %) interval is inside or outside the limits."
    return f"{table(_HEADS, rows, 'dense')}<p class='quiet'>{text(unit)}</p>"


def _statistics(calibrated: bool, shape: Shape, numbers: RegionNumbers | None) -> Sequence[Cell]:
    """Cells of a region: luminance, and whether it is within the limits of its shape."""
    if numbers is None or numbers.light is None:
        return [(numbers.error if numbers else "") or "…", *[""] * 5]
    expanded = nan if numbers.result is None else Z_95 * numbers.result.u
    limits, light = shape.limits_cd_m2, numbers.light
    saturated = numbers.saturated > SATURATED_SHARE
    verdict = limit_verdict(light, expanded, limits) if limits is not None and calibrated else ""
    if saturated and limits is not None and verdict:
        # The luminance is at least that.
        verdict = "fail" if light > limits[1] else "undecided"
    return [
        bounded(light, ">") if saturated else significant(light),
        significant(numbers.lowest or 0.0),
        bounded(numbers.highest or 0.0, ">") if numbers.saturated else significant(numbers.highest or 0.0),
        f"{light / numbers.light_std:.3g}" if numbers.light_std and not saturated else "",
        share_percent(numbers.saturated),
        ("" if limits is None else f"{limits[0]:g} to {limits[1]:g} {verdict}", verdict),
    ]


def _region_rows(
    drawing: Drawing,
    measured: Measured,
    selected: str | None,
    cells: Callable[[Shape, RegionNumbers | None], Sequence[Cell]],
) -> list[str]:
    """Rows that select a region when they are clicked, with its colour in the picture."""
    rows = []
    for shape in drawing.shapes:
        for roi in shape.rois():
            head = (
                f"<span class='swatch' style='background:{colour(drawing, roi.name)}'></span>"
                f"<span title='{text(roi.name)}'>{text(shortened(roi.name, _LONGEST_NAME))}</span>"
            )
            selects = f"{' class=chosen' if shape.name == selected else ''} data-region='{text(roi.name)}'"
            rows.append(table_row(head, cells(shape, measured.regions.get(roi)), selects))
    return rows
