"""A calibration as labelled tables, its uncertainty budget among them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import inf, sqrt
from typing import Any

import numpy as np

from ...calibration import AnyCalibration
from ...calibration.budget import Budget, BudgetRow, budget
from ...calibration.colour.model import ColourCalibration
from ...calibration.uncertainty import expanded_rel
from ...core.result import InputFile, Result, quantity_table
from ...core.table import Column, Table, uncertain
from ...report.layout import page_text
from ...report.text import exposures, finding_text, significant
from .quantities import RESPONSIVITY, conditions, quantities, response_name

#: Pixels a patch is taken to have where the uncertainty of a calibration is stated.
PATCH_PIXELS = 1000
#: Degrees of freedom from which Student's t is that of the normal distribution, to 1e-4.
_UNLIMITED = 10_000
#: Columns of patches that are compared with a fit.
PATCH = Column("patch", "patch")
CAMERA = Column("camera_cd_m2", "camera", "cd/m²", "From the calibrated camera.", value="luminance_cd_m2")
DEVIATION = Column("deviation_rel", "deviation from meter", "%", "Relative deviation of the camera from the meter.",
                   decimals=2)  # fmt: skip
EXPOSURES = Column("exposures", "exposures", "", "Exposures that were used.",
                   value=lambda row: exposures(row.exposures_s))  # fmt: skip
#: What ± of a reading is.
WITH_SCALE = "± of the meter is U (95 %), its scale error included, which is common to all patches."
_DOF = "Degrees of freedom by Welch and Satterthwaite; empty if practically unlimited."
#: U of the luminance of a `PatchResidual` by the camera.
UNCERTAINTY = (
    Column("expanded_rel", "U of camera", "%", "Relative U (95 %) of the luminance of the patch, at its place.", 2,
           value="U_rel"),
    Column("coverage_factor", "k", "", "Coverage factor, U over u.", decimals=2, value="k"),
    Column("effective_dof", "effective dof", "", _DOF, decimals=0, value=lambda row: limited_dof(row.dof)),
)  # fmt: skip
#: How well a candidate predicts patches, and whether it was chosen.
_CANDIDATE = (
    Column("leave_one_out_rel", "rms deviation", "%", "For patches left out of the fit, root mean square.", 3),
    Column("chosen", "chosen", "", "Whether the calibration uses it."),
    Column("reason", "reason", "", "Why it was or was not chosen.", value=lambda step: finding_text(step.reason)),
)
_MODELS = (
    Column("model", "model", "", "Candidate model of the response.", value=lambda step: response_name(step.kind)),
    Column("n_parameters", "parameters", "", "Free parameters, including the responsivity."),
    *_CANDIDATE,
)
_CHECKS = (
    Column("check", "check", "", "Assumption being checked.", value="name"),
    *uncertain(
        Column("deviation", "deviation", "", "Deviation found.",
               value=lambda test: test.value if test.tested else None),
        lambda test: test.standard_uncertainty if test.tested else None,
    ),
    Column("unit", "unit", "", "Unit of deviation, U and u."),
    Column("significant", "significant", "", "Whether it is significant.",
           value=lambda test: ("yes" if test.significant else "no") if test.tested else "not tested"),
    Column("result", "result", "", "Result in words.", value=lambda test: finding_text(test.finding)),
)  # fmt: skip
_LEFT_OUT = (
    Column("patch", "patch"),
    Column(
        "exposure_s", "exposure", "s", "The exposure left out; empty if it is a reading or all exposures.", 0, time=True
    ),
    Column("reading", "reading", "", "Which reading is left out, counted from 1."),
    Column("reason", "reason", "", "Why it is left out."),
)


def meter_columns() -> tuple[Column, Column, Column]:
    """Return the reading of a `MeasuredPatch` with its U, the meter's scale error included, and its u without it."""
    meter = Column("meter_cd_m2", "meter", "cd/m²", "Mean reading.", value="reading_cd_m2")
    value, expanded, u = uncertain(
        meter, "reading_random_cd_m2", lambda row: _times(row.reading_cd_m2, row.reading_U_rel)
    )
    return value, expanded, replace(u, meaning="Standard uncertainty without the meter's scale error.")


def _times(value: float, rel: float | None) -> float | None:
    return None if rel is None else value * rel


