"""Verification of a calibration from a recorded session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..calibration import Calibration
from ..calibration.verification import Verification
from ..calibration.verify import verify
from ..errors import InputError
from ..session import Session
from .corrections import Corrections
from .observe import Report, observe_session
from .session import mismatch


def verify_session(
    session: Session,
    calibration: Calibration,
    patches: Sequence[str] = (),
    report: Report = lambda _done, _total: None,
) -> Verification:
    """Verify a calibration with what a session recorded.

    Parameters
    ----------
    session : Session
        With light frames, dark frames and readings of one patch or more.
    calibration : Calibration
        Of the same camera, lens and settings.
    patches : sequence of str
        Patches to use; empty for all.
    report : callable
        Called with the number of frames read, and of all frames.

    Raises
    ------
    CalibrationError
        As `labcdp.calibration.verify.verify`, and if the lens is another.
    SessionError
        If a file is missing or altered.
    InputError
        If the session has no such patch.
    """
    names = [patch.name for patch in session.configuration.target.patches]
    unknown = [name for name in patches if name not in names]
    if unknown:
        raise InputError(f"there is no patch {unknown[0]!r} to verify with: choose from {', '.join(names)}")
    without = [name for name in names if patches and name not in patches]
    corrections = {calibration.state.plane: Corrections.of(calibration)}
    observed = observe_session(session, without, report, corrections)
    warnings = mismatch(session.configuration, calibration)
    plane = observed.planes[calibration.state.plane]
    observations = [observation for group in plane.patches.values() for observation in group]
    result = verify(calibration, observations, plane.darks, observed.readings)
    return replace(result, findings=(*result.findings, *warnings))
