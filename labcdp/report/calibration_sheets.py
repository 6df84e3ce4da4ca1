"""The report of a calibration as sheets of a workbook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..calibration import expanded_half_width
from .calibration_budget import budget_sheet, budgets
from .calibration_combination import combination_numbers, plane_numbers
from .calibration_tables import RESPONSES, left_out_facts, tested
from .calibration_wording import cautions, purpose, quality, simulated
from .digits import Z_95, decimals, exposures
from .facts import calibration_facts
from .wording import minute
from .workbook import Cell, Number, Sheet

if TYPE_CHECKING:
    from ..calibration import Calibration, PatchResidual
    from ..calibration.colour import ColourCalibration


def calibration_sheets(calibration: Calibration) -> list[Sheet]:
    """Make the sheets of the calibration of a monochrome sensor, or of one plane."""
    return [
        _summary(calibration),
        _patches([("fit", row) for row in calibration.residuals] + [("held out", row) for row in calibration.held_out]),
        _models(calibration),
        _tests(calibration),
        budget_sheet(budgets(calibration)),
        Sheet("Left out", ("What", "Why"), [tuple(fact) for fact in left_out_facts(calibration.left_out)]),
        Sheet("Facts", ("What", "Value"), [tuple(fact) for fact in calibration_facts(calibration)]),
        _provenance(calibration),
    ]


def combination_sheets(colour: ColourCalibration) -> list[Sheet]:
    """Make the sheets of the calibration of a sensor with colour filters."""
    planes = [
        Sheet(f"{plane.state.plane} {sheet.title}", sheet.header, sheet.rows)
        for plane in colour.planes
        for sheet in calibration_sheets(plane)
        if sheet.title in ("Summary", "Patches", "Budget")
    ]
    return [
        Sheet("Planes", *plane_numbers(colour)),
        Sheet("Combination", *combination_numbers(colour)),
        budget_sheet(budgets(colour)),
        *planes,
        _provenance(colour.planes[0]),
    ]


def _summary(calibration: Calibration) -> Sheet:
    fit = calibration.responsivity
    r, (low, high) = fit.responsivity_dn_s_cd_m2, calibration.range_cd_m2
    half_width = expanded_half_width(calibration.meter_scale.half_width_rel, fit.random_rel)
    k = calibration.noise.k_dn_per_e
    rows: list[tuple[Cell, ...]] = [
        ("Simulated", simulated(calibration) or "nothing", None),
        ("Use", purpose(calibration), None),
        ("Quality", quality(calibration), None),
        *(("Mind", text, None) for text in cautions(calibration)),
        ("Responsivity", Number(r, decimals(r * half_width, 2)), "DN s⁻¹ / (cd m⁻²)"),
        ("95 % uncertainty of the responsivity", _percent(half_width), "%"),
        ("of which not the meter's scale", _percent(expanded_half_width(0.0, fit.random_rel)), "%"),
        ("Dark offset", Number(calibration.dark.offset_dn, 2), "DN"),
        ("Dark rate", Number(calibration.dark.rate_dn_s, 2), "DN/s"),
        ("Dark noise", Number(calibration.noise.dark_noise_dn, 3), "DN"),
        ("Overall system gain K", Number(k, decimals(k, 3)) if k > 0 else None, "DN/e⁻"),
        ("χ² of the fit", Number(fit.chi_squared, 2), None),
        ("Degrees of freedom", Number(fit.degrees_of_freedom, 0), None),
        ("Lowest calibrated luminance", Number(low, decimals(low, 3)), "cd/m²"),
        ("Highest calibrated luminance", Number(high, decimals(high, 3)), "cd/m²"),
        *(("Warning", warning, None) for warning in calibration.warnings),
    ]
    return Sheet("Summary", ("Quantity", "Value", "Unit"), rows)


def _percent(fraction: float) -> Number:
    return Number(100 * fraction, decimals(100 * fraction, 2) if fraction else 2)


def _patches(rows: Sequence[tuple[str, PatchResidual]]) -> Sheet:
    header = (
        "patch",
        "used for",
        "readings",
        "meter in cd/m²",
        "95 % half width by meter, without its scale, in cd/m²",
        "camera in cd/m²",
        "camera over meter, less one, in %",
        "over its standard deviation",
        "by a fit without the patch, in %",
        "x in pixels",
        "y in pixels",
        "exposures used",
    )
    cells: list[tuple[Cell, ...]] = []
    for use, row in rows:
        half_width = Z_95 * row.reading_random_cd_m2
        n = decimals(half_width, 2)
        without = row.leave_one_out_rel
        cells.append(
            (
                row.patch,
                use,
                Number(row.n_readings, 0),
                Number(row.reading_cd_m2, n),
                Number(half_width, n),
                Number(row.luminance_cd_m2, n),
                Number(100 * row.residual_rel, 2),
                Number(row.standardised_residual, 2),
                None if without is None else Number(100 * without, 2),
                Number(row.centre_px[0], 1),
                Number(row.centre_px[1], 1),
                exposures(row.exposures_s),
            )
        )
    return Sheet("Patches", header, cells)


def _models(calibration: Calibration) -> Sheet:
    header = ("model", "parameters", "rms deviation of patches from a fit without them, in %", "used", "reason")
    rows = [
        (
            RESPONSES[step.kind],
            Number(step.n_parameters, 0),
            Number(100 * step.leave_one_out_rel, 3),
            "yes" if step.chosen else "no",
            step.reason,
        )
        for step in calibration.ladder
    ]
    return Sheet("Models", header, rows)


def _tests(calibration: Calibration) -> Sheet:
    header = ("test", "deviation", "95 % half width", "unit", "more than chance", "meaning")
    rows = []
    for test in calibration.tests:
        half_width = Z_95 * test.standard_uncertainty
        n = decimals(half_width, 2) if half_width > 0 else decimals(test.value, 4)
        numbers = (Number(test.value, n), Number(half_width, n)) if tested(test) else (None, None)
        verdict = ("yes" if test.significant else "no") if tested(test) else "not tested"
        rows.append((test.name, *numbers, test.unit if test.unit != "1" else "", verdict, test.meaning))
    return Sheet("Tests", header, rows)


def _provenance(calibration: Calibration) -> Sheet:
    provenance = calibration.provenance
    rows = [
        ("Camera", str(calibration.state.camera)),
        ("Last reading", minute(provenance.measured)),
        ("SHA-256 of frames and readings", provenance.input_sha256),
        *((f"Version of {name}", text) for name, text in provenance.versions.items()),
    ]
    return Sheet("Provenance", ("What", "Value"), rows)
