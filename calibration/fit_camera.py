"""Calibration of a camera against a luminance meter."""

from __future__ import annotations

import logging
import platform
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import cache, partial
from importlib.metadata import version
from math import hypot, sqrt
from statistics import fmean

import numpy as np

from ..core.errors import CalibrationError
from ..core.result import Finding, log_findings
from ..core.vignetting import AnyVignetting
from .camera import INTERCEPT, VIGNETTING
from .convert.patch import PatchLuminance, patch_luminance
from .exposure_times import ExposureTimes
from .fit_records import FitTest, ResponsivityFit, summarised
from .fitting import checks
from .fitting.assumed_vignetting import seen_vignetting, vignetting_after, with_wider_vignetting
from .fitting.candidates import CandidateModel, candidate_models
from .fitting.curve_check import better_curve, curve_findings
from .fitting.demands import design_findings, fit_findings, require_every_gain, require_monotone, require_span
from .fitting.design import DRIFT, Design, SharedError
from .fitting.effects import FREE
from .fitting.exposures import NO_MODEL, with_times
from .fitting.intake import Intake, take_in, take_usable
from .fitting.problem import Solution, solve
from .fitting.residuals import finite, fit_errors, fitted_rows, held_out_rows, measured_rows, next_response_error
from .fitting.scatter import fit_dof, patch_scatter, with_scatter
from .fitting.selection import ModelSelection, select, select_model, with_effects
from .frames.defects import DefectMap
from .frames.observations import DarkObservation, Groups, PatchObservation
from .model import Calibration, luminance_range
from .readings import combine_patches
from .sensor.dark_library import DarkLibrary
from .sensor.noise import GainSetting
from .sensor.response import ResponseCurve
from .setup import Provenance, Readings, Setup, meter_scale
from .tolerance import useless_calibration_findings

_log = logging.getLogger(__name__)

#: Standard uncertainties of the vignetting beyond which deviations of the patches with their place are not explained by
#: it.
_BEYOND = 3.0
#: Effects that are no parameters of the last fit.
_AS_IN_USE = "exposure offset", "exposure", "place"
#: Ratio of the slopes of a response from which it is a tone curve, with the sensor's noise before it.
_TONE_CURVE = 1.5


def fit(
    observations: Sequence[PatchObservation],
    darks: Sequence[DarkObservation],
    readings: Readings,
    setup: Setup,
    *,
    held_out: Collection[str] = (),
    defects: DefectMap | None = None,
    dark_library: DarkLibrary | None = None,
    response: ResponseCurve | None = None,
) -> Calibration:
    """Calibrate a camera.

    Dark frames fix d(t, T). All observations, patch by exposure by gain, are fitted at once by h(DN - d) = R f t V
    L with errors in both variables (`labcdp.calibration.fitting.problem.solve`). The meter's scale error is not part of
    the fit (a consistently wrong unit of the meter cannot be detected). h is selected by leave-one-out errors, or
    that of a bracket, which the patches then scale. With a tone curve all is fitted twice, at last with its noise.
    A single bad reading is left out; the model's assumptions are checked.

    Parameters
    ----------
    observations : sequence of PatchObservation
        From `observe_patches`. The gain of the first is the calibration's own; others get a factor.
    darks : sequence of DarkObservation
        From `observe_dark`, for each gain, best with the shortest and longest exposure.
    readings : mapping of str to sequence of Reading
        The meter's readings by the name of the patch.
    setup : Setup
        Lens, spectrum, and hash of the input.
    held_out : collection of str
        Patches held out of the fit for validation.
    defects, dark_library : DefectMap or None, DarkLibrary or None
        Pixels left out, and dark pattern subtracted; stored for later frames.
    response : ResponseCurve or None
        Shape of the response, from a bracket of exposures (`response_from_bracket`); None to fit it to the patches.

    Raises
    ------
    CalibrationError
        If patches and readings do not match, cameras, settings or meters differ, too few patches are usable, they have
        the same luminance, contradict each other or the response of the bracket, or there is no light.
    InputError
        If a reading is a ratio in %.

    Examples
    --------
    >>> from labcdp.calibration import LensIdentity, Setup, fit, observe_dark, observe_patches
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> regions = [patch.region() for patch in session.configuration.target.patches]
    >>> def frames(role, exposure_s):
    ...     return [session.load(r) for r in session.frames(role) if r.exposure_s == exposure_s]
    >>> observations = [o for t in session.exposures_s for o in observe_patches(frames("light", t), regions)]
    >>> darks = [observe_dark(frames("dark", t)) for t in session.exposures_s]
    >>> readings = {r.name: [x.reading for x in session.readings() if x.patch == r.name] for r in regions}
    >>> setup = Setup(LensIdentity("16 mm", "0001", focal_length_m=0.016, f_number=2.8), "D65", input_sha256="4f2a")
    >>> fit(observations, darks, readings, setup).responsivity.responsivity_dn_s_cd_m2 > 0
    True
    """
    take = partial(take_in, observations, darks, readings, held_out, drift_dn=setup.black_level_drift_dn)
    intake = take(tone=None if response is None else response.response)
    better = better_curve(intake.groups, darks, readings)
    try:
        fitted, findings = _fitted(intake, readings, setup, response)
    except CalibrationError as error:
        # Values of another curve rarely fit any response.
        raise error if better is None else better.error() from error
    slopes = fitted.response.slope([0.0, fitted.range_net_dn[1]])
    if response is None and slopes.max() / slopes.min() > _TONE_CURVE:
        # The noise of the pixels depends on the slope.
        intake = take(tone=fitted.response)
        fitted, findings = _fitted(intake, readings, setup, response)
    calibration = replace(fitted, defects=defects, dark_library=dark_library)
    held = {name: group for name, group in intake.groups.items() if name in held_out}
    centres_px = {name: group[0].centre_px for name, group in held.items()}
    measure = _measure(calibration, held)
    rows, of_held_out = held_out_rows(measure, centres_px, readings)
    rows = measured_rows(rows, measure, combine_patches(readings)[0], calibration.meter_scale)
    of_curve = curve_findings(fitted.state, fitted.response, fitted.range_net_dn[1])
    of_curve = [better.finding] if better else of_curve
    findings = [*intake.findings, *of_curve, *findings, *of_held_out, *useless_calibration_findings(calibration)]
    log_findings(_log, findings)
    return replace(calibration, held_out=rows, findings=summarised(findings))


