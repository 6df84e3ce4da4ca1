"""Calibration of a camera against a luminance meter."""

from __future__ import annotations

import logging
import platform
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from functools import cache
from importlib.metadata import version

import numpy as np

from ..core.finding import Finding, log_findings, unique
from ..core.reading import Reading
from .convert.patch import patch_luminance
from .dark.library import DarkLibrary
from .defects import DefectMap
from .findings import FitTest
from .fit import tests as fit_tests
from .fit.candidates import candidate_models
from .fit.demands import design_findings, fit_findings, require_every_gain, require_monotone, require_span
from .fit.design import DRIFT, build_design
from .fit.errors import finite, fit_errors, parameter_covariance
from .fit.intake import take_in, take_usable
from .fit.problem import Solution, solve
from .fit.residuals import fitted_rows, held_out_rows
from .fit.robust import screen
from .fit.scatter import fit_dof, scatter_of_one, with_scatter
from .fit.selection import select_model
from .frames.observations import DarkObservation, PatchObservation
from .gains import GainSetting
from .meter import MeterScale, meter_scale
from .model import Calibration, PatchResidual, ResponsivityFit
from .response.curve import ResponseCurve
from .setup import Provenance, Setup

_log = logging.getLogger(__name__)


def fit(
    observations: Sequence[PatchObservation],
    darks: Sequence[DarkObservation],
    readings: Mapping[str, Sequence[Reading]],
    setup: Setup,
    *,
    held_out: Collection[str] = (),
    defects: DefectMap | None = None,
    dark_library: DarkLibrary | None = None,
    response: ResponseCurve | None = None,
) -> Calibration:
    """Calibrate a camera.

    Dark frames fix d(t, T). All observations, patch by exposure by gain, are fitted at once by h(DN - d) = R f t V L
    with errors in both variables: the meter's random error of a patch is common to all its observations, the error of
    the dark signal to all observations of a gain, that of an exposure time to all observations with it. The meter's
    scale error is common to all; it is not part of the fit and is kept separately (a consistently wrong unit of the
    meter cannot be detected). h is linear, quadratic or a monotone PCHIP, selected by leave-one-out errors, or that of
    a bracket of exposures, which the patches then scale. A single bad reading is detected, reported and left out. The
    model's assumptions are checked.

    Parameters
    ----------
    observations : sequence of PatchObservation
        All patches at all exposures and gains, from `observe_patches`. The gain of the first is the calibration's own;
        others get a factor.
    darks : sequence of DarkObservation
        From `observe_dark`, for each gain, preferably including the shortest and longest exposure.
    readings : mapping of str to sequence of Reading
        The meter's readings by the name of the patch.
    setup : Setup
        Lens, spectrum, and hash of the input.
    held_out : collection of str
        Patches held out of the fit for validation.
    defects : DefectMap or None
        Pixels left out of the observations; stored for later frames.
    dark_library : DarkLibrary or None
        Dark pattern subtracted from the observations; stored for later frames.
    response : ResponseCurve or None
        Shape of the response, from a bracket of exposures (`response_from_bracket`): the patches only scale it. None to
        fit the response to the patches.

    Raises
    ------
    CalibrationError
        If patches and readings do not match, cameras, settings or meters differ, fewer than `MIN_PATCHES` patches are
        usable, they have the same luminance, a brighter one gives clearly less signal, there is no light, or they
        contradict the response of the bracket.
    InputError
        If a reading is a ratio in %.
    """
    intake = take_in(observations, darks, readings, held_out, None if response is None else response.response)
    groups, settings, findings = intake.groups, intake.settings, intake.findings
    scale = meter_scale(readings, setup.certificate, setup.meter_f1_prime, setup.source_spectrum)
    data = take_usable({name: group for name, group in groups.items() if name not in held_out}, readings, settings)
    design = build_design(data.groups, data.readings, settings)
    dark_dn = settings[0].dark.mean_dn(design.exposures_s[0])
    require_every_gain(design, settings)
    require_span(design)
    screened = screen(
        design, candidate_models(design.net_dn, len(design.patches), dark_dn, response), data.readings, readings
    )
    design = screened.design
    require_every_gain(design, settings)
    first, ladder = select_model(design, candidate_models(design.net_dn, len(design.patches), dark_dn, response))
    require_monotone(first)
    of_place = fit_tests.vignetting_left(first, observations[0].vignetting)
    plain = solve(design.without_shared(DRIFT), first.candidate)
    of_glare = fit_tests.glare(plain, _slope(plain))
    glare_cd_m2 = of_glare.value if of_glare.significant and of_glare.value > 0 else 0.0
    design = design.with_glare(glare_cd_m2)
    stated = solve(design, first.candidate)
    final = with_scatter(design, first.candidate, by_place=of_place.significant)
    of_scatter = fit_tests.scatter(stated)
    tests = _tests(plain, final, settings, intake.of_dark, (of_glare, of_place, of_scatter))
    calibration = _assemble(
        next(iter(groups.values()))[0],
        setup,
        scale,
        settings,
        final,
        replace(_responsivity(stated, final, of_glare), glare_cd_m2=glare_cd_m2),
        fitted_rows(final, screened.readings, groups),
        max(reading.timestamp for group in readings.values() for reading in group),
    )
    rows, of_held_out = held_out_rows(
        lambda name: patch_luminance(calibration, groups[name]),
        {name: group[0].centre_px for name, group in groups.items() if name in held_out},
        readings,
    )
    findings += [
        *scale.findings(calibration.provenance.measured),
        *data.findings,
        *(() if response is None else response.findings),
        *screened.findings,
    ]
    findings += [*design_findings(design, settings), *fit_findings(final, tests), *of_held_out]
    log_findings(_log, findings)
    return replace(
        calibration,
        defects=defects,
        dark_library=dark_library,
        held_out=rows,
        left_out=(*data.left_out, *screened.left_out),
        ladder=ladder,
        tests=tests,
        findings=unique(findings),
    )