def budget_at(
    calibration: AnyCalibration, luminance_cd_m2: float, position_px: tuple[float, float] | None = None
) -> Budget:
    """Return the budget of the mean over `PATCH_PIXELS` pixels of one frame, which are grey where that matters.

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        Of the camera.
    luminance_cd_m2 : float
        Luminance of the patch.
    position_px : (float, float) or None
        Middle (x, y) of the patch in the image; None for the optical axis.
    """
    n_pixels = PATCH_PIXELS // len(calibration.planes)
    return budget(calibration, luminance_cd_m2, n_pixels=n_pixels, position_px=position_px)


def limited_dof(dof: float | None) -> float | None:
    """Return effective degrees of freedom; None if practically unlimited."""
    return None if dof is None or dof >= _UNLIMITED else dof


def _budget_tables(calibration: AnyCalibration) -> tuple[Table, Table]:
    """Return the uncertainties at the lowest, middle (geometric mean) and highest luminance, and their sources."""
    low, high = calibration.range_cd_m2
    budgets = [budget_at(calibration, luminance) for luminance in (low, sqrt(low * high), high)]
    columns = (
        Column("luminance_cd_m2", "luminance", "cd/m²", "Lowest, medium and highest calibrated luminance."),
        Column("exposure_s", "exposure", "s", "Exposure time of the frame.", digits=0, time=True),
        Column("u_rel", "u", "%", "Relative combined standard uncertainty.", 2, value="u_rel"),
        Column("effective_dof", "effective dof", "", _DOF, decimals=0,
               value=lambda row: limited_dof(row.dof)),
        Column("coverage_factor", "k", "", "Coverage factor, U over u.", decimals=2, value="k"),
        Column("expanded_rel", "U (95 %)", "%", "Relative expanded uncertainty.", 2, value="U_rel"),
    )  # fmt: skip
    note = page_text("uncertainty-of-patch", n_pixels=PATCH_PIXELS)
    title = "Uncertainty of a patch on the optical axis"
    return Table.of_items("uncertainty", title, columns, budgets, note), _sources(budgets)


def _sources(budgets: Sequence[Budget]) -> Table:
    """One row for each source; all of it but the uncertainty is that at the lowest luminance."""
    by_source = [{row.source: row.u_rel for row in budget_of_level.rows} for budget_of_level in budgets]
    columns = (
        Column("source", "source", "", "Source of the uncertainty."),
        *(
            Column(f"u_{level}_rel", f"u at {significant(budget_of_level.luminance_cd_m2, 4)} cd/m²", "%",
                   f"Relative standard uncertainty at the {level} luminance.", decimals=3, value=partial(_u_rel, us))
            for level, budget_of_level, us in zip(("lowest", "middle", "highest"), budgets, by_source, strict=True)
        ),
        Column("distribution", "distribution", "", "Distribution of the error."),
        Column("evaluation", "type", "", "A: from statistics of this measurement; B: from data sheets and other "
            "sources."),
        Column("common", "common", "", "Whether the error is common to all patches, so that it cancels in a contrast."),
        Column("included", "included", "", "Whether the stated uncertainty includes it.",
               value=lambda row: "yes" if row.included else f"in {row.contained_in}" if row.contained_in else "no"),
        Column("basis", "basis", "", "Basis of the value.", value=lambda row: finding_text(row.basis)),
    )  # fmt: skip
    return Table.of_items("budget", "Uncertainty budget", columns, budgets[0].rows, detail=True)


def _u_rel(us_rel: Mapping[str, float], row: BudgetRow) -> float | None:
    return us_rel[row.source] if row.included or row.u_rel != 0 else None


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
    tables, findings = calibration_tables(calibration), calibration.findings
    more = {"configuration": options or {}, "simulated": camera.simulated or meter.simulated}
    return Result.of("calibrate", title or str(camera), tables, findings, *inputs, **more)


def calibration_tables(calibration: AnyCalibration) -> Iterator[Table]:
    """Yield the tables of a calibration."""
    totals, sources = _budget_tables(calibration)
    yield quantity_table("calibration", "Calibration", quantities(calibration))
    yield totals
    planes = {plane.state.plane or "": plane for plane in calibration.planes}
    if isinstance(calibration, ColourCalibration):
        yield _planes(calibration)
    yield _patch_table(calibration)
    if isinstance(calibration, ColourCalibration):
        title = "Combination compared with single colours"
        of_step = (Column("luminance_from", "luminance from", value="name"), *_CANDIDATE)
        yield Table.of_items("combinations", title, of_step, calibration.ladder, detail=True)
    note = page_text("models-of-response")
    yield _table_by_plane("models", "Models of the response", _MODELS, planes, "ladder", note)
    yield _table_by_plane("checks", "Checks of the model's assumptions", _CHECKS, planes, "tests")
    yield sources
    yield _table_by_plane("left_out", "Left out of the fit", _LEFT_OUT, {"": calibration, **planes}, "left_out")
    yield Table.of_facts("conditions", "Conditions", conditions(calibration), "condition")


