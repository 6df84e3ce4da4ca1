"""Verification of a calibration from a recorded session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..calibration import AnyCalibration, Calibration, PatchObservation
from ..calibration.verification import Verification
from ..calibration.verify import verify
from ..calibration.verify_colour import verify_colour
from ..errors import InputError
from ..session import Session
from .corrections import corrections_of
from .observe import ObservedPlane, ObservedSession, observe_session
from .recorded import Report
from .session import mismatch


def verify_session(
    session: Session,
    calibration: AnyCalibration,
    patches: Sequence[str] = (),
    report: Report = lambda _done, _total: None,
) -> Verification:
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

    Raises
    ------
    CalibrationError
        As `labcdp.calibration.verify.verify` or `verify_colour`, and if the lens is another.
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
    observed = observe_session(session, without, report, corrections_of(calibration))
    warnings = mismatch(session.configuration, calibration)
    if observed.input_sha256 == calibration.provenance.input_sha256:
        warnings.append(
            "the calibration was made of this very session, so they agree whatever the camera does now: measure again"
        )
    result = _verified(observed, calibration)
    return replace(result, findings=(*result.findings, *warnings))


def _verified(observed: ObservedSession, calibration: AnyCalibration) -> Verification:
    if isinstance(calibration, Calibration):
        plane = observed.planes[calibration.state.plane]
        return verify(calibration, _observations(plane), plane.darks, observed.readings)
    planes = {name: plane for name, plane in observed.planes.items() if name is not None}
    return verify_colour(
        calibration,
        {name: _observations(plane) for name, plane in planes.items()},
        {name: plane.darks for name, plane in planes.items()},
        observed.readings,
    )


def _observations(plane: ObservedPlane) -> list[PatchObservation]:
    return [observation for group in plane.patches.values() for observation in group]
