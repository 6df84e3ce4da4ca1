"""A calibration as labelled tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import inf
from typing import Any

from ....calibration import AnyCalibration, Calibration, PatchResidual
from ....calibration.colour.model import ColourCalibration
from ....calibration.errors.expanded import expanded_rel
from ....core.finding import Finding, info
from ....core.quantity import quantity_table
from ....core.result import InputFile, Result
from ....core.table import Column, Table, uncertain, uncertain_values
from ....report.digits import exposures
from ....report.findings import finding_text
from .budget import budget_tables, budgets
from .quantities import RESPONSES, RESPONSIVITY, conditions, quantities

_EXPOSURE_CODES = ("exposure-saturated", "exposure-clipped", "exposure-outside-response", "exposure-not-above-dark")


def calibration_result(
    calibration: AnyCalibration,
    title: str = "",
    inputs: Sequence[InputFile] = (),
    options: Mapping[str, Any] | None = None,
) -> Result:
    """Return all numbers of a calibration.

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        What to report.
    title : str
        Name of the measurement; empty for that of the camera.
    inputs : sequence of InputFile
        What it was made from.
    options : mapping or None
        How it was made; values JSON can hold.
    """
    camera, meter = calibration.state.camera, calibration.meter_scale.meter
    return Result(
        "calibrate",
        title or str(camera),
        tuple(calibration_tables(calibration)),
        summarised(calibration.findings),
        tuple(inputs),
        options or {},
        simulated=camera.simulated or meter.simulated,
    )


def calibration_tables(calibration: AnyCalibration) -> Iterator[Table]:
    """Yield the tables of a calibration."""
    found = budgets(calibration)
    totals, sources = budget_tables(found)
    yield quantity_table("calibration", "Calibration", quantities(calibration))
    yield totals
    if isinstance(calibration, Calibration):
        yield patch_table(calibration)
        yield _models({"": calibration})
        yield _checks({"": calibration})
    else:
        planes = {f"{plane.state.plane}": plane for plane in calibration.planes}
        yield _planes(calibration)
        yield patch_table(calibration)
        yield _combinations(calibration)
        yield _models(planes)
        yield _checks(planes)
    yield sources
    yield _left_out(calibration)
    columns = (Column("item", "condition"), Column("value", "value"))
    rows = [{"item": item, "value": value} for item, value in conditions(calibration)]
    yield Table.of_rows("conditions", "Conditions", columns, rows, detail=True)


def summarised(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings with those of single exposures that are left out as one; a table has them all."""
    kept = [one for one in findings if one.code not in _EXPOSURE_CODES]
    patches = list(dict.fromkeys(one.subject for one in findings if one.code in _EXPOSURE_CODES))
    return (*kept, info("exposures-left-out", patches=patches)) if patches else tuple(kept)


def patch_table(calibration: AnyCalibration) -> Table:
    """Return the patches of the fit and those held out, by meter and camera, with rising luminance."""
    columns = (
        Column("patch", "patch"),
        Column("used_for", "used for", "", "Whether the patch was used for the fit."),
        Column("n_readings", "readings", "", "Number of readings of the meter."),
        *uncertain(
            Column("meter_cd_m2", "meter", "cd/m²", "Mean reading; U and u without the scale error of the meter.")
        ),
        Column("camera_cd_m2", "camera", "cd/m²", "By the calibrated camera."),
        Column(
            "deviation_rel", "deviation from meter", "%", "Relative deviation of the camera from the meter.", decimals=2
        ),
        Column("z", "z", "", "Deviation over its standard uncertainty by the stated errors.", decimals=2),
        Column("leave_one_out_rel", "by a fit without it", "%", "Deviation by a fit without this patch.", decimals=2),
        Column("x_px", "x", "px", "Middle of the patch in the image.", decimals=0),
        Column("y_px", "y", "px", "Middle of the patch in the image.", decimals=0),
        Column("exposures", "exposures", "", "Exposures that were used."),
    )
    rows = [_patch_row(row, "fit") for row in calibration.residuals]
    rows += [_patch_row(row, "held out") for row in calibration.held_out]
    table = Table.of_rows("calibration_patches", "Patches of the calibration", columns, rows, detail=True)
    return table.sorted_by("meter_cd_m2")


def _patch_row(row: PatchResidual, use: str) -> dict[str, Any]:
    return {
        "patch": row.patch,
        "used_for": use,
        "n_readings": row.n_readings,
        **uncertain_values("meter_cd_m2", row.reading_cd_m2, row.reading_random_cd_m2),
        "camera_cd_m2": row.luminance_cd_m2,
        "deviation_rel": row.residual_rel,
        "z": row.standardised_residual,
        "leave_one_out_rel": row.leave_one_out_rel,
        "x_px": row.centre_px[0],
        "y_px": row.centre_px[1],
        "exposures": exposures(row.exposures_s),
    }


def _plane_column(planes: Mapping[str, Calibration]) -> tuple[Column, ...]:
    return () if "" in planes else (Column("plane", "plane", "", "Colour plane."),)