def _patch_table(calibration: AnyCalibration) -> Table:
    """Return the patches of the fit and those held out, by meter and camera, with rising luminance."""
    fitted, deviation = set(map(id, calibration.residuals)), "Deviation from a fit without this patch."
    rows = (*calibration.residuals, *calibration.held_out)
    columns = (
        PATCH,
        Column("used_for", "used for", "", "Whether the patch was used for the fit.",
               value=lambda row: "fit" if id(row) in fitted else "held out"),
        Column("n_readings", "readings", "", "Number of meter readings."),
        *meter_columns(),
        *uncertain(
            CAMERA,
            lambda row: _times(row.luminance_cd_m2, row.u_rel),
            lambda row: _times(row.luminance_cd_m2, row.U_rel),
        ),
        *(replace(column, shown=False) for column in UNCERTAINTY),
        DEVIATION,
        Column("residual_rel", "residual of the fit", "%", "Relative deviation of the fit from the meter.", decimals=2,
               shown=False),
        Column("z", "z", "", "Residual of the fit over its standard uncertainty by the stated errors.", decimals=2,
               value="standardised_residual"),
        Column("leave_one_out_rel", "from a fit without it", "%", deviation, decimals=2),
        Column("x_px", "x", "px", "Centre of the patch in the image.", decimals=0, value=lambda row: row.centre_px[0]),
        Column("y_px", "y", "px", "Centre of the patch in the image.", decimals=0, value=lambda row: row.centre_px[1]),
        EXPOSURES,
    )  # fmt: skip
    note = f"{WITH_SCALE} z is the residual of the fit over its u. {page_text('uncertainty-in-short')}"
    table = Table.of_items("calibration_patches", "Patches of the calibration", columns, rows, note, True)
    return table.sorted_by("meter_cd_m2")


def _table_by_plane(
    name: str, title: str, columns: Sequence[Column], planes: Mapping[str, AnyCalibration], what: str, note: str = ""
) -> Table:
    """Return what each plane has of something, with the plane where there are several; empty for the combination."""
    rows = [(plane, row) for plane, calibration in planes.items() for row in getattr(calibration, what)]
    table = Table.of_items(name, title, columns, [row for _, row in rows], note, detail=True)
    if len(planes) == 1:
        return table
    of_plane = Column("plane", "plane", "", "Colour plane.")
    return replace(table, columns=(of_plane, *table.columns), data={"plane": [p for p, _ in rows], **table.data})


def _planes(colour: ColourCalibration) -> Table:
    us = np.sqrt(np.diag(colour.weight_covariance)).tolist()
    planes = list(zip(colour.planes, colour.weights, us, strict=True))
    columns = (
        Column("plane", "plane", value="0.state.plane"),
        Column("weight", "weight", "", "Weight of its luminance in the sum.", decimals=3, value="1"),
        Column("u_weight", "u of weight", "", "Standard uncertainty of the weight.", 2, shown=False, value="2"),
        *uncertain(
            Column("responsivity", "responsivity", RESPONSIVITY, "U and u without the meter's scale error.",
                   value="0.responsivity.responsivity_dn_s_cd_m2"),
            lambda row: (of := row[0].responsivity).responsivity_dn_s_cd_m2 * of.random_rel,
            lambda row: (of := row[0].responsivity).responsivity_dn_s_cd_m2
            * expanded_rel((), of.random_rel, of.dof or inf),
        ),
        Column("rate_weight", "weight of its rate", "(cd/m²) / (DN/s)", "Weight over responsivity.", shown=False,
               value=lambda row: row[1] / row[0].responsivity.responsivity_dn_s_cd_m2),
        Column("dark_offset_dn", "dark offset", "DN", "Mean dark signal at exposure time 0.", decimals=2,
               value="0.dark.offset_dn"),
        Column("k_dn_per_e", "K", "DN/e⁻", "Overall system gain.", digits=3, value="0.noise.k_dn_per_e"),
        Column("largest_deviation_rel", "largest deviation", "%", "Of a patch, from the fit of the plane.", digits=2,
               value=lambda row: max(abs(residual.residual_rel) for residual in row[0].residuals)),
    )  # fmt: skip
    return Table.of_items("planes", "Colour planes", columns, planes, page_text("weights-of-planes"))
