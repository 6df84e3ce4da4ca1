"""Verification of a calibration from a recorded session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...calibration import AnyCalibration
from ...calibration.verify.result import Verification
from ...calibration.verify.verify import verify
from ...core.errors import CalibrationError
from ...session import MeterCertificate, Session
from .corrections import calibration_for, corrections_of
from .observe import ObservedSession, input_sha256, observe_session
from .recorded import Report, certificate_of, measured_in, require_patches
from .session import mismatch


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
        this session: it would conform whatever has changed.
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
    calibration = calibration_for(session, calibration)
    corrections, certificate = corrections_of(calibration), certificate or certificate_of(calibration, session)
    observed = observe_session(session, without, report, corrections, certificate)
    result = verify(
        calibration,
        {name or "": [o for group in seen.patches.values() for o in group] for name, seen in observed.planes.items()},
        {name or "": seen.darks for name, seen in observed.planes.items()},
        observed.readings,
        observed.meter_scale,
        tolerance_rel,
    )
    return replace(result, findings=(*result.findings, *mismatch(session.configuration, calibration))), observed