def _measure(calibration: Calibration, groups: Groups) -> Callable[[str], PatchLuminance]:
    """Return what gives the luminance of a patch by the calibration; may raise CalibrationError."""
    in_use = calibration.at_their_temperature()
    return lambda patch: patch_luminance(in_use, groups[patch])


def _fitted(
    intake: Intake, readings: Readings, setup: Setup, response: ResponseCurve | None
) -> tuple[Calibration, list[Finding]]:
    """Fit all patches that are not held out; raises CalibrationError if no model fits them."""
    try:
        return _fitted_if_possible(intake, readings, setup, response)
    except np.linalg.LinAlgError as error:
        raise CalibrationError(NO_MODEL) from error


def _fitted_if_possible(
    intake: Intake, readings: Readings, setup: Setup, response: ResponseCurve | None
) -> tuple[Calibration, list[Finding]]:
    settings = intake.settings
    scale = meter_scale(readings, setup.certificate, setup.meter_f1_prime, setup.source_spectrum)
    given, left_out, given_findings = take_usable(intake, readings, setup.exposure_jitter_s)
    dark_dn = settings[0].dark.mean_dn(given.exposures_s[0])
    require_every_gain(given, settings)
    require_span(given)
    models = candidate_models(given, dark_dn, response)
    # A drift or a vignetting that is taken for granted would explain one that can be seen.
    selection = select(given.without_shared(DRIFT).without_shared(VIGNETTING), models)
    deviating = [row.effect.subject for row in selection.effects if row.effect.kind == "patch"]
    require_monotone(selection.solution, deviating)
    seen = next(iter(intake.groups.values()))[0]
    tests = checks.effect_tests(selection, seen.vignetting, settings[0].dark, intake.findings)
    of_glare = next(test for test in tests if test.name == "glare")
    glare_cd_m2 = checks.possible_glare_cd_m2(of_glare)
    stated, final, times, prior = _final(selection, given, glare_cd_m2, seen.vignetting, models)
    vignetting_error, moved = seen_vignetting(final)
    if stated.chi_squared < 0:  # only numbers without any digits left
        raise CalibrationError(NO_MODEL)
    gains = _gains(final, settings)
    observations = [o for group in intake.groups.values() for o in group]
    known_c = [o.temperature_c for o in observations if o.temperature_c is not None]
    tests = (*tests, checks.scatter(stated), checks.gain(gains, settings[0].gain_db))
    responsivity = replace(
        _responsivity(stated, final, of_glare, times),
        glare_cd_m2=glare_cd_m2,
        dark_offset_dn=abs(selection.size_of("dark signal")),
        dark_rate_dn_s=abs(selection.size_of("dark current")),
        rim_rel=float(np.mean(final.design.rim_rel)),
    )
    step_rel = abs(selection.size_of("step"))
    # A larger one cannot have been the meter's.
    scale = replace(scale, step_rel=step_rel if step_rel <= scale.half_width_rel else 0.0)
    measured = max(reading.timestamp for group in readings.values() for reading in group)
    net_dn = final.design.net_dn
    residuals = fitted_rows(final, intake.groups, moved)
    findings = [
        *scale.findings(readings),
        *given_findings,
        *(() if response is None else response.findings),
        *design_findings(final.design, settings, intake.findings, observations),
        *checks.effect_findings(selection, seen.vignetting),
        *fit_findings(final, tests),
    ]
    calibration = Calibration(
        state=seen.state,
        lens=setup.lens,
        source_spectrum=setup.source_spectrum,
        measured_spectrum=setup.measured_spectrum,
        meter_scale=scale,
        responsivity=responsivity,
        response=final.response[0],
        fit_errors=(*fit_errors(final, vignetting_error.u), *next_response_error(final, models)),
        dark=settings[0].dark,
        noise=settings[0].noise,
        gains=gains,
        vignetting=vignetting_after(prior, vignetting_error),
        defects=None,
        dark_library=None,
        range_cd_m2=luminance_range(residuals, deviating),
        range_net_dn=(float(net_dn.min()), float(net_dn.max())) if response is None else response.range_net_dn,
        exposures_s=tuple(float(v) for v in np.unique(final.design.exposures_s[final.design.exposure])),
        exposure_jitter_s=setup.exposure_jitter_s,
        exposure_times=times,
        light_temperature_c=fmean(known_c) if known_c else None,
        residuals=residuals,
        held_out=(),
        left_out=left_out,
        ladder=tuple(replace(row, chosen=row.kind == final.candidate.kind) for row in selection.ladder),
        tests=tests,
        findings=(),
        provenance=Provenance(
            measured, setup.input_sha256, dict(_versions()), setup.sessions_sha256, setup.frames_sha256
        ),
    )
    measure = _measure(calibration, intake.groups)
    rows = measured_rows(residuals, measure, combine_patches(readings)[0], scale)
    return replace(calibration, residuals=rows, range_cd_m2=luminance_range(rows, deviating)), findings


