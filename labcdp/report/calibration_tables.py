"""The tables of a calibration's report as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .digits import Z_95, decimals, exposures, fixed, printable, with_half_width
from .facts import Fact
from .tables import Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..calibration import Calibration, PatchResidual
    from ..calibration.findings import FitTest, LeftOut

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
