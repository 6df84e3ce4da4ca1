"""The uncertainty budget of a calibration, as a table, facts and a sheet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import TYPE_CHECKING

from ..calibration import Calibration
from ..calibration.budget import CombinedUncertainty, budget, budget_exposure_s, combined
from ..calibration.colour_budget import colour_budget, colour_budget_exposure_s
from .digits import decimals, exposure, fixed, printable, significant
from .facts import Fact
from .tables import Table
from .workbook import Cell, Number, Sheet

if TYPE_CHECKING:
    from ..calibration import AnyCalibration
    from ..calibration.findings import BudgetRow

#: Pixels a patch is taken to have where the report states how well it is known.
PATCH_PIXELS = 1000
#: Smallest uncertainty that is written as a number, in percent.
_LEAST_PERCENT = 0.001


@dataclass(frozen=True)
class BudgetOfPatch:
    """Budget of the mean over a patch of `PATCH_PIXELS` pixels in one frame.

    Parameters
    ----------
    luminance_cd_m2, exposure_s : float
        Of the patch; it is grey where that makes a difference.
    rows : tuple of BudgetRow
        The sources.
    whole : CombinedUncertainty
        What they make together.
    """

    luminance_cd_m2: float
    exposure_s: float
    rows: tuple[BudgetRow, ...]
    whole: CombinedUncertainty


def budgets(calibration: AnyCalibration) -> list[BudgetOfPatch]:
    """Budgets at the lowest, a middle (geometric mean) and the highest calibrated luminance."""
    found = []
    low, high = calibration.range_cd_m2
    for luminance in (low, sqrt(low * high), high):
        if isinstance(calibration, Calibration):
            n, t = len(calibration.residuals), budget_exposure_s(calibration, luminance)
            rows = budget(calibration, luminance, n_pixels=PATCH_PIXELS)
        else:
            n, t = len(calibration.planes[0].residuals), colour_budget_exposure_s(calibration, luminance)
            rows = colour_budget(calibration, luminance, n_groups=PATCH_PIXELS // 4)
        found.append(BudgetOfPatch(luminance, t, rows, combined(rows, n)))
    return found


def budget_table(found: Sequence[BudgetOfPatch]) -> Table:
    """Uncertainty budget of a patch at three luminances: relative standard uncertainties in percent."""
    whole = [one.whole for one in found]
    rows = [
        (
            printable(same[0].source),
            *(_share(row) for row in same),
            same[0].distribution,
            same[0].evaluation,
            "yes" if same[0].common else "no",
            included(same[0]),
        )
        for same in zip(*(one.rows for one in found), strict=True)
    ]
    rows.append(
        ("combined standard uncertainty", *(_percent(one.standard_uncertainty_rel) for one in whole), *[""] * 4)
    )
    freedoms = [one.effective_degrees_of_freedom for one in whole]
    rows.append(("effective degrees of freedom", *("∞" if f > 999 else f"{f:.0f}" for f in freedoms), *[""] * 4))
    rows.append(("95 % half width", *(f"± {_percent(one.expanded_95_rel)}" for one in whole), *[""] * 4))
    heads = (f"u at {significant(one.luminance_cd_m2, 2)} cd/m² (%)" for one in found)
    return Table(("source", *heads, "distribution", "type", "shared by all patches", "included"), tuple(rows))


def _share(row: BudgetRow) -> str:
    percent = 100 * row.standard_uncertainty_rel
    if percent == 0:
        return "0" if row.included else "-"
    return _percent(row.standard_uncertainty_rel) if percent >= _LEAST_PERCENT else f"< {_LEAST_PERCENT:g}"


def _percent(fraction: float) -> str:
    return fixed(100 * fraction, 3)


def included(row: BudgetRow) -> str:
    """Tell whether a row is part of the stated intervals."""
    if row.included:
        return "yes"
    return "in another row" if row.basis.startswith("contained in") else "no"


def budget_facts(found: Sequence[BudgetOfPatch]) -> list[Fact]:
    """Tell what each row of the budget rests on, at the lowest luminance."""
    return [Fact(printable(row.source), printable(_basis(row))) for row in found[0].rows]


def _basis(row: BudgetRow) -> str:
    return f"not in the interval: {row.basis}" if included(row) == "no" else row.basis


def budget_conditions(found: Sequence[BudgetOfPatch], patch: str = "patch") -> str:
    """Tell for what the budget is; `patch` is what is measured."""
    times = ", ".join(exposure(one.exposure_s) for one in found)
    return (
        f"Relative standard uncertainties of the mean luminance of a {patch} of {PATCH_PIXELS} pixels in one frame "
        f"near the optical axis, at exposures of {times}, after JCGM 100:2008 (GUM). Type A: from statistics of "
        "this measurement; type B: from data sheets and the like. What all patches share (nearly) cancels in "
        "a contrast."
    )


def budget_sheet(found: Sequence[BudgetOfPatch]) -> Sheet:
    """All rows of the budgets, with what they make together."""
    header = (
        "luminance in cd/m²",
        "exposure in ms",
        "source",
        "relative standard uncertainty in %",
        "distribution",
        "type",
        "shared by all patches",
        "included",
        "basis",
    )
    cells: list[tuple[Cell, ...]] = []
    for one in found:
        luminance, milliseconds, whole = one.luminance_cd_m2, 1e3 * one.exposure_s, one.whole
        at = (Number(luminance, decimals(luminance, 3)), Number(milliseconds, decimals(milliseconds, 4)))
        for row in one.rows:
            cells.append(
                (
                    *at,
                    row.source,
                    Number(100 * row.standard_uncertainty_rel, 4),
                    row.distribution,
                    row.evaluation,
                    "yes" if row.common else "no",
                    included(row),
                    row.basis,
                )
            )
        freedom = whole.effective_degrees_of_freedom
        freedom_text = f"{freedom:.0f} effective degrees of freedom" if isfinite(freedom) else ""
        combination = Number(100 * whole.standard_uncertainty_rel, 4)
        cells.append((*at, "combined standard uncertainty", combination, *[None] * 4, freedom_text))
        cells.append((*at, "95 % half width", Number(100 * whole.expanded_95_rel, 4), *[None] * 5))
    return Sheet("Budget", header, cells)
