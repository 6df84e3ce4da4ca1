"""The combination of colour planes to luminance, as tables and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..calibration import Calibration
from .digits import Z_95, decimals, fixed, printable, significant, with_half_width
from .facts import Fact, calibration_facts, lens_text, meter_text
from .tables import Table
from .workbook import Cell, Number

if TYPE_CHECKING:
    from ..calibration import AnyCalibration, ColourCalibration

_Sheet = tuple[Sequence[str], Sequence[Sequence[Cell]]]


def plane_table(colour: ColourCalibration) -> Table:
    """Planes with their weights, responsivities and residuals."""
    rows = []
    for plane, weight in zip(colour.planes, colour.weights, strict=True):
        r = plane.responsivity.responsivity_dn_s_cd_m2
        worst = max((abs(row.residual_rel) for row in plane.residuals), default=0.0)
        rows.append(
            (
                f"{plane.state.plane}",
                fixed(weight, 3, sign=True),
                with_half_width(r, Z_95 * r * plane.responsivity.random_rel),
                fixed(plane.dark.offset_dn, 2),
                significant(plane.noise.k_dn_per_e, 3),
                fixed(100 * worst, 2),
            )
        )
    return Table(
        (
            "plane",
            "weight",
            "responsivity, without the meter's scale (DN s⁻¹ / (cd m⁻²))",
            "dark offset (DN)",
            "K (DN/e⁻)",
            "largest residual (%)",
        ),
        tuple(rows),
    )


def combination_ladder(colour: ColourCalibration) -> Table:
    """Show how well the combination, and each colour alone, predicts patches it was not shown."""
    return Table(
        ("luminance from", "deviation of patches from a fit without them (%, rms)", "used"),
        tuple(
            (printable(step.name), fixed(100 * step.leave_one_out_rel, 2), "yes" if step.chosen else "no")
            for step in colour.ladder
        ),
    )


def combination_facts(colour: ColourCalibration) -> list[Fact]:
    """Tell how good the combination is, and why it was chosen."""
    low, high = colour.range_cd_m2
    f1 = colour.f1_prime
    facts = [
        Fact("Calibrated luminance", f"{significant(low, 3)} to {significant(high, 3)} cd/m²"),
        Fact(
            "Deviation by colour",
            f"{significant(100 * colour.spectral_rel, 2)} % (standard) of a patch whose colours differ as much as "
            "their mean; less of one that is nearly grey"
            if colour.spectral_rel > 0
            else "not significant",
        ),
        Fact("f1' of the combination", "not known" if f1 is None else f"{fixed(100 * f1, 1)} %"),
    ]
    return [*facts, *(Fact(printable(step.name), printable(step.reason)) for step in colour.ladder)]


def facts_of_any(calibration: AnyCalibration) -> list[Fact]:
    """Tell a calibration of any kind in short: that of a monochrome sensor, or the combination with its planes."""
    if isinstance(calibration, Calibration):
        return calibration_facts(calibration)
    planes = [
        Fact(
            f"Plane {plane.state.plane}",
            f"weight {fixed(weight, 3, sign=True)}, responsivity "
            f"{significant(plane.responsivity.responsivity_dn_s_cd_m2, 4)} DN s⁻¹ / (cd m⁻²)",
        )
        for plane, weight in zip(calibration.planes, calibration.weights, strict=True)
    ]
    return [
        *planes,
        *combination_facts(calibration),
        Fact("Lens", printable(lens_text(calibration.lens))),
        Fact("Luminance meter", printable(meter_text(calibration.meter_scale.meter))),
        Fact("Light", printable(calibration.source_spectrum)),
    ]


def plane_numbers(colour: ColourCalibration) -> _Sheet:
    """Header and rows of the sheet of the planes."""
    header = ("plane", "weight", "responsivity in DN s⁻¹ / (cd m⁻²)", "dark offset in DN", "K in DN/e⁻")
    rows: list[tuple[Cell, ...]] = []
    for plane, weight in zip(colour.planes, colour.weights, strict=True):
        r, k = plane.responsivity.responsivity_dn_s_cd_m2, plane.noise.k_dn_per_e
        rows.append(
            (
                plane.state.plane,
                Number(weight, 4),
                Number(r, decimals(Z_95 * r * plane.responsivity.random_rel, 2)),
                Number(plane.dark.offset_dn, 2),
                Number(k, decimals(k, 3)),
            )
        )
    return header, rows


def combination_numbers(colour: ColourCalibration) -> _Sheet:
    """Header and rows of the sheet of the patches by the combination."""
    header = ("patch", "meter in cd/m²", "combination in cd/m²", "combination over meter, less one, in %")
    rows = [
        (
            row.patch,
            Number(row.reading_cd_m2, decimals(Z_95 * row.reading_random_cd_m2, 2)),
            Number(row.luminance_cd_m2, decimals(Z_95 * row.reading_random_cd_m2, 2)),
            Number(100 * row.residual_rel, 2),
        )
        for row in (*colour.residuals, *colour.held_out)
    ]
    return header, rows
