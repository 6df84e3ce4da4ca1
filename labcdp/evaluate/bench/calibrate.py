"""A calibration from recorded sessions, with vignetting by a flat field or by the lens."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from ...calibration import AnyCalibration, Calibration, PatchLuminance, Setup, fit, fit_colour
from ...calibration.colour.conversion import luminance_of_planes
from ...calibration.fitting.residuals import measured_rows
from ...calibration.sensor.response import ResponseCurve
from ...calibration.signal import left_out_text
from ...core.errors import CalibrationError
from ...core.result import unique, warning
from ...core.vignetting import AnyVignetting
from ...session import MeterCertificate, Session, SessionConfiguration
from .corrections import (
    Corrections,
    PlaneCorrections,
    UniformLight,
    calibration_corrections,
    lens_corrections,
    with_dark_frames,
)
from .observe import ObservedSession, observe_session, session_response
from .recorded import Report, configured_lens, lens_findings, planes_of, require_distinct, require_patches

#: Most rounds in which the flat field is linearised by the response, and the response fitted with the flat field.
_MOST_ROUNDS = 5
#: Largest relative change of the vignetting in the last round.
_SETTLED_REL = 1e-3


def calibrate_session(
    observed: ObservedSession,
    *more: ObservedSession,
    held_out: Collection[str] = (),
    response: ResponseCurve | None = None,
    all_used: bool = True,
) -> AnyCalibration:
    """Calibrate a camera from what sessions say; one with colour filters plane by plane, and their combination.

    Parameters
    ----------
    observed : ObservedSession
        The session whose gain is the calibration's own.
    *more : ObservedSession
        Of the same camera and lens, with other gains, at other temperatures or with other patches. A patch of a later
        session is another patch, whatever its name, and has its own readings.
    held_out : collection of str
        Patches that the fit is not shown, but tested with.
    response : ResponseCurve or None
        Shape of the response by a bracket, for a monochrome sensor; see `session_response`.
    all_used : bool
        Whether a patch that no exposure shows is refused; else the others calibrate alone.

    Raises
    ------
    CalibrationError
        As `labcdp.calibration.fit` and `fit_colour`; if lenses, spectra or corrections of the sessions differ; and if a
        patch of the target cannot be used at any exposure: it must be excluded by name.
    InputError
        If a held-out patch is not known.
    """
    for other in more:
        _require_alike(observed, other)
    joined = _joined([observed, *more])
    require_patches(held_out, joined.names, "to hold out")
    hashes, bench = tuple(session.input_sha256 for session in (observed, *more)), observed.configuration
    setup = replace(
        session_setup(bench, hashlib.sha256("".join(hashes).encode()).hexdigest() if more else hashes[0]),
        sessions_sha256=hashes if more else (),
        frames_sha256=tuple(sorted({key for session in (observed, *more) for key in session.frames_sha256})),
    )
    calibration = _fit(joined, setup, held_out, response)
    if all_used:
        _require_all_used(calibration, joined)
    of_corrections = [
        finding if plane is None else finding.within(f"plane {plane}")
        for plane, correction in observed.corrections.items()
        for finding in correction.findings
    ]
    lenses = [configured_lens(session.configuration) for session in (observed, *more)]
    of_lens = [finding for lens in lenses[1:] for finding in lens_findings(lenses[0], lens)]
    return replace(calibration, findings=unique([*calibration.findings, *of_corrections, *of_lens]))


def session_setup(bench: SessionConfiguration, input_sha256: str) -> Setup:
    """Return what a calibration knows of the bench, as its configuration states it."""
    return Setup(
        lens=configured_lens(bench),
        source_spectrum=bench.source.spectrum,
        input_sha256=input_sha256,
        measured_spectrum=bench.source.measured,
        certificate=bench.meter.certificate,
        meter_f1_prime=bench.meter.f1_prime,
        exposure_jitter_s=bench.camera.exposure_jitter_s,
        black_level_drift_dn=bench.camera.black_level_drift_dn,
    )


def _fit(
    observed: ObservedSession, setup: Setup, held_out: Collection[str], response: ResponseCurve | None
) -> AnyCalibration:
    seen, darks = observed.by_plane, observed.darks_by_plane
    defects = {plane: correction.defects for plane, correction in observed.corrections.items()}
    libraries = {plane: correction.dark_library for plane, correction in observed.corrections.items()}
    if None in observed.corrections:
        return fit(
            seen[None], darks[None], observed.readings, setup,
            held_out=held_out, defects=defects[None], dark_library=libraries[None], response=response,
        )  # fmt: skip
    if response is not None:
        raise CalibrationError(
            "the session was recorded with colour filters: a response by a bracket is for monochrome frames; leave it "
            "out, raw data of a camera are linear"
        )
    sensitivity = observed.configuration.camera.spectral_sensitivity
    spectra = None if sensitivity is None else sensitivity.spectra
    return fit_colour(
        seen, darks, observed.readings, setup,
        sensitivities=spectra, held_out=held_out, defects=defects, dark_libraries=libraries,
    )  # fmt: skip


def _joined(sessions: Sequence[ObservedSession]) -> ObservedSession:
    """Return the first session with the patches of all; those of others have the session's number in their names."""

    def named(patch: str, number: int) -> str:
        return patch if number == 1 else f"{patch} ({number})"

    numbered = list(enumerate(sessions, start=1))
    patches = {
        plane: {
            named(patch, n): [replace(o, patch=named(patch, n)) for o in group]
            for n, session in numbered
            for patch, group in session.patches_by_plane[plane].items()
        }
        for plane in sessions[0].corrections
    }
    darks = {plane: [dark for session in sessions for dark in session.darks_by_plane[plane]] for plane in patches}
    readings = {named(patch, n): group for n, session in numbered for patch, group in session.readings.items()}
    return replace(sessions[0], patches_by_plane=patches, darks_by_plane=darks, readings=readings)


