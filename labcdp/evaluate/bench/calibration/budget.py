"""The uncertainty budget of a calibration at three luminances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import sqrt

from ....calibration import AnyCalibration, Calibration
from ....calibration.colour.budget import colour_budget, colour_budget_exposure_s
from ....calibration.errors.budget import CombinedUncertainty, budget, budget_exposure_s, combined
from ....calibration.findings import BudgetRow
from ....core.table import Column, Table
from ....report.digits import significant

#: Pixels a patch is taken to have where the uncertainty of a calibration is stated.
PATCH_PIXELS = 1000
_PLACES = ("lowest", "middle", "highest")


#: Degrees of freedom from which Student's t is that of the normal distribution, to 1e-4.
_UNLIMITED = 10_000
_DOF = "Degrees of freedom by Welch and Satterthwaite; empty if practically unlimited."


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
        All of them together.
    """

    luminance_cd_m2: float
    exposure_s: float
    rows: tuple[BudgetRow, ...]
    whole: CombinedUncertainty


def budgets(calibration: AnyCalibration) -> list[BudgetOfPatch]:
    """Compute the budgets at the lowest, a middle (geometric mean) and the highest calibrated luminance."""
    low, high = calibration.range_cd_m2
    return [budget_at(calibration, luminance) for luminance in (low, sqrt(low * high), high)]


def budget_at(calibration: AnyCalibration, luminance_cd_m2: float) -> BudgetOfPatch:
    """Compute the budget at a luminance."""
    if isinstance(calibration, Calibration):
        t = budget_exposure_s(calibration, luminance_cd_m2)
        rows = budget(calibration, luminance_cd_m2, n_pixels=PATCH_PIXELS)
    else:
        t = colour_budget_exposure_s(calibration, luminance_cd_m2)
        rows = colour_budget(calibration, luminance_cd_m2, n_groups=PATCH_PIXELS // 4)
    return BudgetOfPatch(luminance_cd_m2, t, rows, combined(rows))


def budget_tables(found: Sequence[BudgetOfPatch]) -> tuple[Table, Table]:
    """Return what the budgets make together, and their sources."""
    columns = (
        Column("luminance_cd_m2", "luminance", "cd/m²", "Lowest, a middle and highest calibrated luminance."),
        Column("exposure_s", "exposure", "s", "Exposure time of the frame.", digits=0, time=True),
        Column("u_rel", "u", "%", "Relative combined standard uncertainty.", 2, value="whole.standard_uncertainty_rel"),
        Column("effective_dof", "effective dof", "", _DOF, decimals=0, value=_dof),
        Column("expanded_rel", "U (95 %)", "%", "Relative expanded uncertainty.", 2, value="whole.expanded_95_rel"),
    )
    note = (
        f"Of the mean luminance of a patch of {PATCH_PIXELS} pixels in one frame near the optical axis, without glare, "
        "after JCGM 100:2008 (GUM)."
    )
    return Table.of_items("uncertainty", "Uncertainty of a patch", columns, found, note), _sources(found)


def _dof(one: BudgetOfPatch) -> float | None:
    dof = one.whole.effective_degrees_of_freedom
    return dof if dof < _UNLIMITED else None


def _sources(found: Sequence[BudgetOfPatch]) -> Table:
    """One row for each source; all of it but the uncertainty is that at the lowest luminance."""
    columns = (
        Column("source", "source", "", "Source of the uncertainty.", value=lambda rows: rows[0].source),
        *(
            Column(f"u_{place}_rel", f"u at {significant(one.luminance_cd_m2, 4)} cd/m²", "%",
                   f"Relative standard uncertainty at the {place} luminance.", decimals=3,
                   value=partial(_u_rel, number))
            for number, (place, one) in enumerate(zip(_PLACES, found, strict=True))
        ),
        Column("distribution", "distribution", "", "Distribution of the error.",
               value=lambda rows: rows[0].distribution),
        Column("evaluation", "type", "", "A: from statistics of this measurement; B: from data sheets and the like.",
               value=lambda rows: rows[0].evaluation),
        Column("common", "common", "", "Whether the error is common to all patches, so that it cancels in a contrast.",
               value=lambda rows: rows[0].common),
        Column("included", "included", "", "Whether the stated uncertainty includes it.",
               value=lambda rows: included(rows[0])),
        Column("basis", "basis", "", "Basis of the value.", value=lambda rows: rows[0].basis),
    )  # fmt: skip
    rows = zip(*(one.rows for one in found), strict=True)
    return Table.of_items("budget", "Uncertainty budget", columns, rows, detail=True)


def _u_rel(number: int, rows: Sequence[BudgetRow]) -> float | None:
    known = rows[0].included or rows[0].standard_uncertainty_rel != 0
    return rows[number].standard_uncertainty_rel if known else None


def included(row: BudgetRow) -> str:
    """Return whether a row is part of the stated intervals."""
    if row.included:
        return "yes"
    return f"in {row.contained_in}" if row.contained_in else "no"
