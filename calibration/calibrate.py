"""Calibration of a camera against a luminance meter."""

from __future__ import annotations

import logging
import platform
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from functools import cache
from importlib.metadata import version
from math import hypot

import numpy as np

from ..reading import Reading
from . import fit_tests
from .chance import student_widening
from .dark_library import DarkLibrary
from .defects import DefectMap
from .demands import design_warnings, finding_warnings, require_every_gain, require_monotone, require_span
from .design import build_design
from .findings import FitTest
from .fit_errors import fit_errors, parameter_covariance
from .gains import GainSetting
from .gls import Solution
from .intake import gain_settings, group_by_patch, require_one_camera, take_usable
from .ladder import climb
from .model import Calibration, PatchResidual, ResponsivityFit
from .observations import DarkObservation, PatchObservation
from .patch import patch_luminance
from .readings import MeterScale, meter_scale
from .residuals import fitted_rows, held_out_rows
from .response_curve import ResponseCurve
from .robust import screen
from .rungs import rungs
from .scatter import with_scatter
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
    with errors in both variables: the meter's random error of a patch is shared by all its observations, the error of
    the darkness by all observations of a gain, an exposure's by all that have it. The meter's scale error is shared by
    everything; it stays out of the fit and is kept apart (if the meter was in the wrong unit throughout, R is wrong by
    that factor and nothing shows it). h is linear, quadratic or a monotone PCHIP, whichever leave-one-out errors ask
    for; or that of a bracket of exposures, which the patches then scale. One bad reading is found, named and left
    out. What the model takes for granted is tested.

    Parameters
    ----------
    observations : sequence of PatchObservation
        All patches at all exposures and gains, from `observe_patches`. The first one's gain becomes the calibration's
        own, others get a factor.
    darks : sequence of DarkObservation
        From `observe_dark`, for each gain, at best at the shortest and the longest exposure too.
    readings : mapping of str to sequence of Reading
        The meter's readings by the name of the patch.
    setup : Setup
        Lens, spectrum, and hash of the input.
    held_out : collection of str
        Patches the fit is not shown; their deviations tell how good it is.
    defects : DefectMap or None
        Pixels the observations leave out; kept for the frames to come.
    dark_library : DarkLibrary or None
        Dark pattern that was taken off the observations; kept for the frames to come.
    response : ResponseCurve or None
        Shape of the response, from a bracket of exposures (`response_from_bracket`): the patches scale it only. None
        to find the response by the patches.

    Raises
    ------
    CalibrationError
        If patches and readings do not match, cameras, settings or meters differ, fewer than `MIN_PATCHES` patches
        can be used, they have one luminance, a brighter one gives clearly less signal, there is no light, or they
        contradict the response of the bracket.
    InputError
        If a reading is a ratio in %.
    """
    require_one_camera(observations, darks)
    settings, warnings, dark_warnings = gain_settings(
        observations, darks, None if response is None else response.response
    )
    groups = group_by_patch(observations, readings, held_out)
    scale = meter_scale(readings)
    data = take_usable({name: group for name, group in groups.items() if name not in held_out}, readings, settings)
    design = build_design(data.groups, data.readings, settings)
    require_every_gain(design, settings)
    require_span(design)
    screened = screen(design, rungs(design.net_dn, len(design.patches), response), data.readings, readings)
    design = screened.design
    require_every_gain(design, settings)
    first, ladder = climb(design, rungs(design.net_dn, len(design.patches), response))
    require_monotone(first)
    of_place = fit_tests.fall_off(first, observations[0].vignetting)
    final = with_scatter(design, first.rung, by_place=of_place.significant)
    tests = _tests(first, final, settings, dark_warnings, of_place)
    calibration = _assemble(
        observations[0],
        setup,
        scale,
        settings,
        final,
        _responsivity(first, final, tests[0]),
        fitted_rows(final, screened.readings, groups),
        max(reading.timestamp for group in readings.values() for reading in group),
    )
    rows, held_out_warnings = held_out_rows(
        lambda name: patch_luminance(calibration, groups[name]),
        {name: group[0].centre_px for name, group in groups.items() if name in held_out},
        readings,
    )
    warnings += [
        *data.warnings,
        *(() if response is None else response.warnings),
        *(f"{row.reason}: left out" for row in screened.left_out),
    ]
    warnings += [*design_warnings(design, settings), *finding_warnings(final, tests), *held_out_warnings]
    for warning in warnings:
        _log.warning("%s", warning)
    return replace(
        calibration,
        defects=defects,
        dark_library=dark_library,
        held_out=rows,
        left_out=(*data.left_out, *screened.left_out),
        ladder=ladder,
        tests=tests,
        warnings=tuple(warnings),
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
    response, _ = final.rung.response(final.parameters[: final.rung.n_parameters])
    luminances = [value for row in residuals for value in (row.reading_cd_m2, row.luminance_cd_m2)]
    return Calibration(
        state=observation.state,
        lens=setup.lens,
        source_spectrum=setup.source_spectrum,
        measured_spectrum=setup.measured_spectrum,
        meter_scale=scale,
        responsivity=responsivity,
        response=response,
        fit_errors=fit_errors(final, _widening(final)),
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
        warnings=(),
        provenance=Provenance(
            measured=measured,
            input_sha256=setup.input_sha256,
            versions=dict(_versions()),
        ),
    )


def _range_net_dn(final: Solution) -> tuple[float, float]:
    """Signals the response rests on: those of the patches, or of the bracket."""
    if final.rung.bracket is not None:
        return final.rung.bracket.range_net_dn
    return float(final.design.net_dn.min()), float(final.design.net_dn.max())


@cache
def _versions() -> tuple[tuple[str, str], ...]:
    """Versions of the programs; looking them up reads files."""
    return (("python", platform.python_version()), *((name, version(name)) for name in ("labcdp", "numpy", "scipy")))


def _responsivity(first: Solution, final: Solution, glare: FitTest) -> ResponsivityFit:
    design, n = final.design, final.rung.n_parameters
    _, responsivity = final.rung.response(final.parameters[:n])
    relative = float(np.sqrt(parameter_covariance(final)[0, 0]) / final.parameters[0])
    return ResponsivityFit(
        responsivity_dn_s_cd_m2=responsivity,
        random_rel=relative * _widening(final),
        chi_squared=first.chi_squared,
        degrees_of_freedom=first.degrees_of_freedom,
        scatter_rel=hypot(design.scatter_rel, design.scatter_each_rel) * _widening(final),
        scatter_dn=design.scatter_each_dn * _widening(final),
        intercept_dn_s=None if "not testable" in glare.meaning else glare.value * responsivity,
        intercept_standard_uncertainty_dn_s=(
            None if "not testable" in glare.meaning else glare.standard_uncertainty * responsivity
        ),
    )


def _widening(final: Solution) -> float:
    """Factor on uncertainties that rest on the scatter of a few patches; 1 where the stated errors explain all."""
    design = final.design
    if design.scatter_rel == design.scatter_each_rel == design.scatter_each_dn == 0:
        return 1.0
    return student_widening(len(design.patches) - final.rung.n_parameters)


def _tests(
    first: Solution,
    final: Solution,
    settings: Sequence[GainSetting],
    dark_warnings: Sequence[str],
    of_place: FitTest,
) -> tuple[FitTest, ...]:
    _, responsivity = first.rung.response(first.parameters[: first.rung.n_parameters])
    factors = [(s.gain_db, s.factor, s.factor_random_rel) for s in _gains(final, settings)]
    return (
        fit_tests.glare(first, responsivity),
        fit_tests.exposure_reciprocity(first),
        fit_tests.drift(first),
        of_place,
        fit_tests.scatter(first),
        fit_tests.darkness(first, settings[0].dark, dark_warnings),
        fit_tests.gain(factors, settings[0].gain_db),
    )


def _gains(final: Solution, settings: Sequence[GainSetting]) -> tuple[GainSetting, ...]:
    """Return the further gains with their fitted factors."""
    n = final.rung.n_parameters
    inverse = final.parameters[n:]
    relative = np.sqrt(np.diag(parameter_covariance(final))[n:]) / inverse * _widening(final)
    return tuple(
        replace(setting, factor=float(1 / value), factor_random_rel=float(rel))
        for setting, value, rel in zip(settings[1:], inverse, relative, strict=True)
    )
