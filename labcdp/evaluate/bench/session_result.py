"""The evaluation of a session as labelled tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import hypot, nan

from ...calibration import AnyCalibration, contrast_U, contrast_u
from ...core.result import Finding, InputFile, Result, info
from ...core.table import Column, Table, uncertain, with_bound, with_interval
from ...report.text import day, exposures, minute, span
from ...session import Session
from ..judgement import SeenContrast, judged_pairs
from ..requirement import Requirement
from ..verdict import LIMIT, VERDICT
from .calibration_result import calibration_tables
from .observe import ObservedSession
from .quantities import lens_text, meter_text, pixels_text
from .rows import ContrastRow, PatchRow
from .session import SessionEvaluation

#: A contrast and its CDP: the columns of `ContrastRow`.
CONTRASTS = (
    Column("pair", "bright / dark", value="name"),
    Column("bright", "bright patch", shown=False, value="target.bright"),
    Column("dark", "dark patch", shown=False, value="target.dark"),
    Column("target_contrast", "target contrast", "%", "Weber contrast to be detected.", 0, value="cdp.contrast"),
    Column("epsilon", "tolerance ε", "%", "Contrasts within the target contrast ± ε of it count.", 0,
           value="cdp.epsilon"),
    Column("detected_from", "detected from", "%", "Lowest contrast that counts.", 0, shown=False,
           value="cdp.detected_range.0"),
    Column("detected_up_to", "detected up to", "%", "Highest contrast that counts.", 0, shown=False,
           value="cdp.detected_range.1"),
    *uncertain(
        Column("measured_contrast", "contrast by meter", "%",
               "From the mean luminances measured with the meter; its scale error cancels."),
        lambda row: (1 + row.measured_contrast) * hypot(row.bright.reading.random_rel, row.dark.reading.random_rel),
        "measured_contrast_expanded",
    ),
    *with_bound(uncertain(
        Column("camera_contrast", "contrast by camera", "%",
               "From the mean luminances of the camera; scale and fit cancel."),
        lambda row: nan if row.bound else contrast_u(row.bright.calibrated, row.dark.calibrated),
        lambda row: nan if row.bound else contrast_U(row.bright.calibrated, row.dark.calibrated),
    ), "bound"),
    *with_interval(Column("cdp", "CDP", "", "Share of pixel pairs whose contrast counts.", value="cdp.cdp"),
                   "cdp.interval"),
    Column("u_cdp", "u of CDP", "", "Standard uncertainty by pixels and calibration.", digits=2, shown=False,
           value="cdp.u"),
    Column("u_cdp_pixels", "u of CDP by pixels", "", "Standard uncertainty, pixels alone.", digits=2, shown=False,
           value="cdp.u_pixels"),
    LIMIT.within("target"),
    VERDICT,
    Column("below", "below", "", "Share of pixel pairs with a lower contrast.", decimals=4, value="cdp.below"),
    Column("above", "above", "", "Share of pixel pairs with a higher contrast.", decimals=4, value="cdp.above"),
    Column("undefined", "undefined", "", "Share of pixel pairs without a contrast.", shown=False,
           value="cdp.undefined"),
    Column("bright_pixels", "bright pixels", "", "Pixels of the bright patch.", shown=False, value="cdp.n_bright"),
    Column("dark_pixels", "dark pixels", "", "Pixels of the dark patch.", shown=False, value="cdp.n_dark"),
    Column("exposure_s", "exposure", "s", "Of the frame: the longest without saturation.", digits=0, time=True),
    Column("frame_number", "frame", "", "Number of the frame with the bright patch.", shown=False),
    Column("dark_frame_number", "frame (dark)", "", "Number of the frame with the dark patch.", shown=False),
)  # fmt: skip

#: Luminances of a `PatchRow` by meter and camera, and their deviation.
LUMINANCES = (
    *uncertain(
        Column("measured_cd_m2", "measured", "cd/m²", "Mean reading of the meter.", value="reading.luminance_cd_m2"),
        lambda row: hypot(row.reading.random_rel, row.meter.common_rel) * row.reading.luminance_cd_m2,
        lambda row: row.reading.U_rel(row.meter) * row.reading.luminance_cd_m2,
    ),
    *with_bound(uncertain(
        Column("calibrated_cd_m2", "calibrated", "cd/m²", "From the calibrated camera.",
               value="calibrated.luminance_cd_m2"),
        lambda row: row.calibrated.u_rel * row.calibrated.luminance_cd_m2,
        lambda row: row.U_rel * row.calibrated.luminance_cd_m2,
    ), "bound"),
    Column("deviation_rel", "deviation", "%", "Relative deviation of the camera from the meter.", decimals=2),
)  # fmt: skip


def session_result(
    evaluation: SessionEvaluation,
    inputs: Sequence[InputFile] = (),
    kind: str = "evaluate",
    seed: int | None = None,
    requirement: Requirement | None = None,
) -> Result:
    """Return all numbers of an evaluated session.

    Parameters
    ----------
    evaluation : SessionEvaluation
        What to report.
    inputs : sequence of InputFile
        What it was made from besides the session.
    kind : str
        Name of the command.
    seed : int or None
        Of a simulation.
    requirement : Requirement or None
        What the pairs are judged by, which were evaluated at its contrast.
    """
    configuration = evaluation.observed.configuration
    made = configuration.model_dump(mode="json", by_alias=True, exclude_none=True)
    more = {"configuration": made, "seed": seed, "simulated": bool(evaluation.simulated)}
    findings, session = [*evaluation.findings, _check(evaluation)], evaluation.observed.session
    findings += () if evaluation.chart is None else evaluation.chart.findings
    findings += [finding for pair in evaluation.colours for finding in pair.separation.findings]
    if evaluation.flicker:
        from ..flicker.measure import flicker_findings

        findings += flicker_findings(evaluation.flicker)
    tables = [*_tables(evaluation)]
    if requirement is not None:
        judgement = judged_pairs(requirement, map(_seen, evaluation.contrasts))
        tables.insert(0, judgement.table)
        findings += judgement.findings
        made["requirement"] = requirement.model_dump(mode="json", exclude_none=True)
    return Result.of(kind, configuration.name, tables, findings, session_input(session), *inputs, **more)


def _seen(row: ContrastRow) -> SeenContrast:
    """Return what a requirement judges."""
    luminance = None if row.dark.bound else row.dark.calibrated.luminance_cd_m2
    return SeenContrast(
        row.name,
        "",
        luminance,
        row.camera_contrast,
        bool(row.bound),
        row.cdp.cdp,
        row.cdp.interval,
        row.measured_contrast,
    )


def session_input(session: Session) -> InputFile:
    """Return the record of a session as an input."""
    return InputFile("session", str(session.path), InputFile.of("journal", session.path / "journal.jsonl").sha256)


def _tables(evaluation: SessionEvaluation) -> Iterator[Table]:
    title = "Contrast detection probability (CDP)"
    if evaluation.chart is not None:
        from ..chart.tables import matrix_tables, patch_table, range_table

        charts = [(evaluation.observed.configuration.target.name, evaluation.chart)]
        yield range_table(charts, False)
        yield patch_table(charts, False).as_detail()
        yield from matrix_tables(evaluation.chart)
    yield Table.of_items("contrasts", title, CONTRASTS, evaluation.contrasts)
    if evaluation.colours:
        from ..colour.tables import colour_table

        yield colour_table([(evaluation.observed.configuration.name, evaluation.colours)], False)
    if evaluation.flicker:
        from ..flicker.tables import flicker_table

        yield flicker_table(evaluation.flicker, "cd/m²", "Flicker of the patches")
    yield _luminance(evaluation.patches)
    yield _distribution(evaluation.contrasts)
    for table in calibration_tables(evaluation.calibration):
        if table.name in ("calibration", "calibration_patches", "planes", "left_out", "conditions"):
            yield table.as_detail()
    yield provenance_table(evaluation.observed, evaluation.calibration, ", ".join(evaluation.simulated))


def _luminance(patches: Sequence[PatchRow]) -> Table:
    guessed = any(row.calculated_cd_m2 is not None for row in patches)
    limits = (
        Column("lowest_cd_m2", "at least", "cd/m²", "Limit of the plan.", value="patch.limits_cd_m2.0"),
        Column("highest_cd_m2", "at most", "cd/m²", "Limit of the plan.", value="patch.limits_cd_m2.1"),
        Column("limit_verdict", "limits", "", "Pass or fail if the whole interval, calibrated ± U, is inside or "
            "outside."),
    )  # fmt: skip
    calculated = Column(
        "calculated_cd_m2",
        "from guessed parameters",
        "cd/m²",
        "Calculated with the camera parameters of [guess], without a calibration.",
    )
    columns = (
        Column("patch", "patch", value="patch.name"),
        *LUMINANCES[:3],
        *((calculated,) if guessed else ()),
        *LUMINANCES[3:],
        Column("expanded_rel", "U of calibrated", "%", "Relative U (95 %), the meter's scale included.", digits=2,
               value="U_rel"),
        *(limits if any(row.patch.limits_cd_m2 for row in patches) else ()),
        Column("n_readings", "readings", "", "Number of meter readings.", shown=False,
               value="reading.n_readings"),
        Column("exposures", "exposures", "", "Exposures that were used.", shown=False,
               value=lambda row: exposures(row.calibrated.exposures_s)),
    )  # fmt: skip
    note = "± is U (95 %), the scale error of the meter included."
    return Table.of_items("luminance", "Luminance", columns, patches, note).sorted_by("measured_cd_m2")


def _distribution(contrasts: Sequence[ContrastRow]) -> Table:
    """Return the distributions of the contrasts in a long table."""
    columns = (
        Column("pair", "bright / dark", value="0.name"),
        Column("target_contrast", "target contrast", "%", "Weber contrast to be detected.", 0, value="0.cdp.contrast"),
        Column("contrast", "contrast", "%", "Weber contrast.", digits=6, value="1"),
        Column("cumulative", "cumulative probability", "", "Share of pixel pairs up to this contrast.", decimals=6,
               value="2"),
    )  # fmt: skip
    points = [
        (row, *point)
        for row in contrasts
        if (distribution := row.distribution) is not None
        for point in zip(distribution.edges.tolist(), distribution.cumulative.tolist(), strict=True)
    ]
    title = "Distribution of the contrasts of all pixel pairs"
    return Table.of_items("contrast_distribution", title, columns, points, detail=True)


def provenance_table(observed: ObservedSession, calibration: AnyCalibration, simulated: str = "") -> Table:
    """Return who measured what and with which devices, and the hashes of the data, as a table of facts."""
    configuration, state, times = observed.configuration, calibration.state, observed.times
    height, width = state.image_shape
    meters = dict.fromkeys(meter_text(r.meter) for readings in observed.readings.values() for r in readings)
    rows = [
        ("session", configuration.name),
        ("operator", configuration.operator),
        ("notes", configuration.notes),
        ("target", configuration.target.name),
        ("meter readings", span(minute(times[0]), minute(times[-1]))),
        ("camera", str(state.camera)),
        (
            "camera settings",
            f"{pixels_text(state)}, {width} x {height} pixels, gain {state.gain_db:g} dB, "
            f"saturated from {state.saturation_dn:g} DN",
        ),
        ("exposures", exposures({o.exposure_s for name in observed.names for o in observed.observations(name)})),
        ("lens", lens_text(configuration.lens)),
        ("luminance meter", "; ".join(meters)),
        ("light", configuration.source.spectrum),
        ("simulated", simulated),
        ("SHA-256 of frames and readings", observed.input_sha256),
        ("SHA-256 of those of the calibration", calibration.provenance.input_sha256),
    ]
    return Table.of_facts("provenance", "Provenance", rows)


def _check(evaluation: SessionEvaluation) -> Finding:
    """Return whether the deviations between camera and meter are an independent check of the calibration."""
    calibration = evaluation.calibration
    if any(finding.code == "calibration-before-retake" for finding in evaluation.findings):
        return info("not-checked")
    if not calibration.provenance.comes_from(evaluation.observed.input_sha256):
        return info("checked-by-another-measurement", calibrated=day(calibration.provenance.measured))
    fitted = {row.patch for row in calibration.residuals}
    held_out = [row.patch.name for row in evaluation.patches if not (row.bound or row.patch.name in fitted)]
    return info("checked-by-held-out", patches=held_out) if held_out else info("not-checked")