def _assemble(
    observation: PatchObservation,
    setup: Setup,
    scale: MeterScale,
    settings: Sequence[GainSetting],
    final: Solution,
    responsivity: ResponsivityFit,
    residuals: tuple[PatchResidual, ...],
    measured: datetime,
) -> Calibration:
    """Make a calibration without findings."""
    design = final.design
    response, _ = final.candidate.response(final.parameters[: final.candidate.n_parameters])
    luminances = [value for row in residuals for value in (row.reading_cd_m2, row.luminance_cd_m2)]
    return Calibration(
        state=observation.state,
        lens=setup.lens,
        source_spectrum=setup.source_spectrum,
        measured_spectrum=setup.measured_spectrum,
        meter_scale=scale,
        responsivity=responsivity,
        response=response,
        fit_errors=fit_errors(final),
        dark=settings[0].dark,
        noise=settings[0].noise,
        gains=_gains(final, settings),
        vignetting=observation.vignetting,
        defects=None,
        dark_library=None,
        range_cd_m2=(min(luminances), max(luminances)),
        range_net_dn=_range_net_dn(final),
        exposures_s=tuple(float(v) for v in np.unique(design.exposures_s[design.exposure])),
        residuals=residuals,
        held_out=(),
        left_out=(),
        ladder=(),
        tests=(),
        findings=(),
        provenance=Provenance(
            measured=measured,
            input_sha256=setup.input_sha256,
            versions=dict(_versions()),
            sessions_sha256=setup.sessions_sha256,
        ),
    )


def _range_net_dn(final: Solution) -> tuple[float, float]:
    """Signals used for the response: those of the patches, or of the bracket."""
    if final.candidate.bracket is not None:
        return final.candidate.bracket.range_net_dn
    return float(final.design.net_dn.min()), float(final.design.net_dn.max())


@cache
def _versions() -> tuple[tuple[str, str], ...]:
    """Versions of the programs; looking them up reads files."""
    return (("python", platform.python_version()), *((name, version(name)) for name in ("labcdp", "numpy", "scipy")))


def _slope(solution: Solution) -> float:
    """R of a solution."""
    return solution.candidate.response(solution.parameters[: solution.candidate.n_parameters])[1]


def _responsivity(first: Solution, final: Solution, glare: FitTest) -> ResponsivityFit:
    design, responsivity = final.design, _slope(final)
    relative = float(np.sqrt(parameter_covariance(final)[0, 0]) / final.parameters[0])
    scatter_rel, scatter_dof = scatter_of_one(design)
    return ResponsivityFit(
        responsivity_dn_s_cd_m2=responsivity,
        random_rel=relative,
        chi_squared=first.chi_squared,
        degrees_of_freedom=first.degrees_of_freedom,
        scatter_rel=scatter_rel,
        scatter_dn=design.scatter_each_dn,
        intercept_dn_s=glare.value * responsivity if glare.tested else None,
        intercept_standard_uncertainty_dn_s=(glare.standard_uncertainty * responsivity if glare.tested else None),
        dof=finite(fit_dof(final)),
        scatter_dof=finite(scatter_dof),
    )


def _tests(
    first: Solution,
    final: Solution,
    settings: Sequence[GainSetting],
    of_dark: Sequence[Finding],
    found: tuple[FitTest, FitTest, FitTest],
) -> tuple[FitTest, ...]:
    of_glare, of_place, of_scatter = found
    factors = [(s.gain_db, s.factor, s.factor_random_rel) for s in _gains(final, settings)]
    return (
        of_glare,
        fit_tests.exposure_reciprocity(first),
        fit_tests.drift(first),
        of_place,
        of_scatter,
        fit_tests.dark_signal(first, settings[0].dark, of_dark),
        fit_tests.gain(factors, settings[0].gain_db),
    )


def _gains(final: Solution, settings: Sequence[GainSetting]) -> tuple[GainSetting, ...]:
    """Return the further gains with their fitted factors."""
    n = final.candidate.n_parameters
    inverse = final.parameters[n:]
    relative = np.sqrt(np.diag(parameter_covariance(final))[n:]) / inverse
    return tuple(
        replace(setting, factor=float(1 / value), factor_random_rel=float(rel))
        for setting, value, rel in zip(settings[1:], inverse, relative, strict=True)
    )