def _require_alike(first: ObservedSession, other: ObservedSession) -> None:
    setup, other_setup = first.configuration, other.configuration
    lens = configured_lens(setup)
    certificates = (each.meter.certificate for each in (setup, other_setup))
    for what, mine, theirs in (
        ("lens", lens, lens if configured_lens(other_setup).is_as_in(lens) else configured_lens(other_setup)),
        ("certificate of the meter", *("none" if c is None else f"{c.number} of {c.date}" for c in certificates)),
        ("source spectrum", setup.source.spectrum, other_setup.source.spectrum),
    ):
        if mine != theirs:
            raise CalibrationError(
                f"the {what} of session {setup.name!r} is {mine or 'none'}, that of {other_setup.name!r} "
                f"{theirs or 'none'}: calibrate them separately"
            )
    # Light and sensitivity of the camera, as measured if they were; their files' names do not matter.
    sensitivities = [
        each.camera.spectral_sensitivity and each.camera.spectral_sensitivity.spectra for each in (setup, other_setup)
    ]
    if setup.source.light != other_setup.source.light or sensitivities[0] != sensitivities[1]:
        raise CalibrationError(
            f"sessions {setup.name!r} and {other_setup.name!r} have different measured spectra of the light "
            f"{setup.source.spectrum!r} or of the camera: calibrate them separately, or give both the same files"
        )


def _require_all_used(calibration: AnyCalibration, observed: ObservedSession) -> None:
    """Refuse a patch that was never seen or read well; one whose readings contradict all others is only named."""
    known = {row.patch for row in (*calibration.residuals, *calibration.held_out)}
    exposures = {(left.patch, left.exposure_s) for left in calibration.left_out}
    for name in observed.names:
        unread = all(reading.value == 0 for reading in observed.readings.get(name, ()))
        seen = isinstance(calibration, Calibration) and any(
            (name, o.exposure_s) not in exposures for o in observed.patches[name]
        )
        if name not in known and (unread or not seen):
            left_out = left_out_text([left for left in calibration.left_out if left.patch == name])
            what, remedy = ("", "") if unread else (" at any exposure", "acquire it with other exposures, or ")
            raise CalibrationError(f"patch {name!r} cannot be used{what} ({left_out}): {remedy}leave it out")


