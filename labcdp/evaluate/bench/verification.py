"""Verification of a calibration from a recorded session, and its tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...calibration import AnyCalibration
from ...calibration.verify.result import Verification
from ...calibration.verify.verify import verify
from ...core.errors import CalibrationError
from ...core.result import InputFile, Result
from ...core.table import Column, Table, uncertain, with_expanded
from ...report.layout import page_text
from ...report.text import minute
from ...session import MeterCertificate, Session
from .calibration_result import CAMERA, DEVIATION, EXPOSURES, PATCH, WITH_SCALE, meter_columns
from .observe import ObservedSession, input_sha256
from .quantities import RESPONSIVITY
from .recorded import Report, measured_in, require_patches
from .session import mismatch, observe_calibrated


def verify_session(
    session: Session,
    calibration: AnyCalibration,
    patches: Sequence[str] = (),
    report: Report = lambda _done, _total: None,
    tolerance_rel: float | None = None,
    certificate: MeterCertificate | None = None,
) -> tuple[Verification, ObservedSession]:
    """Verify a calibration with what a session recorded.

    Parameters
    ----------
    session : Session
        With light frames, dark frames and readings of one patch or more.
    calibration : Calibration or ColourCalibration
        Of the same camera, lens and settings.
    patches : sequence of str
        Patches to use; empty for all.
    report : callable
        Called with the number of frames read, and of all frames.
    tolerance_rel : float or None
        Largest relative deviation that conforms; None for the U (95 %) of the calibration.
    certificate : MeterCertificate or None
        Of the meter; None for that of the session's configuration, or of the calibration if it is the same meter.

    Returns
    -------
    Verification, ObservedSession
        The result, and what the session says.

    Raises
    ------
    CalibrationError
        As `labcdp.calibration.verify.verify.verify`, if the lens is another, and if the calibration was made from
        this session or frames of it: it would conform whatever has changed.
    SessionError
        If a file is missing or altered.
    InputError
        If the session has no such patch.
    """
    names = [patch.name for patch in session.configuration.target.patches]
    require_patches(patches, names, "to verify with")
    without = [name for name in names if patches and name not in patches]
    if measured_in(session, calibration) or calibration.provenance.comes_from(input_sha256(session)):
        raise CalibrationError(
            f"the calibration was made from session {session.path}, which cannot verify it: measure again in a new "
            "session"
        )
    observed, calibration = observe_calibrated(session, calibration, without, report, certificate)
    shared = observed.frames_sha256.intersection(calibration.provenance.frames_sha256)
    if shared:
        raise CalibrationError(
            f"{len(shared)} of the {len(observed.frames_sha256)} frames of session {session.path} are frames that the "
            "calibration was made from, which cannot verify it: measure again in a new session"
        )
    seen = observed.by_plane, observed.darks_by_plane
    result = verify(calibration, *seen, observed.readings, observed.meter_scale, tolerance_rel)
    findings, frames = mismatch(session.configuration, calibration), tuple(sorted(observed.frames_sha256))
    return replace(result, findings=(*result.findings, *findings), frames_sha256=frames), observed


def verification_result(verification: Verification, title: str, inputs: Sequence[InputFile] = ()) -> Result:
    """Return all numbers of a verification.

    Parameters
    ----------
    verification : Verification
        What to report.
    title : str
        Name of the session.
    inputs : sequence of InputFile
        Session and calibration.
    """
    simulated = verification.state.camera.simulated or verification.meter.meter.simulated
    return Result.of("verify", title, _tables(verification), verification.findings, *inputs, simulated=simulated)


def _tables(verification: Verification) -> Iterator[Table]:
    yield _verdict(verification)
    yield verified_patches(verification)
    if len(verification.planes) > 1:
        yield _planes(verification)
    yield _darks(verification)


def decision_rule(verification: Verification) -> str:
    """Return tolerance and decision rule in words."""
    source = "as stated" if verification.tolerance_stated else "U (95 %) of the calibration"
    if any(row.tolerance_rel != verification.tolerance_rel for row in verification.patches):
        source += " on the axis, of each patch as in the table"
    return page_text("decision-rule", tolerance_rel=verification.tolerance_rel, source=source)


def _verdict(verification: Verification) -> Table:
    mean = Column("mean_rel", "mean deviation", "%", "Weighted mean over the patches.")
    columns = (
        Column("verdict", "verdict", "", "Conform, undecided or not conform."),
        Column("tolerance_rel", "tolerance", "%", "Largest deviation that still conforms.", digits=2),
        Column("tolerance_stated", "stated", "", "Whether it was stated; otherwise it is U (95 %) of the calibration."),
        *with_expanded(mean, "mean_expanded_rel"),
        Column("same_meter", "same meter", "", "Whether it is that of the calibration in the same state."),
        Column("meter", "meter", "", "Meter with its certificate or date.", value=lambda row: str(row.meter)),
        Column("calibration_meter", "meter of calibration", "", "Meter with its certificate or date.",
               value=lambda row: str(row.calibration_meter)),
        Column("calibrated", "calibrated", "", "Time of the last reading of the calibration.",
               value=lambda row: minute(row.calibration_measured)),
        Column("verified", "verified", "", "Time of the last reading of the verification.",
               value=lambda row: minute(row.measured)),
    )  # fmt: skip
    return Table.of_items("verdict", "Verification", columns, [verification], decision_rule(verification))


def verified_patches(verification: Verification) -> Table:
    """Return the patches with deviation, U, tolerance and verdict, with rising luminance."""
    deviation = replace(DEVIATION, label="deviation d", decimals=None)
    columns = (
        PATCH,
        Column("n_readings", "readings", "", "Number of meter readings.", shown=False),
        *meter_columns(),
        CAMERA,
        *uncertain(deviation, "standard_uncertainty_rel", "expanded_rel"),
        Column("guard_rel", "guard band w", "%", "U (95 %) of the present measurement.", digits=2),
        Column("tolerance_rel", "tolerance T", "%", "Largest deviation that still conforms.", digits=2),
        Column("verdict", "verdict", "", "According to the decision rule."),
        Column(
            "conformance_probability", "p of conformity", "",
            "Probability that the true deviation is within the tolerance (JCGM 106:2012, 7.2).", decimals=3,
        ),
        EXPOSURES,
    )  # fmt: skip
    table = Table.of_items("patches", "Patches measured again", columns, verification.patches, WITH_SCALE)
    return table.sorted_by("meter_cd_m2")


def _planes(verification: Verification) -> Table:
    balance, change, responsivity = (
        Column("balance_rel", "against all planes", "%", "On grey patches, without the meter.",
               value=lambda row: row.drift and row.balance_rel),
        Column("change_rel", "against the meter", "%", "Of the responsivity, on grey patches.", value="drift.relative"),
        Column("responsivity", "responsivity now", RESPONSIVITY, "With this change.",
               value="drift.responsivity_dn_s_cd_m2"),
    )  # fmt: skip
    columns = (
        Column("plane", "plane", value=lambda row: f"{row.plane}"),
        *with_expanded(balance, lambda row: row.drift and row.balance_expanded_rel),
        *with_expanded(change, "drift.expanded_rel"),
        *with_expanded(
            responsivity,
            lambda row: row.drift and row.drift.responsivity_dn_s_cd_m2 * row.drift.responsivity_expanded_rel,
        ),
    )
    return Table.of_items("planes", "Colour planes", columns, verification.planes)


def _darks(verification: Verification) -> Table:
    of_plane = Column("plane", "plane", "", "Colour plane.")
    columns = (
        Column("exposure_s", "exposure", "s", "Exposure time of the dark frames.", digits=0, time=True),
        *((of_plane,) if len(verification.planes) > 1 else ()),
        Column("mean_dn", "now", "DN", "Mean of the new dark frames.", decimals=2),
        Column("expected_dn", "by the calibration", "DN", "Mean dark signal of the calibration.", decimals=2),
        *uncertain(Column("difference_dn", "difference", "DN", "New minus expected."), "standard_uncertainty_dn"),
        Column("effect_rel", "effect", "%", "Effect of the difference on the lowest calibrated luminance.", decimals=2),
    )
    return Table.of_items("darks", "Dark signal measured again", columns, verification.darks)
