"""The page and the spreadsheet of a calibration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from ....calibration import AnyCalibration, Calibration, PatchResidual
from ....core.result import Result
from ....core.table import Table
from ....output import Destination, write_files
from ....report.cells import cell_text
from ....report.digits import day, exposure, fixed, listed, printable, significant
from ....report.figure import ReportFigure
from ....report.html import render_page
from ....report.layout import SIMULATED, Block, Card, Facts, Page, Section
from ....report.sheets import result_workbook
from .budget import PATCH_PIXELS
from .figures import calibration_figures
from .quantities import range_text

#: Number of columns that fit next to a figure.
_BESIDE_FIGURE = ("patch", "meter_cd_m2", "expanded_meter_cd_m2", "camera_cd_m2", "deviation_rel", "z")
_VALID_FOR = (
    "A lens of another focal length, f-number or focus, a filter or a window before the lens needs a calibration of "
    "its own; a camera without a V(λ) filter needs one for each kind of light."
)


def write_calibration_report(
    calibration: AnyCalibration, result: Result, folder: Destination, figures: Sequence[ReportFigure] | None = None
) -> list[Path]:
    """Write page and spreadsheet of a calibration into a folder as `write_files` takes it.

    Everything is made before the first file is written; InputError is raised if one cannot be written. The figures are
    drawn unless they are given.

    Returns
    -------
    list of Path
        calibration.html and calibration.xlsx.
    """
    files = {
        "calibration.html": render_page(calibration_page(calibration, result, figures)).encode(),
        "calibration.xlsx": result_workbook(result, calibration.provenance.measured),
    }
    return write_files(folder, "calibrate", files)


def calibration_page(
    calibration: AnyCalibration, result: Result, figures: Sequence[ReportFigure] | None = None
) -> Page:
    """Return the page of a calibration: what it can measure and how well, then how it was found.

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        What to show.
    result : Result
        Its tables.
    figures : sequence of ReportFigure or None
        As `calibration_figures` draws them; None to draw them.
    """
    figures = figures or calibration_figures(calibration)
    return Page(
        "Calibration of a camera as a luminance meter",
        result.title,
        _summary(calibration),
        SIMULATED if result.simulated else "",
        tuple(_cards(calibration, result)),
        (figures[0], result.table("calibration_patches").only(*_BESIDE_FIGURE)),
        result.findings,
        tuple(_sections(calibration, result, figures[1:])),
    )


def _summary(calibration: AnyCalibration) -> str:
    gains = [calibration.state.gain_db]
    if isinstance(calibration, Calibration):
        gains += [gain.gain_db for gain in calibration.gains]
    lens, camera, exposures = calibration.lens, calibration.state.camera, calibration.exposures_s
    times = " to ".join(dict.fromkeys(exposure(t) for t in (exposures[0], exposures[-1])))
    return printable(
        f"{camera.model} with the lens {lens.model} at f/{lens.f_number:g}, at exposures of {times} and a gain of "
        f"{listed([f'{gain:g}' for gain in sorted(gains)])} dB, in {calibration.source_spectrum} light; measured on "
        f"{day(calibration.provenance.measured)}."
    )


def _cards(calibration: AnyCalibration, result: Result) -> Iterator[Card]:
    yield Card("Calibrated range", range_text(calibration))
    low, middle, high = (f"{significant(100 * float(u), 2)} %" for u in result.table("uncertainty")["expanded_rel"])
    yield Card(
        "Uncertainty of a luminance",
        f"± {middle}",
        f"U (95 %) of {PATCH_PIXELS} pixels at a middle luminance",
        (f"± {low} at the lowest, ± {high} at the highest", "meter scale included; it cancels in contrasts"),
    )
    yield _deviation(calibration)
    if isinstance(calibration, Calibration):
        table = result.table("calibration")
        row = next(row for row in table.rows() if row["quantity"] == "responsivity R")
        yield Card("Responsivity R", cell_text(table.column("value"), row), row["unit"])


def _deviation(calibration: AnyCalibration) -> Card:
    value, where = _worst(calibration.residuals)
    if calibration.held_out:
        of_held_out = f"held out: {' '.join(_worst(calibration.held_out))}"
    else:
        of_held_out = "no patch was held out to test the fit"
    return Card("Largest deviation from meter", value, f"{where} of the fit", (of_held_out,))


def _worst(rows: Sequence[PatchResidual]) -> tuple[str, str]:
    worst = max(rows, key=lambda row: abs(row.residual_rel))
    count = "1 patch" if len(rows) == 1 else f"{len(rows)} patches"
    return f"{fixed(100 * worst.residual_rel, 2, sign=True)} %", printable(f"at patch {worst.patch}, of {count}")


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
    return Facts.of(conditions), _VALID_FOR
