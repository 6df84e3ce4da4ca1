"""The tables of a calibration's report as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..calibration.budget import budget, budget_exposure_s, combined
from .calibration_wording import PATCH_PIXELS, budget_luminances
from .digits import Z_95, decimals, exposure, exposures, fixed, printable, significant, with_half_width
from .facts import Fact
from .tables import Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..calibration import Calibration, PatchResidual
    from ..calibration.findings import BudgetRow, FitTest, LeftOut

#: Smallest uncertainty that is written as a number, in percent.
_LEAST_PERCENT = 0.001
#: Names of the responses, for a person.
RESPONSES: dict[str, str] = {
    "linear": "linear",
    "quadratic": "quadratic",
    "pchip": "monotone cubic (PCHIP)",
    "table": "table",
}


def patch_table(rows: Sequence[PatchResidual]) -> Table:
    """Patches by meter and camera, what is left over, and where they are in the image."""
    return Table(
        (
            "patch",
            "readings",
            "meter (cd/m²)",
            "camera (cd/m²)",
            "camera over meter, less one (%)",
            "over its standard deviation",
            "by a fit without it (%)",
            "x, y (pixels)",
            "exposures used",
        ),
        tuple(_patch_row(row) for row in rows),
    )


def _patch_row(row: PatchResidual) -> tuple[str, ...]:
    half_width = Z_95 * row.reading_random_cd_m2
    return (
        printable(row.patch),
        str(row.n_readings),
        with_half_width(row.reading_cd_m2, half_width),
        fixed(row.luminance_cd_m2, decimals(half_width, 2) if half_width > 0 else 4),
        fixed(100 * row.residual_rel, 2, sign=True),
        fixed(row.standardised_residual, 2, sign=True),
        "-" if row.leave_one_out_rel is None else fixed(100 * row.leave_one_out_rel, 2, sign=True),
        f"{row.centre_px[0]:.0f}, {row.centre_px[1]:.0f}",
        exposures(row.exposures_s),
    )


def ladder_table(calibration: Calibration) -> Table:
    """Models that were tried."""
    return Table(
        ("model", "parameters", "deviation of patches from a fit without them (%, rms)", "used"),
        tuple(
            (
                RESPONSES[step.kind],
                str(step.n_parameters),
                fixed(100 * step.leave_one_out_rel, 2),
                "yes" if step.chosen else "no",
            )
            for step in calibration.ladder
        ),
    )


def ladder_facts(calibration: Calibration) -> list[Fact]:
    """Tell why each model was chosen, or was not."""
    return [Fact(RESPONSES[step.kind], printable(step.reason)) for step in calibration.ladder]


def test_table(calibration: Calibration) -> Table:
    """Tests of what the model takes for granted, with 95 % half widths."""
    return Table(
        ("test", "deviation, with 95 % half width", "unit", "more than chance"),
        tuple(
            (
                printable(test.name),
                with_half_width(test.value, Z_95 * test.standard_uncertainty) if tested(test) else "-",
                printable(test.unit).replace("cd/m^2", "cd/m²") if test.unit != "1" else "",
                ("yes" if test.significant else "no") if tested(test) else "not tested",
            )
            for test in calibration.tests
        ),
    )


def tested(test: FitTest) -> bool:
    """Whether a test could be made: one that could not has neither a deviation nor an uncertainty."""
    return test.value != 0 or test.standard_uncertainty != 0


def test_facts(calibration: Calibration) -> list[Fact]:
    """Tell what each test says."""
    return [Fact(printable(test.name), printable(test.meaning)) for test in calibration.tests]


def budget_table(calibration: Calibration) -> Table:
    """Uncertainty budget of a patch at three luminances: relative standard uncertainties in percent."""
    luminances = budget_luminances(calibration)
    columns = [budget(calibration, value, n_pixels=PATCH_PIXELS) for value in luminances]
    whole = [combined(rows, len(calibration.residuals)) for rows in columns]
    rows = [
        (
            printable(same[0].source),
            *(_share(row) for row in same),
            same[0].distribution,
            same[0].evaluation,
            "yes" if same[0].common else "no",
            included(same[0]),
        )
        for same in zip(*columns, strict=True)
    ]
    rows.append(
        ("combined standard uncertainty", *(_percent(one.standard_uncertainty_rel) for one in whole), *[""] * 4)
    )
    freedoms = [one.effective_degrees_of_freedom for one in whole]
    rows.append(("effective degrees of freedom", *("∞" if f > 999 else f"{f:.0f}" for f in freedoms), *[""] * 4))
    rows.append(("95 % half width", *(f"± {_percent(one.expanded_95_rel)}" for one in whole), *[""] * 4))
    heads = (f"u at {significant(v, 2)} cd/m² (%)" for v in luminances)
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


def budget_facts(calibration: Calibration) -> list[Fact]:
    """Tell what each row of the budget rests on, at the lowest luminance."""
    low = budget_luminances(calibration)[0]
    rows = budget(calibration, low, n_pixels=PATCH_PIXELS)
    return [Fact(printable(row.source), printable(_basis(row))) for row in rows]


def _basis(row: BudgetRow) -> str:
    return f"not in the interval: {row.basis}" if included(row) == "no" else row.basis


def budget_conditions(calibration: Calibration) -> str:
    """Tell for what the budget is."""
    times = [exposure(budget_exposure_s(calibration, value)) for value in budget_luminances(calibration)]
    return (
        f"Relative standard uncertainties of the mean luminance of a patch of {PATCH_PIXELS} pixels in one frame near "
        f"the optical axis, at exposures of {', '.join(times)}, after JCGM 100:2008 (GUM). Type A: from statistics of "
        "this measurement; type B: from data sheets and the like. What all patches share (nearly) cancels in "
        "a contrast."
    )


def left_out_facts(left_out: Sequence[LeftOut]) -> list[Fact]:
    """Tell what a fit does not use, and why; exposures of a patch together."""
    groups: dict[tuple[str, int | None, str], list[float]] = {}
    for item in left_out:
        group = groups.setdefault((item.patch, item.reading, item.reason), [])
        group += [] if item.exposure_s is None else [item.exposure_s]
    facts = []
    for (patch, reading, reason), times in groups.items():
        what = f"patch {patch}" + (f", reading {reading}" if reading is not None else "")
        facts.append(Fact(printable(what + (f", {exposures(times)}" if times else "")), printable(reason)))
    return facts
