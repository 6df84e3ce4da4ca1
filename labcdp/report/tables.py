"""The tables of an evaluation as text: for the page and for the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from .digits import (
    Z_95,
    cdp_decimals,
    cdp_interval,
    decimals,
    exposure,
    exposures,
    fixed,
    printable,
    with_half_width,
)

if TYPE_CHECKING:
    from ..calibration import AnyCalibration
    from ..evaluate import ContrastRow, PatchRow, SessionEvaluation


class Table(NamedTuple):
    """Formatted text in rows and columns; all columns but the first hold numbers and are set flush right.

    Parameters
    ----------
    columns : tuple of str
        Heads, with units.
    rows : tuple of tuple of str
        A cell for each column; numbers carry the digits they are worth.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def summary_table(evaluation: SessionEvaluation) -> Table:
    """Patches by the meter, by guessed parameters and by the calibrated camera (the 2018 thesis' table 3.1).

    Parameters
    ----------
    evaluation : SessionEvaluation
        Its patches are the rows.

    Returns
    -------
    Table
        The deviation is calibrated over measured, less one. The uncertainty is the half width of the calibrated
        value's 95 % interval, the meter's scale included; two digits of it are shown, and the values to match.
    """
    return Table(
        columns=(
            "patch",
            "measured (cd/m²)",
            "calculated, guessed (cd/m²)",
            "calibrated (cd/m²)",
            "deviation (%)",
            "95 % uncertainty (%)",
        ),
        rows=tuple(_summary_row(row) for row in evaluation.patches),
    )


def _summary_row(row: PatchRow) -> tuple[str, ...]:
    calculated = row.calculated_cd_m2
    half_width_percent = 100 * row.calibrated.half_width_95_rel
    return (
        printable(row.region.name),
        fixed(row.measured_cd_m2, measured_decimals(row)),
        "-" if calculated is None else fixed(calculated, calibrated_decimals(row)),
        fixed(row.calibrated.luminance_cd_m2, calibrated_decimals(row)),
        fixed(100 * row.deviation_rel, 2, sign=True),
        fixed(half_width_percent, decimals(half_width_percent, 2)),
    )


def measured_decimals(row: PatchRow) -> int:
    """Count the decimals of the meter's value that its 95 % interval supports."""
    return decimals(row.measured_half_width_95_rel * row.measured_cd_m2, 2)


def calibrated_decimals(row: PatchRow) -> int:
    """Count the decimals of the camera's value that its 95 % interval supports."""
    return decimals(row.calibrated.half_width_95_rel * row.calibrated.luminance_cd_m2, 2)


def contrast_table(evaluation: SessionEvaluation) -> Table:
    """Contrasts between patches and their detection probability.

    Parameters
    ----------
    evaluation : SessionEvaluation
        Its contrasts are the rows.

    Returns
    -------
    Table
        Contrasts in percent with half widths of 95 %; CDP, and the shares below and above, as fractions.
    """
    return Table(
        columns=(
            "bright / dark patch",
            "contrast asked (%)",
            "counts as detected (%)",
            "by meter (%)",
            "by camera (%)",
            "CDP (95 % interval)",
            "below",
            "above",
            "exposure",
        ),
        rows=tuple(_contrast_row(row) for row in evaluation.contrasts),
    )


def _contrast_row(row: ContrastRow) -> tuple[str, ...]:
    low, high = row.cdp.interval
    n = cdp_decimals(row.cdp)
    return (
        pair_name(row),
        f"{100 * row.cdp.contrast:.6g}",
        f"{100 * low:.6g} to {100 * high:.6g}",
        contrast_with_half_width(row.measured_contrast, row.measured_standard_uncertainty),
        contrast_with_half_width(row.camera_contrast, row.camera_standard_uncertainty),
        f"{fixed(row.cdp.cdp, n)} ({cdp_interval(row.cdp)})",
        fixed(row.cdp.below, n),
        fixed(row.cdp.above, n),
        exposure(row.exposure_s),
    )


def pair_name(row: ContrastRow) -> str:
    """Return "bright / dark"."""
    return printable(f"{row.bright} / {row.dark}")


def contrast_with_half_width(contrast: float, standard_uncertainty: float) -> str:
    """Write a contrast in percent, without the sign, and the half width of its 95 % interval."""
    return with_half_width(100 * contrast, 100 * Z_95 * standard_uncertainty)


def residual_table(calibration: AnyCalibration) -> Table:
    """Patches of the calibration: what the fitted line leaves over."""
    return Table(
        columns=(
            "patch",
            "readings",
            "meter (cd/m²)",
            "camera (cd/m²)",
            "residual (%)",
            "residual / its standard deviation",
            "exposures used",
        ),
        rows=tuple(
            (
                printable(row.patch),
                str(row.n_readings),
                with_half_width(row.reading_cd_m2, Z_95 * row.reading_random_cd_m2),
                fixed(row.luminance_cd_m2, decimals(Z_95 * row.reading_random_cd_m2, 2)),
                fixed(100 * row.residual_rel, 2, sign=True),
                fixed(row.standardised_residual, 2, sign=True),
                exposures(row.exposures_s),
            )
            for row in calibration.residuals
        ),
    )
