"""The report as a spreadsheet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..calibration import Calibration, expanded_half_width
from . import wording
from .calibration_combination import facts_of_any
from .digits import Z_95, cdp_decimals, decimals, exposures, percent
from .facts import provenance_facts
from .tables import calibrated_decimals, measured_decimals, pair_name
from .workbook import Cell, Number, Sheet, workbook

if TYPE_CHECKING:
    from ..calibration import AnyCalibration
    from ..contrast import ContrastDistribution
    from ..evaluate import ContrastRow, PatchRow, SessionEvaluation


def spreadsheet(evaluation: SessionEvaluation) -> bytes:
    """Write the report as an Office Open XML workbook; equal evaluations give equal bytes.

    Parameters
    ----------
    evaluation : SessionEvaluation
        What to report.

    Returns
    -------
    bytes
        Content of an .xlsx file.
    """
    sheets = [
        _summary(evaluation),
        _patches(evaluation.patches),
        _contrasts(evaluation.contrasts),
        _residuals(evaluation.calibration),
        _distribution(evaluation.contrasts),
        _provenance(evaluation),
    ]
    return workbook(sheets, evaluation.observed.configuration.name, wording.recorded(evaluation)[1])


def _summary(evaluation: SessionEvaluation) -> Sheet:
    low, high = evaluation.calibration.range_cd_m2
    rows: list[tuple[Cell, ...]] = [
        ("Session", evaluation.observed.configuration.name, None),
        ("Simulated", wording.simulated(evaluation) or "nothing", None),
        ("Measured", wording.measured(evaluation), None),
        *(("Result", sentence, None) for sentence in wording.results(evaluation)),
        ("Check", wording.check(evaluation), None),
        ("Patches", Number(len(evaluation.patches), 0), None),
        ("Largest deviation of camera from meter", _percent(_largest_deviation_rel(evaluation), 2), "%"),
        *_fit(evaluation.calibration),
        ("Lowest calibrated luminance", Number(low, decimals(low, 3)), "cd/m²"),
        ("Highest calibrated luminance", Number(high, decimals(high, 3)), "cd/m²"),
        *(
            (f"CDP of {percent(row.cdp.contrast)}, {pair_name(row)}", Number(row.cdp.cdp, cdp_decimals(row.cdp)), None)
            for row in evaluation.contrasts
        ),
        *(("Warning", warning, None) for warning in wording.warnings(evaluation)),
    ]
    return Sheet("Summary", ("Quantity", "Value", "Unit"), rows)


def _fit(calibration: AnyCalibration) -> list[tuple[Cell, ...]]:
    if not isinstance(calibration, Calibration):
        unit = "(cd/m²) / (DN/s)"
        return [
            (f"Weight of plane {plane}", Number(w, decimals(w, 4)), unit)
            for plane, w in calibration.rate_weights.items()
        ]
    fit = calibration.responsivity
    scale_rel = expanded_half_width(calibration.meter_scale.half_width_rel, fit.random_rel)
    r = fit.responsivity_dn_s_cd_m2
    return [
        ("Responsivity", Number(r, decimals(r * scale_rel, 2)), "DN s⁻¹ / (cd m⁻²)"),
        ("95 % uncertainty of the responsivity", _percent(scale_rel, decimals(100 * scale_rel, 2)), "%"),
        ("χ² of the fit", Number(fit.chi_squared, 2), None),
        ("Degrees of freedom", Number(fit.degrees_of_freedom, 0), None),
    ]


def _largest_deviation_rel(evaluation: SessionEvaluation) -> float:
    return max((row.deviation_rel for row in evaluation.patches), key=abs)


def _percent(fraction: float, n_decimals: int) -> Number:
    return Number(100 * fraction, n_decimals)


def _patches(patches: Sequence[PatchRow]) -> Sheet:
    header = (
        "patch",
        "measured in cd/m²",
        "95 % uncertainty of measured in %",
        "calculated (guessed) in cd/m²",
        "calibrated in cd/m²",
        "lower end of 95 % interval in cd/m²",
        "upper end of 95 % interval in cd/m²",
        "95 % uncertainty of calibrated in %",
        "deviation in %",
        "exposures used",
    )
    return Sheet("Patches", header, [_patch(row) for row in patches])


def _patch(row: PatchRow) -> tuple[Cell, ...]:
    n = calibrated_decimals(row)
    low, high = row.calibrated.interval_95_cd_m2
    measured_rel, calibrated_rel = row.measured_half_width_95_rel, row.calibrated.half_width_95_rel
    return (
        row.region.name,
        Number(row.measured_cd_m2, measured_decimals(row)),
        _percent(measured_rel, decimals(100 * measured_rel, 2)),
        None if row.calculated_cd_m2 is None else Number(row.calculated_cd_m2, n),
        Number(row.calibrated.luminance_cd_m2, n),
        Number(low, n),
        Number(high, n),
        _percent(calibrated_rel, decimals(100 * calibrated_rel, 2)),
        _percent(row.deviation_rel, 2),
        exposures(row.calibrated.exposures_s),
    )


def _contrasts(contrasts: Sequence[ContrastRow]) -> Sheet:
    header = (
        "bright patch",
        "dark patch",
        "contrast asked in %",
        "detected from, in %",
        "detected up to, in %",
        "contrast by meter in %",
        "95 % half width by meter in %",
        "contrast by camera in %",
        "95 % half width by camera in %",
        "CDP",
        "standard error of CDP",
        "lower end of 95 % interval",
        "upper end of 95 % interval",
        "below",
        "above",
        "exposure in ms",
        "frame of the bright patch",
        "frame of the dark patch",
    )
    return Sheet("Contrasts", header, [_contrast(row) for row in contrasts])


def _contrast(row: ContrastRow) -> tuple[Cell, ...]:
    result = row.cdp
    n = cdp_decimals(result)
    asked = [100 * value for value in (result.contrast, *result.interval)]
    return (
        row.bright,
        row.dark,
        *map(_as_written, asked),
        *_with_half_width(row.measured_contrast, row.measured_standard_uncertainty),
        *_with_half_width(row.camera_contrast, row.camera_standard_uncertainty),
        Number(result.cdp, n),
        Number(result.standard_error, n + 1),
        *(Number(value, n) for value in (*result.confidence_interval, result.below, result.above)),
        _as_written(1e3 * row.exposure_s),
        Number(row.frame_number, 0),
        Number(row.dark_frame_number, 0),
    )


def _as_written(value: float) -> Number:
    """Show as many decimals as it takes to write a value somebody chose."""
    return Number(value, len(f"{value:.6g}".partition(".")[2]))


def _with_half_width(contrast: float, standard_uncertainty: float) -> tuple[Number, Number]:
    half_width = 100 * Z_95 * standard_uncertainty
    n = decimals(half_width, 2)
    return Number(100 * contrast, n), Number(half_width, n)


def _residuals(calibration: AnyCalibration) -> Sheet:
    header = (
        "patch",
        "readings",
        "meter in cd/m²",
        "95 % half width by meter, without its scale, in cd/m²",
        "camera in cd/m²",
        "residual in %",
        "residual / its standard deviation",
        "exposures used",
    )
    rows = []
    for row in calibration.residuals:
        half_width = Z_95 * row.reading_random_cd_m2
        n = decimals(half_width, 2)
        rows.append(
            (
                row.patch,
                Number(row.n_readings, 0),
                Number(row.reading_cd_m2, n),
                Number(half_width, n),
                Number(row.luminance_cd_m2, n),
                _percent(row.residual_rel, 2),
                Number(row.standardised_residual, 2),
                exposures(row.exposures_s),
            )
        )
    return Sheet("Residuals", header, rows)


def _distribution(contrasts: Sequence[ContrastRow]) -> Sheet:
    """Cumulative probabilities; a pair has one at the contrasts it was evaluated for, no value is interpolated."""
    header = ["Contrasts in %", *(f"{pair_name(row)}, {percent(row.cdp.contrast)}" for row in contrasts)]
    curves = [_curve(row.distribution) for row in contrasts]
    edges = sorted({edge for curve in curves for edge in curve})
    rows = [
        (Number(100 * edge, 3), *(Number(curve[edge], 6) if edge in curve else None for curve in curves))
        for edge in edges
    ]
    return Sheet("Contrast distribution", header, rows)


def _curve(distribution: ContrastDistribution) -> dict[float, float]:
    """Cumulative probability by contrast."""
    return dict(zip(distribution.edges.tolist(), distribution.cumulative.tolist(), strict=True))


def _provenance(evaluation: SessionEvaluation) -> Sheet:
    configuration = evaluation.observed.configuration.to_toml().splitlines()
    rows = [
        *provenance_facts(evaluation),
        *((f"Calibration: {fact.name}", fact.value) for fact in facts_of_any(evaluation.calibration)),
        *(("Configuration", line) for line in configuration if line),
    ]
    return Sheet("Provenance", ("What", "Value"), rows)
