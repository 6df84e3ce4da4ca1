"""A calibration from recorded sessions."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence
from dataclasses import replace

from ...calibration import AnyCalibration, Calibration, DarkObservation, PatchObservation, Setup, fit, fit_colour
from ...calibration.response.curve import ResponseCurve
from ...calibration.signal import left_out_text
from ...core.errors import CalibrationError
from ...core.finding import unique
from ...core.spectral.mismatch import Source
from ...core.spectral.table import SpectralTable
from ...session import SessionConfiguration
from .observe import ObservedPlane, ObservedSession
from .recorded import lens_of, require_patches


def calibrate_session(
    observed: ObservedSession,
    *more: ObservedSession,
    held_out: Collection[str] = (),
    response: ResponseCurve | None = None,
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
        Shape of the response by a bracket, for a monochrome sensor; see `response_of_session`.

    Raises
    ------
    CalibrationError
        As `labcdp.calibration.fit` and `fit_colour`; if lenses, spectra or corrections of the sessions differ; and if a
        patch of the target cannot be used at any exposure: it must be excluded by name.
    InputError
        If a held-out patch is not known.
    """
    sessions = [observed, *(_renamed(other, f"{number}") for number, other in enumerate(more, start=2))]
    names = [name for one in sessions for name in one.names]
    require_patches(held_out, names, "to hold out")
    for other in sessions[1:]:
        _require_alike(observed, other)
    setup = Setup(
        lens=lens_of(observed.configuration),
        source_spectrum=observed.configuration.source.spectrum,
        input_sha256=_joined_sha256(sessions),
        measured_spectrum=observed.configuration.source.measured,
        sessions_sha256=tuple(one.input_sha256 for one in sessions) if more else (),
        certificate=observed.configuration.meter.certificate,
        meter_f1_prime=observed.configuration.meter.f1_prime,
    )
    calibration = _fit(sessions, setup, held_out, response)
    _require_all_used(calibration, sessions)
    of_corrections = [
        finding if plane is None else finding.within(f"plane {plane}")
        for plane, seen in observed.planes.items()
        for finding in seen.corrections.findings
    ]
    return replace(calibration, findings=unique([*calibration.findings, *of_corrections]))


def _fit(
    sessions: Sequence[ObservedSession], setup: Setup, held_out: Collection[str], response: ResponseCurve | None
) -> AnyCalibration:
    readings = {patch: group for one in sessions for patch, group in one.readings.items()}
    corrections = {plane: seen.corrections for plane, seen in sessions[0].planes.items()}
    if None in corrections:
        return fit(
            _observations(sessions, None),
            _darks(sessions, None),
            readings,
            setup,
            held_out=held_out,
            defects=corrections[None].defects,
            dark_library=corrections[None].dark_library,
            response=response,
        )
    if response is not None:
        raise CalibrationError(
            "the session was recorded with colour filters: a response by a bracket is for monochrome frames; leave it "
            "out, raw data of a camera are linear"
        )
    configuration = sessions[0].configuration
    sensitivity = configuration.camera.spectral_sensitivity
    planes = [plane for plane in corrections if plane is not None]
    return fit_colour(
        {plane: _observations(sessions, plane) for plane in planes},
        {plane: _darks(sessions, plane) for plane in planes},
        readings,
        setup,
        sensitivities=None if sensitivity is None else sensitivity.spectra,
        held_out=held_out,
        defects={plane: corrections[plane].defects for plane in planes},
        dark_libraries={plane: corrections[plane].dark_library for plane in planes},
    )


def _observations(sessions: Sequence[ObservedSession], plane: str | None) -> list[PatchObservation]:
    return [o for one in sessions for group in one.planes[plane].patches.values() for o in group]


def _darks(sessions: Sequence[ObservedSession], plane: str | None) -> list[DarkObservation]:
    return [dark for one in sessions for dark in one.planes[plane].darks]


def _renamed(observed: ObservedSession, number: str) -> ObservedSession:
    """Distinguish the patches of a further session from those of the first."""

    def name(patch: str) -> str:
        return f"{patch} ({number})"

    return replace(
        observed,
        planes={
            plane: ObservedPlane(
                {name(p): [replace(o, patch=name(p)) for o in group] for p, group in seen.patches.items()},
                seen.darks,
                seen.corrections,
            )
            for plane, seen in observed.planes.items()
        },
        readings={name(patch): group for patch, group in observed.readings.items()},
    )


def _require_alike(first: ObservedSession, other: ObservedSession) -> None:
    for what, mine, theirs in (
        ("colour filter", _filter_text(first), _filter_text(other)),
        ("lens", lens_of(first.configuration), lens_of(other.configuration)),
        ("certificate of the meter", _certificate_text(first), _certificate_text(other)),
        ("source spectrum", first.configuration.source.spectrum, other.configuration.source.spectrum),
    ):
        if mine != theirs:
            raise CalibrationError(
                f"the {what} of session {first.configuration.name!r} is {mine}, that of {other.configuration.name!r} "
                f"{theirs}: calibrate them apart"
            )
    one, two = first.configuration, other.configuration
    if _spectra(one) != _spectra(two):
        raise CalibrationError(
            f"sessions {one.name!r} and {two.name!r} have different measured spectra of the light "
            f"{one.source.spectrum!r} or of the camera: calibrate them apart, or give both the same files"
        )


def _spectra(configuration: SessionConfiguration) -> tuple[Source, dict[str, SpectralTable] | None]:
    """Light and sensitivity of the camera, as measured if they were; their files' names do not matter."""
    sensitivity = configuration.camera.spectral_sensitivity
    return configuration.source.light, None if sensitivity is None else sensitivity.spectra


def _certificate_text(observed: ObservedSession) -> str:
    certificate = observed.configuration.meter.certificate
    return "none" if certificate is None else f"{certificate.number} of {certificate.date}"


def _filter_text(observed: ObservedSession) -> str:
    return "none" if None in observed.planes else "Bayer"


def _joined_sha256(sessions: Sequence[ObservedSession]) -> str:
    if len(sessions) == 1:
        return sessions[0].input_sha256
    return hashlib.sha256("".join(one.input_sha256 for one in sessions).encode()).hexdigest()


def _require_all_used(calibration: AnyCalibration, sessions: Sequence[ObservedSession]) -> None:
    """Refuse a patch that was never seen or read well; one whose readings contradict all others is only named."""
    known = {row.patch for row in (*calibration.residuals, *calibration.held_out)}
    for one in sessions:
        for name in one.names:
            if name not in known and _useless(name, calibration, one):
                left_out = [left for left in calibration.left_out if left.patch == name]
                unread = all(reading.value == 0 for reading in one.readings.get(name, ()))
                what = "cannot be used" if unread else "cannot be used at any exposure"
                remedy = "" if unread else "acquire it with other exposures, or "
                raise CalibrationError(
                    f"patch {name!r} {what} ({left_out_text(left_out)}): {remedy}leave it out with --without {name!r}"
                )


def _useless(name: str, calibration: AnyCalibration, observed: ObservedSession) -> bool:
    if not isinstance(calibration, Calibration):
        return True
    left_out = {(left.patch, left.exposure_s) for left in calibration.left_out}
    unseen = all((name, o.exposure_s) in left_out for o in observed.patches[name])
    return unseen or all(reading.value == 0 for reading in observed.readings.get(name, ()))
