"""A calibration in another session: dark signal and light as the frames of that session show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import hypot, sqrt

import numpy as np

from ..core.result import Finding, info, warning
from .agreement import with_agreement
from .colour.conversion import ByPlane
from .colour.model import AnyCalibration
from .fit_records import DISAGREEING, FLICKERING_NOW, SETTLING, FitError, undecided_cause
from .fitting.design import DARK
from .frames.observations import DarkObservation, PatchObservation
from .model import Calibration
from .sensor.dark import DarkModel, fit_dark
from .sensor.dark_fit import as_rows, black_level_drift
from .sensor.noise import GainSetting, TemporalNoise, few_frames, first_frames, light_flicker
from .uncertainty import FALSE_ALARM, SMALL_EFFECT_REL, Scatter, critical_value

#: Least change of the dark signal, in DN, and least flicker of the light that are reported.
_REPORTED_DN, _REPORTED_FLICKER_REL = 0.1, 0.002


def in_session(
    calibration: AnyCalibration, observations: ByPlane[PatchObservation], darks: ByPlane[DarkObservation]
) -> tuple[AnyCalibration, list[Finding]]:
    """Return a calibration with dark signal, black level's drift and flicker of the light of another session.

    Its responsivity and response stay, with the errors that the calibration's dark frames have left in them.

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        Of the camera.
    observations, darks : mapping of (str or None) to sequence
        Of the session, by colour plane.

    Returns
    -------
    Calibration or ColourCalibration
        For frames of that session.
    list of Finding
        What differs from the calibration.
    """
    done = []
    for plane in calibration.planes:
        name = plane.state.plane
        converter, plane_findings = _plane_in_session(plane, observations.get(name, ()), darks.get(name, ()))
        done.append(
            (
                converter,
                plane_findings if name is None else [finding.within(f"plane {name}") for finding in plane_findings],
            )
        )
    findings = [finding for _, plane_findings in done for finding in plane_findings]
    if isinstance(calibration, Calibration):
        return done[0][0], findings
    return replace(calibration, planes=tuple(converter for converter, _ in done)), findings


def other_conditions_findings(calibration: AnyCalibration) -> list[Finding]:
    """Say that a calibration is of another day or temperature than what it converts, where that counts."""
    plane, findings = calibration.planes[0], list[Finding]()
    if plane.of_another_day and plane.lens.stability_rel:
        measured = f"{calibration.provenance.measured:%Y-%m-%d}"
        findings.append(info("calibration-of-another-day", measured=measured, stability_rel=plane.lens.stability_rel))
    by_temperature_rel = sqrt(max(plane.stability_rel**2 - replace(plane, warmer_k=0.0).stability_rel ** 2, 0.0))
    if by_temperature_rel > SMALL_EFFECT_REL:
        shown = {"warmer_k": plane.warmer_k, "stability_rel": by_temperature_rel}
        findings.append(warning("temperature-differs", **shown))
    return findings


def _plane_in_session(
    plane: Calibration, observations: Sequence[PatchObservation], darks: Sequence[DarkObservation]
) -> tuple[Calibration, list[Finding]]:
    settings, errors, findings = [], list(plane.fit_errors), list[Finding]()
    for setting in plane.settings:
        own_darks = [dark for dark in darks if dark.state.has_gain(setting.gain_db)]
        seen = [o for o in observations if o.state.has_gain(setting.gain_db)]
        dark, of_dark = _dark_in_session(setting.dark, own_darks) if own_darks else (setting.dark, [])
        noise, of_light = _noise_in_session(setting.noise, seen, dark)
        settings.append(replace(setting, dark=dark, noise=noise))
        findings += [*of_dark, *of_light]
        if own_darks:
            # What the errors of the calibration's dark signal did to the fit stays.
            errors = [replace(e, dark=()) if e.dark_gain_db == setting.gain_db else e for e in errors]
            errors += [_dark_error(setting, row.tolist()) for row in dark.errors()]
    own_gain, *others = settings
    dark, noise = own_gain.dark, own_gain.noise
    here = replace(plane, fit_errors=tuple(errors), dark=dark, noise=noise, gains=tuple(others))
    done, of_times = with_agreement(here, observations)
    if of_times and any(finding.code == SETTLING[1] for finding in findings):
        of_times = [*of_times, undecided_cause(SETTLING, DISAGREEING)]
    return done, [*findings, *of_times]


def _dark_error(setting: GainSetting, parameters: Sequence[float]) -> FitError:
    return FitError(DARK, (0.0, 1.0), (0.0, 0.0), dark=tuple(parameters), dark_gain_db=setting.gain_db)


def _dark_in_session(known: DarkModel, darks: Sequence[DarkObservation]) -> tuple[DarkModel, list[Finding]]:
    """Return the dark signal that a session's dark frames show: at one exposure its offset only."""
    here = Scatter(*black_level_drift(darks))
    floor_dn = sqrt(float(np.mean([dark.mean_noise_dn2 for dark in darks])))
    drift = _joined(Scatter(known.drift_dn, known.drift_dof), here, floor_dn)
    fitted, findings = fit_dark(darks, drift.size)
    if len(fitted.exposures_s) == 1:
        fitted, findings = _shifted(known, darks, drift), []
    doubling = fitted if fitted.doubling_temperature_c is not None else known
    covariance = np.array(fitted.covariance)
    covariance[2, 2] = np.array(doubling.covariance)[2, 2]
    dark = replace(
        known,
        offset_dn=fitted.offset_dn,
        rate_dn_s=fitted.rate_dn_s,
        covariance=as_rows(covariance),
        temperatures_c=fitted.temperatures_c,
        temperature_c=fitted.temperature_c,
        doubling_temperature_c=doubling.doubling_temperature_c,
        drift_dn=drift.size,
        drift_dof=int(drift.dof),
        # These frames were taken at the temperature of the others.
        unknown_within_k=0.0,
    )
    return dark, [*findings, *_changes(known, darks, drift)]


