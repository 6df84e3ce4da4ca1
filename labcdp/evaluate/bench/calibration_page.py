"""The page, the figures and the spreadsheet of a calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import dist, hypot
from typing import TYPE_CHECKING, Any

import numpy as np

from ...calibration import AnyCalibration, Calibration, PatchResidual
from ...core.clock import exposure_text
from ...core.quantity import Z_95
from ...core.result import Result
from ...core.table import Table
from ...report.drawing import BLUE, ORANGE, finish, logarithmic, placed_figure, reported
from ...report.html import render_page
from ...report.layout import Block, Card, Page, ReportFigure, Section, page_text
from ...report.sheets import result_workbook
from ...report.text import day, fixed, listed, printable, shortened, significant, span, with_half_width
from .calibration_result import budget_at
from .quantities import range_text, responsivity

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Number of columns that fit next to a figure.
_BESIDE_FIGURE = (
    "patch",
    "meter_cd_m2",
    "expanded_meter_cd_m2",
    "camera_cd_m2",
    "expanded_camera_cd_m2",
    "deviation_rel",
    "z",
)
#: Marks of patches with their uncertainty.
_BARS: dict[str, Any] = {"fmt": "o", "markersize": 5, "capsize": 2.5, "elinewidth": 1.0}
#: Largest number of patches whose points are labelled.
_MOST_NAMES = 14


def calibration_figures(calibration: AnyCalibration, prefix: str = "") -> list[ReportFigure]:
    """Draw the fit (without colour filters), the response if it is not linear, and the residuals.

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        What to draw.
    prefix : str
        Start of the names of the files.
    """
    figures = [_residuals(calibration, prefix)]
    if isinstance(calibration, Calibration):
        if calibration.response.kind != "linear":
            figures.insert(0, _response(calibration, prefix))
        figures.insert(0, _fit(calibration, prefix))
    return figures


def _figure(calibration: AnyCalibration, width_in: float, height_in: float) -> Figure:
    return placed_figure(width_in, height_in, "bench" if calibration.state.camera.simulated else "")


def _fit(calibration: Calibration, prefix: str) -> ReportFigure:
    rows = sorted(calibration.residuals, key=lambda row: row.reading_cd_m2)
    figure = _figure(calibration, 6.4, 5.0)
    axes = figure.add_axes((0.13, 0.11, 0.84, 0.78))
    r = calibration.responsivity.responsivity_dn_s_cd_m2
    ends = np.array([rows[0].reading_cd_m2 / 1.5, rows[-1].reading_cd_m2 * 1.5])
    axes.plot(ends, r * ends, color=BLUE, linewidth=1.5, label="fitted line through zero")
    for patches, mark, colour, name in (
        (rows, "o", "black", "patches"),
        (calibration.held_out, "s", ORANGE, "held out"),
    ):
        if patches:
            readings = [row.reading_cd_m2 for row in patches]
            rates = [r * row.luminance_cd_m2 for row in patches]
            axes.plot(readings, rates, mark, markersize=5, color=colour, markerfacecolor="none", label=name)
    logarithmic(axes.xaxis, axes.yaxis)
    whole = responsivity(calibration)
    title = f"Responsivity {with_half_width(r, whole.expanded or 0.0)} {whole.unit}"
    signal = "signal" if calibration.response.kind == "linear" else "linearised signal"
    finish(axes, "luminance from the meter in cd/m²", f"{signal} of the camera in DN/s", title)
    return reported(
        f"{prefix}fit",
        figure,
        page_text("calibration-fit", signal=signal.capitalize()),
        page_text("calibration-fit-picture", n_patches=len(rows)),
    )


def _response(calibration: Calibration, prefix: str) -> ReportFigure:
    low, high = calibration.range_net_dn
    net = np.linspace(0, 1.1 * high, 400)[1:]
    bend = 100 * (calibration.response.linearise(net) / net - 1)
    figure = _figure(calibration, 7.0, 3.6)
    axes = figure.add_axes((0.11, 0.15, 0.86, 0.7))
    inside = (net >= low) & (net <= high)
    axes.plot(net, bend, color="0.7", linestyle="--", linewidth=1.2, label="outside the calibrated range")
    axes.plot(net[inside], bend[inside], color=BLUE, linewidth=1.8, label="calibrated")
    finish(axes, "signal above dark in DN", "correction in %", f"Response h: {calibration.response.kind}")
    return reported(
        f"{prefix}response",
        figure,
        page_text("calibration-response"),
        page_text("calibration-response-picture", percent=float(bend[-1])),
    )


def _residuals(calibration: AnyCalibration, prefix: str) -> ReportFigure:
    height, width = calibration.state.image_shape
    middle, half_diagonal = (width / 2, height / 2), hypot(height, width) / 2
    places: dict[str, tuple[Callable[[PatchResidual], float], float | None]] = {
        "luminance from the meter in cd/m²": (lambda row: row.reading_cd_m2, None),
        "x in pixels": (lambda row: row.centre_px[0], width),
        "y in pixels": (lambda row: row.centre_px[1], height),
        "distance from the image centre in pixels": (lambda row: dist(row.centre_px, middle), half_diagonal),
    }
    groups = ((calibration.residuals, "black", "white", "fit"), (calibration.held_out, ORANGE, ORANGE, "held out"))
    figure = _figure(calibration, 10.0, 6.4)
    margins = {"left": 0.07, "right": 0.985, "bottom": 0.08, "top": 0.95, "wspace": 0.08, "hspace": 0.26}
    panels = figure.subplots(2, 2, sharey=True, gridspec_kw=margins).ravel()
    for axes, (name, (coordinate, end)) in zip(panels, places.items(), strict=True):
        axes.axhline(0.0, color=BLUE, linewidth=1.2)
        for rows, colour, face, label in groups:
            if rows:
                points = [coordinate(row) for row in rows], [100 * row.residual_rel for row in rows]
                bars = [100 * Z_95 * (row.stated_rel or row.reading_random_cd_m2 / row.reading_cd_m2) for row in rows]
                named = label if axes is panels[0] and calibration.held_out else None
                axes.errorbar(*points, bars, markerfacecolor=face, color=colour, label=named, **_BARS)
        finish(axes, name, "residual in %" if axes in panels[::2] else "", "")
        if end is not None:
            axes.set_xlim(0, end)
    logarithmic(panels[0].xaxis)
    rows = (*calibration.residuals, *calibration.held_out)
    for row in rows if len(rows) <= _MOST_NAMES else ():
        point = (row.reading_cd_m2, 100 * row.residual_rel)
        offset = {"xytext": (4, 4), "textcoords": "offset points"}
        panels[0].annotate(shortened(row.patch, 14), point, fontsize=7, parse_math=False, **offset)
    n, worst = len(calibration.residuals), max(calibration.residuals, key=lambda row: abs(row.residual_rel))
    return reported(
        f"{prefix}residuals",
        figure,
        page_text("calibration-residuals"),
        page_text("calibration-residuals-picture", n_patches=n, percent=100 * worst.residual_rel, patch=worst.patch),
    )


def calibration_files(calibration: AnyCalibration, result: Result) -> dict[str, bytes]:
    """Return calibration.html and calibration.xlsx by their names."""
    return {
        "calibration.html": render_page(calibration_page(calibration, result)).encode(),
        "calibration.xlsx": result_workbook(result, calibration.provenance.measured),
    }


def calibration_page(calibration: AnyCalibration, result: Result) -> Page:
    """Return the page of a calibration: what it can measure and how well, then how it was found."""
    first, *others = calibration_figures(calibration)
    lead = first, result.table("calibration_patches").only(*_BESIDE_FIGURE)
    kind, sections = "Calibration of a camera as a luminance meter", _sections(calibration, result, others)
    return Page.of(result, kind, _summary(calibration), _cards(calibration), lead, sections)


def _summary(calibration: AnyCalibration) -> str:
    gains = [calibration.state.gain_db]
    if isinstance(calibration, Calibration):
        gains += [gain.gain_db for gain in calibration.gains]
    lens, camera, exposures = calibration.lens, calibration.state.camera, calibration.exposures_s
    times = span(exposure_text(exposures[0]), exposure_text(exposures[-1]))
    return printable(
        f"{camera.model} with the lens {lens.model} at f/{lens.f_number:g}, at exposures of {times} and a gain of "
        f"{listed([f'{gain:g}' for gain in sorted(gains)])} dB, in {calibration.source_spectrum} light; measured on "
        f"{day(calibration.provenance.measured)}."
    )


def _cards(calibration: AnyCalibration) -> Iterator[Card]:
    yield Card("Calibrated range", range_text(calibration))
    yield _uncertainty(calibration)
    yield _deviation(calibration)
    if isinstance(calibration, Calibration):
        r = responsivity(calibration)
        yield Card("Responsivity R", with_half_width(float(r.value or 0.0), r.expanded or 0.0), r.unit)


def _uncertainty(calibration: AnyCalibration) -> Card:
    """Say what U of the patches is, and what makes it."""
    rows = (*calibration.residuals, *calibration.held_out)
    ordered = sorted((row for row in rows if row.U_rel), key=lambda row: row.U_rel or 0.0)
    lines, ends = [], []
    for row in dict.fromkeys((*ordered[:1], *ordered[-1:])):
        parts = budget_at(calibration, row.luminance_cd_m2, row.centre_px).rows
        largest = max((part for part in parts if part.included), key=lambda part: part.u_rel)
        ends.append(significant(100 * (row.U_rel or 0.0), 2))
        k = fixed(row.k or 0.0, 2)
        lines.append(printable(f"± {ends[-1]} % at {row.patch}, k = {k}, most of it {largest.source}"))
    lines += ["without stray light of the scene", "meter scale included; it cancels in contrasts"]
    detail = "U (95 %) of the patches, at their places"
    return Card("Uncertainty of a luminance", f"± {span(*ends)} %", detail, tuple(lines))


def _deviation(calibration: AnyCalibration) -> Card:
    value, where = _worst(calibration.residuals)
    if calibration.held_out:
        of_held_out = f"held out: {' '.join(_worst(calibration.held_out))}"
    else:
        of_held_out = "no patch was held out to test the fit"
    return Card("Largest deviation from meter", value, f"{where} of the fit", (of_held_out,))


def _worst(rows: Sequence[PatchResidual]) -> tuple[str, str]:
    worst = max(rows, key=lambda row: abs(row.deviation_rel))
    count = "1 patch" if len(rows) == 1 else f"{len(rows)} patches"
    return f"{fixed(100 * worst.deviation_rel, 2, sign=True)} %", printable(f"at patch {worst.patch}, of {count}")


def _sections(calibration: AnyCalibration, result: Result, figures: Sequence[ReportFigure]) -> Iterator[Section]:
    tables = {table.name: table for table in result.tables}
    yield Section("Residuals", (*figures, tables["calibration_patches"]))
    yield Section("Uncertainty", (tables["uncertainty"], tables["budget"]))
    if not isinstance(calibration, Calibration):
        yield Section("Colour planes", (tables["planes"], tables["combinations"]))
        for plane in calibration.planes:
            name = f"{plane.state.plane}"
            yield Section(f"Plane {name}", tuple(calibration_figures(plane, f"{name}-")), collapsed=True)
    yield Section("Quantities", (tables["calibration"],))
    yield Section("Checks", (tables["checks"], tables["models"]), collapsed=True)
    if len(tables["left_out"]):
        yield Section("Left out of the fit", (tables["left_out"],), collapsed=True)
    yield Section("Conditions and provenance", condition_blocks(tables["conditions"]), collapsed=True)


def condition_blocks(conditions: Table) -> tuple[Block, ...]:
    """Return devices, settings and provenance of a calibration, and the limits of its validity."""
    return conditions, page_text("calibration-validity")