def calibrate_recorded(
    sessions: Sequence[Session],
    uniform: UniformLight | None = None,
    *,
    without: Sequence[str] = (),
    held_out: Collection[str] = (),
    bracket: bool = False,
    certificate: MeterCertificate | None = None,
    report: Callable[[str], Report] = lambda _what: lambda _done, _total: None,
) -> tuple[list[ObservedSession], AnyCalibration]:
    """Calibrate a camera from recorded sessions.

    Each frame is loaded once, those of a bracket again for its curve. The flat field of a camera with a curved
    response must be linearised: both are found in turns.

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
    list of ObservedSession, Calibration or ColourCalibration
        The sessions with the corrections of the calibration, and the calibration.

    Raises
    ------
    CalibrationError, SessionError, InputError
        As `require_distinct`, `measure_vignetting`, `observe_session`, `session_response` and `calibrate_session`.
    """
    if len({planes_of(session) for session in sessions}) > 1:
        raise CalibrationError("some of the sessions have colour filters, others have none: calibrate them separately")
    require_distinct(sessions)
    lens = lens_corrections(sessions[0])
    given = lens if uniform is None else uniform.corrections
    corrections, darks = with_dark_frames(given, sessions, report("dark frames"))
    observed = [
        observe_session(
            session,
            [] if number else without,
            report("reading"),
            corrections,
            certificate,
            darks=darks[number],
            keep_regions=True,
        )
        for number, session in enumerate(sessions)
    ]

    def calibrated(corrections_now: PlaneCorrections) -> AnyCalibration:
        seen = [session.with_vignetting(corrections_now) for session in observed]
        return _calibrated(seen, held_out, bracket)

    if uniform is None:
        calibration = _calibrated(observed, held_out, bracket)
    else:
        calibration = _in_turns(calibrated, corrections, lens, uniform)
    final = calibration_corrections(calibration)
    done = [replace(session.with_vignetting(final), regions_by_plane={}) for session in observed]
    return done, _measured(calibration, _joined(done))


def _measured(calibration: AnyCalibration, observed: ObservedSession) -> AnyCalibration:
    """Return a calibration with the luminances of its patches as an evaluation of the session has them."""
    in_use = calibration.at_their_temperature()

    def measure(patch: str) -> PatchLuminance:
        return luminance_of_planes(in_use, {plane: seen[patch] for plane, seen in observed.patches_by_plane.items()})

    rows, held_out = (
        measured_rows(group, measure, observed.by_meter, observed.meter_scale)
        for group in (calibration.residuals, calibration.held_out)
    )
    return replace(calibration, residuals=rows, held_out=held_out)


def _calibrated(observed: Sequence[ObservedSession], held_out: Collection[str], bracket: bool) -> AnyCalibration:
    curve = session_response(observed[0]) if bracket else None
    return calibrate_session(*observed, held_out=held_out, response=curve)


def _in_turns(
    calibrated: Callable[[PlaneCorrections], AnyCalibration],
    corrections: PlaneCorrections,
    lens: PlaneCorrections,
    uniform: UniformLight,
) -> AnyCalibration:
    """Linearise the flat field by the response and calibrate anew, until the flat field settles."""
    try:
        calibration = calibrated(corrections)
    except CalibrationError:
        # Of a camera with a tone curve the flat field itself may be so wrong that nothing fits.
        corrections = {
            plane: replace(correction, vignetting=lens[plane].vignetting) for plane, correction in corrections.items()
        }
        calibration = calibrated(corrections)
        if _is_linear(calibration):
            raise
    change = inf
    for _ in range(_MOST_ROUNDS):
        if _is_linear(calibration):
            return calibration
        linearised = uniform.linearised({plane.state.plane: plane.response for plane in calibration.planes})
        change = max(_change(corrections[plane], linearised[plane], uniform) for plane in corrections)
        if change <= _SETTLED_REL:
            return calibration
        corrections = {
            plane: replace(correction, vignetting=linearised[plane]) for plane, correction in corrections.items()
        }
        calibration = calibrated(corrections)
    unsettled = warning("flat-field-not-settled", change_rel=change)
    return replace(calibration, findings=unique([*calibration.findings, unsettled]))


def _is_linear(calibration: AnyCalibration) -> bool:
    return all(plane.response.kind == "linear" for plane in calibration.planes)


def _change(before: Corrections, vignetting: AnyVignetting, uniform: UniformLight) -> float:
    """Largest relative change of the vignetting at a typical pixel of a region: its 99th percentile."""
    assert before.vignetting is not None
    old, new = (v.relative_illuminance(uniform.shape) for v in (before.vignetting, vignetting))
    return float(np.quantile(np.abs(new / old - 1), 0.99))