def _models(planes: Mapping[str, Calibration]) -> Table:
    columns = (
        *_plane_column(planes),
        Column("model", "model", "", "Candidate model of the response."),
        Column("n_parameters", "parameters", "", "Free parameters, the responsivity among them."),
        Column(
            "leave_one_out_rel", "rms deviation", "%", "Of patches from a fit without them, root mean square.", digits=3
        ),
        Column("chosen", "chosen", "", "Whether the calibration uses it."),
        Column("reason", "reason", "", "Why it was chosen, or was not."),
    )
    rows = [
        {
            "plane": plane,
            "model": RESPONSES[step.kind],
            "n_parameters": step.n_parameters,
            "leave_one_out_rel": step.leave_one_out_rel,
            "chosen": step.chosen,
            "reason": finding_text(step.reason),
        }
        for plane, calibration in planes.items()
        for step in calibration.ladder
    ]
    note = "Each model is judged by how well it predicts patches that were left out of its fit."
    return Table.of_rows("models", "Models of the response", columns, rows, note, detail=True)


def _checks(planes: Mapping[str, Calibration]) -> Table:
    columns = (
        *_plane_column(planes),
        Column("check", "check", "", "Assumption that is checked."),
        *uncertain(Column("deviation", "deviation", "", "Deviation that was found.")),
        Column("unit", "unit", "", "Unit of deviation, U and u."),
        Column("significant", "significant", "", "Whether it is significant."),
        Column("result", "result", "", "Result in words."),
    )
    rows = []
    for plane, calibration in planes.items():
        for test in calibration.tests:
            known = uncertain_values("deviation", test.value, test.standard_uncertainty) if test.tested else {}
            verdict = ("yes" if test.significant else "no") if test.tested else "not tested"
            row = {"plane": plane, "check": test.name, "unit": test.unit, "significant": verdict, **known}
            rows.append(row | {"result": finding_text(test.finding)})
    return Table.of_rows("checks", "Checks of the model's assumptions", columns, rows, detail=True)


def _planes(colour: ColourCalibration) -> Table:
    columns = (
        Column("plane", "plane"),
        Column("weight", "weight", "", "Weight of its luminance in the sum.", decimals=3),
        Column("u_weight", "u of weight", "", "Standard uncertainty of the weight.", digits=2, shown=False),
        *uncertain(
            Column("responsivity", "responsivity", RESPONSIVITY, "U and u without the scale error of the meter.")
        ),
        Column("rate_weight", "weight of its rate", "(cd/m²) / (DN/s)", "Weight over responsivity.", shown=False),
        Column("dark_offset_dn", "dark offset", "DN", "Mean dark signal at exposure time 0.", decimals=2),
        Column("k_dn_per_e", "K", "DN/e⁻", "Overall system gain.", digits=3),
        Column("largest_deviation_rel", "largest deviation", "%", "Of a patch from the fit of the plane.", digits=2),
    )
    rows = [
        {
            "plane": f"{plane.state.plane}",
            "weight": weight,
            "u_weight": colour.weight_covariance[index][index] ** 0.5,
            **_plane_responsivity(plane),
            "rate_weight": colour.rate_weights[f"{plane.state.plane}"],
            "dark_offset_dn": plane.dark.offset_dn,
            "k_dn_per_e": plane.noise.k_dn_per_e,
            "largest_deviation_rel": max((abs(row.residual_rel) for row in plane.residuals), default=None),
        }
        for index, (plane, weight) in enumerate(zip(colour.planes, colour.weights, strict=True))
    ]
    note = (
        "The luminance is a weighted sum of the planes' luminances, with the weights that fit the meter best; a weight "
        "may be negative."
    )
    return Table.of_rows("planes", "Colour planes", columns, rows, note)


def _plane_responsivity(plane: Calibration) -> dict[str, float | None]:
    fit = plane.responsivity
    r = fit.responsivity_dn_s_cd_m2
    expanded = r * expanded_rel((), fit.random_rel, fit.dof or inf)
    return uncertain_values("responsivity", r, r * fit.random_rel) | {"expanded_responsivity": expanded}


def _combinations(colour: ColourCalibration) -> Table:
    columns = (
        Column("luminance_from", "luminance from"),
        Column(
            "leave_one_out_rel", "rms deviation", "%", "Of patches from a fit without them, root mean square.", digits=3
        ),
        Column("chosen", "chosen", "", "Whether the calibration uses it."),
        Column("reason", "reason", "", "Why it was chosen, or was not."),
    )
    rows = [
        {
            "luminance_from": step.name,
            "leave_one_out_rel": step.leave_one_out_rel,
            "chosen": step.chosen,
            "reason": finding_text(step.reason),
        }
        for step in colour.ladder
    ]
    return Table.of_rows("combinations", "The combination against single colours", columns, rows, detail=True)


def _left_out(calibration: AnyCalibration) -> Table:
    planes = () if isinstance(calibration, Calibration) else calibration.planes
    columns = (
        Column("patch", "patch"),
        *((Column("plane", "plane", "", "Colour plane; empty for the combination."),) if planes else ()),
        Column("exposure_s", "exposure", "s", "The exposure left out; none if it is a reading or all.", 0, time=True),
        Column("reading", "reading", "", "Which reading is left out, counted from 1."),
        Column("reason", "reason", "", "Why it is left out."),
    )
    rows = [
        {"patch": one.patch, "plane": plane, "exposure_s": one.exposure_s, "reading": one.reading, "reason": one.reason}
        for plane, of in (("", calibration), *((f"{one.state.plane}", one) for one in planes))
        for one in of.left_out
    ]
    return Table.of_rows("left_out", "Left out of the fit", columns, rows, detail=True)
