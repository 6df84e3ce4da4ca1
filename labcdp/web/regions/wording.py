"""Tables and sentences of the page, as HTML; all text of files and names is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from html import escape
from math import isfinite

from ...core.finding import Finding, unique
from ...core.roi import Roi
from ...report.digits import (
    Z_95,
    cdp_decimals,
    cdp_interval,
    fixed,
    printable,
    shortened,
    significant,
    with_half_width,
)
from ...report.findings import finding_text
from .drawing import Drawing
from .measurements import MOST_MEASURED, Evaluated, Evaluation, Means
from .page_image import PageImage

#: Colours of the two regions of the pair, of other regions and of proposals, distinguishable by colour-blind readers
#: (M. Okabe and K. Ito, Color Universal Design, 2008) and from a grey picture.
PAIR_COLOURS = ("#56B4E9", "#E69F00")
OTHER_COLOUR, PROPOSAL_COLOUR = "#2FC79B", "#F0E442"

_LONGEST_NAME = 28
_NOT_YET = Evaluation(None)


def colour(drawing: Drawing, name: str) -> str:
    """Colour of a region."""
    for chosen, its in zip(drawing.pair, PAIR_COLOURS, strict=True):
        if name == chosen:
            return its
    return OTHER_COLOUR


def region_table(
    image: PageImage, drawing: Drawing, means: Mapping[Roi, Means], evaluated: Evaluated, selected: str | None
) -> str:
    """Table of the regions, with DN and luminance."""
    if not drawing.shapes:
        return "<p class='quiet'>No region yet. Choose Polygon or Rectangle and draw on the picture.</p>"
    rows = []
    for shape in drawing.shapes:
        for roi in shape.rois():
            chosen = " class='chosen'" if shape.name == selected else ""
            rows.append(
                f"<tr{chosen} data-region='{_text(roi.name)}'><th scope='row'>"
                f"<span class='swatch' style='background:{colour(drawing, roi.name)}'></span>"
                f"<span title='{_text(roi.name)}'>{_text(shortened(roi.name, _LONGEST_NAME))}</span></th>"
                f"{_cells(means.get(roi), evaluated.regions.get(roi))}</tr>"
            )
    value = "DN" if image.is_dn else "value"
    heads = ("Region", "pixels", f"mean {value}", f"std {value}", f"mean {image.unit_text}")
    head = "".join(f"<th scope='col'>{_text(text)}</th>" for text in heads)
    note = ""
    if len(rows) > MOST_MEASURED:
        note = f"<p class='quiet'>Of more than {MOST_MEASURED} regions only A and B are measured.</p>"
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>{note}"


def pair_table(drawing: Drawing, evaluated: Evaluated) -> str:
    """Contrast and CDP of the two chosen regions."""
    chosen = drawing.pair_rois
    if len(chosen) < 2:
        return "<p class='quiet'>Choose two regions.</p>"
    found = evaluated.pair
    if found is None or (found.first, found.second) != chosen:
        return "<p class='quiet'>Measuring …</p>"
    pair = found.result
    if pair is None:
        return f"<p class='warning'>{_text(found.error)}</p>"
    measured, rows = pair.of_measured_contrast, []
    for one in pair.results:
        result = replace(one.result, confidence_interval=one.confidence_interval)
        asked = significant(100 * result.contrast) if measured else f"{100 * result.contrast:.6g}"
        rows.append(
            f"<tr><th scope='row'>{asked} %</th>"
            f"<td class='cdp'>{fixed(result.cdp, cdp_decimals(result))}</td><td>{cdp_interval(result)}</td></tr>"
        )
    ratio, csnr = pair.contrast, pair.csnr
    facts = [f"Measured contrast {percent_with_interval(ratio.value, ratio.standard_error)}"]
    if isfinite(csnr.value):
        facts.append(f"CSNR {_with_interval(csnr.value, csnr.standard_error)}")
    bright = _text(pair.bright_region.roi.name)
    head = "Contrast asked (measured)" if measured else "Contrast asked"
    if not rows:
        return f"<p>{'; '.join(facts)}. Give --contrast for a CDP.</p>"
    return (
        f"<table><thead><tr><th scope='col'>{head}</th><th scope='col'>CDP</th><th scope='col'>95 % interval</th></tr>"
        f"</thead><tbody>{''.join(rows)}</tbody></table><p>{'; '.join(facts)}. The brighter region is {bright}.</p>"
    )


def warning_list(image: PageImage, drawing: Drawing, means: Mapping[Roi, Means], evaluated: Evaluated) -> str:
    """Write the findings as a list; empty if there are none."""
    rois = drawing.rois
    findings: list[Finding] = []
    errors = []
    for roi in rois:
        evaluation = evaluated.regions.get(roi, _NOT_YET)
        findings += evaluation.findings
        error = evaluation.error or means.get(roi, Means()).error
        if error:
            errors.append(error if roi.name in error else f"{roi.name}: {error}")
    pair = evaluated.pair
    if pair is not None and pair.result is not None and pair.first in rois and pair.second in rois:
        # Those of a region are already shown above.
        known = {(one.code, one.subject) for one in findings}
        findings += [one for one in pair.result.findings if (one.code, one.subject) not in known]
    return _list([*errors, *map(finding_text, unique((*findings, *image.findings)))])


def _list(lines: Iterable[str]) -> str:
    items = "".join(f"<li>{_text(line[:1].upper() + line[1:])}</li>" for line in lines)
    return f"<ul>{items}</ul>" if items else ""


def _cells(means: Means | None, evaluation: Evaluation | None) -> str:
    if means is None:
        return "<td>…</td>" * 4
    value = "" if means.value is None else f"{means.value:.5g}"
    std = "" if means.value_std is None else f"{means.value_std:.3g}"
    light = "" if means.light is None else significant(means.light)
    if evaluation is None and light:
        light += " …"
    elif evaluation is not None and evaluation.result is not None:
        light = _with_interval(evaluation.result.mean, evaluation.result.standard_uncertainty)
    return "".join(f"<td>{text}</td>" for text in (means.n_pixels or "", value, std, light))


def _with_interval(value: float, standard_uncertainty: float) -> str:
    """Value with expanded uncertainty U (95 %), without it if unknown."""
    if not isfinite(standard_uncertainty):
        return significant(value)
    return with_half_width(value, Z_95 * standard_uncertainty)


def percent_with_interval(value: float, standard_error: float) -> str:
    """Percentage with U (95 %), without it if unknown."""
    if not isfinite(value):
        return "unbounded"
    return f"{_with_interval(100 * value, 100 * standard_error)} %"


def _text(text: str) -> str:
    return escape(printable(text), quote=True)