def _shifted(known: DarkModel, darks: Sequence[DarkObservation], drift: Scatter) -> DarkModel:
    """Return a known dark signal with the offset that dark frames at one exposure show."""
    expected = [known.mean_dn(dark.exposure_s, dark.temperature_c) for dark in darks]
    shift_dn = float(np.mean([dark.mean_dn for dark in darks]) - np.mean(expected))
    u_dn2 = float(np.mean([_variance_of_mean_dn2(dark, drift) for dark in darks])) / len(darks)
    by_parameters = np.mean([known.sensitivities(dark.exposure_s, dark.temperature_c) for dark in darks], axis=0)
    # The offset follows from what the other two parameters leave.
    turned = np.eye(3)
    turned[0] -= by_parameters
    covariance = turned @ np.array(known.covariance) @ turned.T + np.diag([u_dn2, 0.0, 0.0])
    return replace(known, offset_dn=known.offset_dn + shift_dn, covariance=as_rows(covariance))


def _variance_of_mean_dn2(dark: DarkObservation, drift: Scatter) -> float:
    return (dark.mean_noise_dn2 + drift.size**2) / dark.n_frames + dark.rounding_dn2


def _changes(known: DarkModel, darks: Sequence[DarkObservation], drift: Scatter) -> list[Finding]:
    """Report the largest significant difference between dark frames and the calibration's dark signal."""
    rows = []
    for dark in darks:
        expected_dn = known.mean_dn(dark.exposure_s, dark.temperature_c)
        of_model = known.variance_dn2(dark.exposure_s, dark.temperature_c)
        u_dn = max(sqrt(of_model + _variance_of_mean_dn2(dark, drift)), 1e-9)
        rows.append((dark.mean_dn - expected_dn, u_dn, dark.exposure_s))
    difference_dn, u_dn, exposure_s = max(rows, key=lambda row: abs(row[0]) / row[1])
    if abs(difference_dn) <= max(critical_value(len(rows)) * u_dn, _REPORTED_DN):
        return []
    return [warning("dark-changed", difference_dn=difference_dn, exposure_s=exposure_s)]


def _noise_in_session(
    known: TemporalNoise, observations: Sequence[PatchObservation], dark: DarkModel
) -> tuple[TemporalNoise, list[Finding]]:
    """Return the noise with the flicker of a session's light."""
    light = light_flicker(observations, dark)
    there, here = Scatter(known.flicker_rel, known.flicker_dof), Scatter(light.flicker_rel, light.dof)
    joined = _joined(there, here, light.noise_rel)
    flicker = here if light.dof and (light.by_exposure or known.flickers) else joined
    flickers = light.by_exposure if light.dof else known.flickers
    noise = replace(known, flicker_rel=flicker.size, flicker_dof=int(flicker.dof), flickers=flickers)
    changed = joined == here and here.size > max(there.size, _REPORTED_FLICKER_REL)
    of_flicker = [warning("flicker-changed", flicker_rel=here.size, before_rel=there.size)] if changed else []
    firsts = first_frames(observations, dark)
    if not firsts:
        return noise, of_flicker
    if changed and few_frames(firsts[0]):
        return noise, [*firsts, *of_flicker, undecided_cause(SETTLING, FLICKERING_NOW)]
    return noise, firsts


def _joined(there: Scatter, here: Scatter, floor: float) -> Scatter:
    """Join two standard deviations, of which those below a floor are alike; of different ones return the second.

    They differ if the ratio of their variances is improbable (F test); 0 degrees of freedom stand for one that is
    known, or that nothing says anything about.
    """
    from scipy.special import fdtr, fdtrc

    if not here.dof:
        return there
    if not there.dof:
        return here
    ratio = (here.size**2 + floor**2) / (there.size**2 + floor**2)
    p_value = 2 * min(fdtrc(here.dof, there.dof, ratio), fdtr(here.dof, there.dof, ratio))
    if p_value < FALSE_ALARM:
        return here
    dof = there.dof + here.dof
    return Scatter(hypot(there.size * sqrt(there.dof / dof), here.size * sqrt(here.dof / dof)), dof)
