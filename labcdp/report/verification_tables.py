"""The tables of a verification as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .digits import UNKNOWN, Z_95, decimals, exposure, exposures, fixed, printable, with_half_width
from .tables import Table

if TYPE_CHECKING:
    from ..calibration.verification import Verification


def verified_patches_table(result: Verification) -> Table:
    """Patches by the meter and by the calibrated camera, both anew; uncertainties as 95 % half widths."""
    rows = []
    for row in result.patches:
        half_width = Z_95 * row.reading_random_cd_m2
        difference = with_half_width(100 * row.difference_rel, 100 * row.half_width_95_rel)
        rows.append(
            (
                printable(row.patch),
                with_half_width(row.reading_cd_m2, half_width),
                fixed(row.luminance_cd_m2, decimals(half_width, 2)),
                difference,
                fixed(row.z, 1, sign=True),
                UNKNOWN if row.with_new_dark_rel is None else fixed(100 * row.with_new_dark_rel, 2, sign=True),
                exposures(row.exposures_s),
            )
        )
    return Table(
        (
            "patch",
            "meter (cd/m²)",
            "camera (cd/m²)",
            "difference (%)",
            "z",
            "with the new dark frames (%)",
            "exposures used",
        ),
        tuple(rows),
    )


def verified_planes_table(result: Verification) -> Table:
    """Show how the planes' responsivities have changed, by the grey patches; uncertainties as 95 % half widths."""
    rows = []
    for plane in result.planes:
        drift = plane.drift
        cells = (UNKNOWN, UNKNOWN)
        if drift is not None:
            r = drift.responsivity_dn_s_cd_m2
            cells = (
                with_half_width(100 * drift.relative, 100 * drift.half_width_95_rel),
                with_half_width(r, r * drift.responsivity_half_width_95_rel),
            )
        rows.append((f"{plane.plane}", *cells))
    return Table(("plane", "change (%)", "responsivity now (DN s⁻¹ / (cd m⁻²))"), tuple(rows))


def verified_darks_table(result: Verification) -> Table:
    """Show the darkness anew, against that of the calibration."""
    planes = len(result.planes) > 1
    return Table(
        (
            "exposure",
            *(["plane"] if planes else []),
            "now (DN)",
            "by the calibration (DN)",
            "difference (DN)",
            "z",
            "at the lowest luminance (%)",
        ),
        tuple(
            (
                exposure(row.exposure_s),
                *([f"{row.plane}"] if planes else []),
                fixed(row.mean_dn, 2),
                fixed(row.expected_dn, 2),
                with_half_width(row.difference_dn, Z_95 * row.standard_uncertainty_dn),
                fixed(row.z, 1, sign=True),
                fixed(100 * row.effect_rel, 2, sign=True),
            )
            for row in result.darks
        ),
    )