def _final(
    selection: ModelSelection,
    given: Design,
    glare_cd_m2: float,
    vignetting: AnyVignetting | None,
    models: Sequence[CandidateModel],
) -> tuple[Solution, Solution, ExposureTimes, AnyVignetting | None]:
    """Fit once more with what was found as it is in use, without and with the scatter of what is left.

    Exposure times are corrected. Which side of a step is right is unknown. Where the patches depend on the place in the
    image beyond the stated uncertainty of the vignetting, it is as they show it, which is returned, and what is left of
    it is scatter of patches elsewhere. Glare that they do not exclude is as large as they show it.
    """
    kinds = {fitted.effect.kind for fitted in selection.effects}
    design, times = with_times(given, selection.effects)
    position = next((fitted for fitted in selection.effects if fitted.effect.kind == "place"), None)
    stated_rel = checks.stated_vignetting_rel(given)
    size_rel = 0.0 if position is None else checks.size(position, given)[0]
    beyond = size_rel > _BEYOND * stated_rel
    if beyond and stated_rel:
        design, vignetting = with_wider_vignetting(design, vignetting, FREE * size_rel / stated_rel)
    design = design.without_shared(DRIFT) if "drift" in kinds else design
    errors = [SharedError("step", abs(selection.size_of("step")) / 2 / sqrt(3))]
    if "glare" not in kinds:
        errors.append(SharedError(INTERCEPT, cd_m2=glare_cd_m2 * given.veil))
    known = replace(design, shared=(*design.shared, *errors))
    design = with_effects(known, [fitted for fitted in selection.effects if fitted.effect.kind not in _AS_IN_USE])
    candidate = selection.solution.candidate
    try:
        stated = solve(design, candidate)
    except CalibrationError:
        # Some responses need the effects that are no parameters in use.
        stated, _ = select_model(design, models, [])
        candidate = stated.candidate
    return stated, with_scatter(design, candidate, by_place=beyond), times, vignetting


@cache
def _versions() -> tuple[tuple[str, str], ...]:
    """Versions of the programs; looking them up reads files."""
    return (("python", platform.python_version()), *((name, version(name)) for name in ("labcdp", "numpy", "scipy")))


def _responsivity(first: Solution, final: Solution, glare: FitTest, times: ExposureTimes) -> ResponsivityFit:
    design, responsivity = final.design, final.response[1]
    relative = float(np.sqrt(final.parameter_covariance[0, 0]) / final.parameters[0])
    scatter = patch_scatter(design)
    return ResponsivityFit(
        responsivity_dn_s_cd_m2=responsivity,
        random_rel=hypot(relative, times.either_rel),
        chi_squared=first.chi_squared,
        degrees_of_freedom=first.degrees_of_freedom,
        scatter_rel=scatter.size,
        scatter_dn=design.scatter_each_dn.size,
        intercept_dn_s=glare.value * responsivity if glare.tested else None,
        intercept_standard_uncertainty_dn_s=(glare.standard_uncertainty * responsivity if glare.tested else None),
        dof=finite(fit_dof(final)),
        scatter_dof=finite(scatter.dof),
    )


def _gains(final: Solution, settings: Sequence[GainSetting]) -> tuple[GainSetting, ...]:
    """Return the further gains with their fitted factors."""
    n = final.candidate.n_parameters
    inverse = final.parameters[n:]
    relative = np.sqrt(np.diag(final.parameter_covariance)[n:]) / inverse
    return tuple(
        replace(setting, factor=float(1 / value), factor_random_rel=float(rel))
        for setting, value, rel in zip(settings[1:], inverse, relative, strict=True)
    )
