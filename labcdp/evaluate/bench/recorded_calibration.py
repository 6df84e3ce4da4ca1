"""A calibration from recorded sessions, with vignetting by a flat field or by the lens."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ...calibration import AnyCalibration
from ...calibration.response.curve import MIN_EXPOSURES, ResponseCurve, response_from_bracket
from ...core.errors import CalibrationError
from ...core.finding import unique, warning
from ...core.frame import Frame
from ...core.response import Response
from ...core.vignetting import AnyVignetting
from ...session import FrameRecord, MeterCertificate, Session
from .calibrate import calibrate_session
from .corrections import Corrections, PlaneCorrections, UniformLight, corrections_of_lens, with_dark_frames
from .observe import ObservedSession, observe_session
from .recorded import Report, by_exposure, by_patch


def response_of_session(session: Session, observed: ObservedSession) -> ResponseCurve:
    """Find the response from a session's light frames, a bracket of the target that stood still.

    Where patches were shown one by one, their frames are laid side by side.

    Parameters
    ----------
    session : Session
        To read the frames from; of a monochrome sensor.
    observed : ObservedSession
        What `observe_session` returned for it, for the dark signal.

    Raises
    ------
    CalibrationError
        If the sensor has colour filters, the session has too few exposures, or as `response_from_bracket`.
    SessionError
        If a file is missing or altered.
    """
    darks = observed.darks  # refuses colour filters
    groups = by_exposure(session, "light")
    if len(groups) < MIN_EXPOSURES:
        there = ", ".join(f"{1e3 * t:g} ms" for t in groups)
        raise CalibrationError(
            f"the session has light frames at {len(groups)} exposure{'s' if len(groups) > 1 else ''} ({there}): the "
            f"response by a bracket needs {MIN_EXPOSURES} or more; record more exposures, a factor of 1.5 to 2.5 apart"
        )
    frames = [frame for records in groups.values() for frame in _scenes(session, records)]
    return response_from_bracket(frames, float(np.mean([dark.mean_dn for dark in darks])))


def _scenes(session: Session, records: Sequence[FrameRecord]) -> list[Frame]:
    """Frames of all that was shown at one exposure."""
    shown = [[session.load(record) for record in group] for group in by_patch(records).values()]
    together = zip(*shown, strict=False)  # as many as there are of each
    return [parts[0].with_pixels(np.concatenate([part.dn for part in parts])) for parts in together]


#: Most rounds in which the flat field is linearised by the response, and the response fitted with the flat field.
_MOST_ROUNDS = 5
#: Largest relative change of the vignetting in the last round.
_SETTLED_REL = 1e-3
#: Result: a calibration, and what the first session was observed as.
_Found: TypeAlias = "tuple[AnyCalibration, ObservedSession]"
#: The result, None if only the responses were asked for, and the responses by colour plane.
_Round: TypeAlias = "tuple[_Found | None, Mapping[str | None, Response]]"


def calibrate_recorded(
    sessions: Sequence[Session],
    uniform: UniformLight | None = None,
    *,
    without: Sequence[str] = (),
    held_out: Collection[str] = (),
    bracket: bool = False,
    certificate: MeterCertificate | None = None,
    report: Callable[[str], Report] = lambda _what: lambda _done, _total: None,
) -> tuple[AnyCalibration, ObservedSession]:
    """Calibrate a camera from recorded sessions.

    The flat field of a camera with a curved response must be linearised: both are found in turns.

    Parameters
    ----------
    sessions : sequence of Session
        Of one camera and lens; the first one's gain is the calibration's own.
    uniform : UniformLight or None
        Frames of a uniform source; None for natural vignetting by the configured lens.
    without, held_out : sequence of str, collection of str
        Patches of the first session to leave out, and those that the fit is tested with.
    bracket : bool
        Whether to find the response from the exposures as a bracket, instead of fitting it to the patches.
    certificate : MeterCertificate or None
        Of the meter, in the place of those in the sessions' configurations.
    report : callable
        Returns, for what is read, a function that is called with the number of items read, and of all.

    Returns
    -------
    Calibration or ColourCalibration, ObservedSession
        The calibration, and the first session with its corrections.

    Raises
    ------
    CalibrationError, SessionError, InputError
        As `measure_vignetting`, `observe_session`, `response_of_session` and `calibrate_session`.
    """
    lens = corrections_of_lens(sessions[0])
    corrections = with_dark_frames(lens if uniform is None else uniform.corrections, sessions, report("dark frames"))

    def calibrated(own: PlaneCorrections, first: bool = False) -> _Round:
        observed = [
            observe_session(one, [] if number else without, report("reading"), own, certificate)
            for number, one in enumerate(sessions)
        ]
        curve = response_of_session(sessions[0], observed[0]) if bracket else None
        if first and curve is not None:
            # The response of a bracket does not depend on the vignetting.
            return None, {None: curve.response}
        calibration = calibrate_session(*observed, held_out=held_out, response=curve)
        return (calibration, observed[0]), _responses(calibration)

    if uniform is None:
        found = calibrated(corrections)[0]
        assert found is not None
        return found
    return _with_flat_field(uniform, corrections, lens, calibrated)


def _with_flat_field(
    uniform: UniformLight, corrections: PlaneCorrections, lens: PlaneCorrections, calibrated: Callable[..., _Round]
) -> _Found:
    try:
        found, responses = calibrated(corrections, first=True)
    except CalibrationError:
        # Of a camera with a tone curve the flat field itself may be so wrong that nothing fits.
        natural = {plane: replace(own, vignetting=lens[plane].vignetting) for plane, own in corrections.items()}
        found, responses = None, calibrated(natural)[1]
        if all(response.kind == "linear" for response in responses.values()):
            raise
    for _ in range(_MOST_ROUNDS):
        if found is not None and all(response.kind == "linear" for response in responses.values()):
            return found
        linearised = uniform.linearised(responses)
        change = max(_change(corrections[plane], linearised[plane], uniform) for plane in corrections)
        if found is not None and change <= _SETTLED_REL:
            return found
        corrections = {plane: replace(own, vignetting=linearised[plane]) for plane, own in corrections.items()}
        found, responses = calibrated(corrections)
    assert found is not None
    calibration, observed = found
    unsettled = warning("flat-field-not-settled", change_rel=change)
    return replace(calibration, findings=unique([*calibration.findings, unsettled])), observed


def _responses(calibration: AnyCalibration) -> dict[str | None, Response]:
    return {plane.state.plane: plane.response for plane in calibration.planes}


def _change(before: Corrections, vignetting: AnyVignetting, uniform: UniformLight) -> float:
    """Largest relative change of the vignetting at a typical pixel of a region: its 99th percentile."""
    assert before.vignetting is not None
    old, new = (one.relative_illuminance(uniform.shape) for one in (before.vignetting, vignetting))
    return float(np.quantile(np.abs(new / old - 1), 0.99))
