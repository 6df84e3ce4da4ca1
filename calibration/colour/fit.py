"""Fit of a camera with colour filters: each plane, and the combination of planes to luminance."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ...core.errors import CalibrationError
from ...core.frame import PLANES
from ...core.reading import Reading
from ...core.result import Finding, info, log_findings, warning
from ...core.spectra import SpectralTable, f1_prime, weighted_sum
from ..convert.patch import PatchLuminance
from ..fit_camera import fit
from ..fit_records import LeftOut, summarised
from ..fitting.intake import group_by_patch
from ..fitting.residuals import finite, held_out_rows, measured_rows
from ..frames.defects import DefectMap
from ..frames.observations import DarkObservation, PatchObservation
from ..model import Calibration, luminance_range
from ..readings import combine_patches
from ..sensor.dark_fit import as_rows
from ..sensor.dark_library import DarkLibrary
from ..setup import Setup, meter_scale
from ..tolerance import useless_calibration_findings
from .conversion import COLOURS, ByPlane, colour_patch_luminance, colours_of_planes
from .model import ColourCalibration, CombinationStep
from .patches import ColourPatch, by_patch, centre_px, colour_data, colour_patches, one_spectrum
from .weights import Array, ColourData, Combination, Prior, choose_prior, combine, leave_one_out, scattered

_log = logging.getLogger(__name__)

#: A single colour is used only if its leave-one-out error is below this fraction of the combination's, which has less
#: noise.
_CLEARLY_BETTER = 0.8
#: Name of the combination among the candidates.
COMBINATION = "combination"
#: Largest share of the prior's width at which the patches determine the weights.
_DETERMINED = 0.5
#: A combination, the leave-one-out errors of the patches by it, and how it was chosen.
_Chosen: TypeAlias = tuple[Combination, Array, tuple[CombinationStep, ...]]


def fit_colour(
    observations: ByPlane[PatchObservation],
    darks: ByPlane[DarkObservation],
    readings: Mapping[str, Sequence[Reading]],
    setup: Setup,
    *,
    sensitivities: Mapping[str, SpectralTable] | None = None,
    held_out: Collection[str] = (),
    defects: Mapping[str | None, DefectMap | None] | None = None,
    dark_libraries: Mapping[str | None, DarkLibrary | None] | None = None,
) -> ColourCalibration:
    """Calibrate a camera with colour filters.

    Each plane is calibrated by `fit` with the patches of one spectrum, such as grey ones: for other colours a plane
    deviates from the meter for spectral reasons. Then the weights of L = sum w_p L_p are fitted to all patches. Where
    these do not determine them, `labcdp.calibration.colour.weights` does. The combination is compared with each colour
    alone by leave-one-out errors.

    Parameters
    ----------
    observations : mapping of str to sequence of PatchObservation
        By plane (R, Gr, Gb, B): all patches at all exposures, from the frames that `planes.split` returns.
    darks : mapping of str to sequence of DarkObservation
        By plane.
    readings, setup, held_out
        As for `fit`.
    sensitivities : mapping of str to SpectralTable or None
        Relative spectral sensitivities of R, G and B to radiant power, if known; their scales are arbitrary.
    defects, dark_libraries : mapping of str or None
        By plane, as for `fit`.

    Raises
    ------
    CalibrationError
        As `fit`, naming the plane; if a plane is missing, or fewer than three patches have the same spectrum.
    InputError
        If sensitivities are not those of R, G and B.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from labcdp.calibration import LensIdentity, Setup, fit_colour, observe_dark, observe_patches
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> regions = [patch.region() for patch in session.configuration.target.patches]
    >>> def frames(role, exposure_s, plane):
    ...     some = (session.load(r) for r in session.frames(role) if r.exposure_s == exposure_s)
    ...     return [replace(frame, plane=plane) for frame in some]
    >>> planes, times_s = ("R", "Gr", "Gb", "B"), session.exposures_s
    >>> light = {p: [o for t in times_s for o in observe_patches(frames("light", t, p), regions)] for p in planes}
    >>> darks = {p: [observe_dark(frames("dark", t, p)) for t in times_s] for p in planes}
    >>> readings = {r.name: [x.reading for x in session.readings() if x.patch == r.name] for r in regions}
    >>> setup = Setup(LensIdentity("16 mm", "0001", focal_length_m=0.016, f_number=2.8), "D65", input_sha256="4f2a")
    >>> camera = fit_colour(light, darks, readings, setup)  # here all planes are alike
    >>> round(sum(camera.weights), 2)
    1.0
    """
    _require_planes(observations, darks)
    for plane in PLANES:
        group_by_patch(observations[plane], readings, held_out)
    grey, findings = one_spectrum(observations, darks, [name for name in readings if name not in held_out])
    of_grey_patches = {name: readings[name] for name in grey}
    planes = _fit_planes(observations, darks, of_grey_patches, setup, defects or {}, dark_libraries or {})
    groups = by_patch(observations)
    prior, scaled, of_prior = choose_prior(planes, sensitivities, planes[0].light)
    fitted = {name: group for name, group in groups.items() if name not in held_out}
    patches, left_out, of_patches = colour_patches(planes, fitted, readings)
    data, scatter = scattered(colour_data(planes, patches), prior.weights, np.array([p.name in grey for p in patches]))
    chosen = _choose(data, prior)
    calibration = _assembled(planes, patches, chosen, scatter, scaled, left_out)
    in_use = calibration.at_their_temperature()

    def measure(patch: str) -> PatchLuminance:
        return colour_patch_luminance(in_use, groups[patch])

    by_meter = combine_patches(readings)[0]
    meter = meter_scale(readings, setup.certificate, setup.meter_f1_prime, setup.source_spectrum)
    rows = measured_rows(calibration.residuals, measure, by_meter, meter)
    calibration = replace(calibration, residuals=rows, range_cd_m2=luminance_range(rows))
    in_use = replace(in_use, range_cd_m2=calibration.range_cd_m2)
    centres_px = {name: centre_px(group) for name, group in groups.items() if name in held_out}
    held, of_held_out = held_out_rows(measure, centres_px, readings)
    held = measured_rows(held, measure, by_meter, meter)
    findings += [*_plane_findings(planes), *of_patches, *of_prior]
    findings += [*_findings(chosen[0], patches, prior, scaled is not None), *of_held_out]
    findings += useless_calibration_findings(calibration)
    log_findings(_log, findings)
    return replace(calibration, held_out=held, findings=summarised(findings))


def _fit_planes(
    observations: ByPlane[PatchObservation],
    darks: ByPlane[DarkObservation],
    readings: Mapping[str, Sequence[Reading]],
    setup: Setup,
    defects: Mapping[str | None, DefectMap | None],
    dark_libraries: Mapping[str | None, DarkLibrary | None],
) -> list[Calibration]:
    planes = []
    for plane in PLANES:
        seen = [o for o in observations[plane] if o.patch in readings]
        library = dark_libraries.get(plane)
        try:
            planes.append(fit(seen, darks[plane], readings, setup, defects=defects.get(plane), dark_library=library))
        except CalibrationError as error:
            raise CalibrationError(f"plane {plane}: {error}") from error
    return planes


def _require_planes(observations: ByPlane[PatchObservation], darks: ByPlane[DarkObservation]) -> None:
    for what, given in (("light", observations), ("dark", darks)):
        missing = [plane for plane in PLANES if not given.get(plane)]
        if missing:
            raise CalibrationError(
                f"there are no {what} frames of plane {missing[0]}: split every Bayer frame and observe all planes"
            )


#: Code of a patch that deviates from the others.
_CONTRADICTS = "patch-contradicts"


def _plane_findings(planes: Sequence[Calibration]) -> list[Finding]:
    """Return the findings of the planes; an intercept that differs between them is due to colour, not glare."""
    glare = [next(test for test in plane.tests if test.name == "glare") for plane in planes]
    signs = {np.sign(test.value) if test.significant else 0 for test in glare}
    of_colour = len(signs) > 1
    # A patch that deviates in some planes only has another colour, and not a wrong reading.
    deviating = Counter(f.subject for plane in planes for f in plane.findings if f.code.startswith(_CONTRADICTS))
    coloured = [name for name, n in deviating.items() if n < len(planes)]
    # What all planes have, such as the meter, is said once.
    shared = set.intersection(*(set(plane.findings) for plane in planes))
    findings = [
        finding if finding in shared else finding.within(f"plane {plane.state.plane}")
        for plane, test in zip(planes, glare, strict=True)
        for finding in plane.findings
        if not (of_colour and test.significant and finding == test.finding)
        and not (finding.code.startswith(_CONTRADICTS) and finding.subject in coloured)
    ]
    findings += [warning("patch-coloured", name) for name in coloured]
    if of_colour:
        names = [f"{plane.state.plane}" for plane in planes]
        findings.append(
            warning("planes-intercepts-differ", planes=names, intercepts_cd_m2=[test.value for test in glare])
        )
    return findings


def _choose(data: ColourData, prior: Prior) -> _Chosen:
    """Compare the combination with each colour alone by leave-one-out errors; return those of the chosen one too."""
    # Of a single colour only its scale is fitted.
    none = Prior(np.ones(1), 1.0)
    tried = {COMBINATION: (data, prior)} | {colour: (data.only(i), none) for i, colour in enumerate(COLOURS)}
    combinations = {name: combine(*data_of_name) for name, data_of_name in tried.items()}
    left_out = {name: leave_one_out(*data_of_name, combinations[name].spectral) for name, data_of_name in tried.items()}
    errors = {name: _rms(deviations) for name, deviations in left_out.items()}
    name = best = min(COLOURS, key=lambda colour: errors[colour])
    why = info("colour-alone-better", colour=best, deviation_rel=errors[best])
    if errors[best] >= _CLEARLY_BETTER * errors[COMBINATION]:
        name, why = COMBINATION, info("combination-best")
    steps = tuple(
        CombinationStep(step, error, step == name, why if step == name else info("not-chosen", chosen=name))
        for step, error in errors.items()
    )
    return combinations[name] if name == COMBINATION else _alone(combinations[name], name), left_out[name], steps


def _alone(combination: Combination, colour: str) -> Combination:
    """Weights of a single colour, with those of the others, 0."""
    weights = np.array([name == colour for name in COLOURS], dtype=float)
    covariance = combination.covariance[0, 0] * np.outer(weights, weights)
    return replace(combination, weights=combination.weights[0] * weights, covariance=covariance)


def _rms(deviations: Array) -> float:
    return float(np.sqrt(np.mean(deviations**2)))


def _assembled(
    planes: Sequence[Calibration],
    patches: Sequence[ColourPatch],
    chosen: _Chosen,
    scatter: tuple[float, float],
    sensitivities: Mapping[str, SpectralTable] | None,
    left_out: Sequence[LeftOut],
) -> ColourCalibration:
    combination, without, ladder = chosen
    of_patches = zip(
        patches, combination.deviation.tolist(), combination.uncertainty.tolist(), without.tolist(), strict=True
    )
    rows = tuple(patch.residual(*of_patch) for patch, *of_patch in of_patches)
    to_colour, sensitivity = colours_of_planes(planes), None
    if sensitivities is not None:
        sensitivity = weighted_sum(sensitivities, dict(zip(COLOURS, combination.weights.tolist(), strict=True)))
    return ColourCalibration(
        planes=tuple(planes),
        weights=tuple((to_colour @ combination.weights).tolist()),
        # Scatter of the patches, grey and by colour, is in their variances already.
        weight_covariance=as_rows(to_colour @ combination.covariance @ to_colour.T),
        spectral_rel=combination.spectral_rel,
        scatter_rel=scatter[0],
        scatter_dof=finite(scatter[1]),
        range_cd_m2=luminance_range(rows),
        residuals=rows,
        held_out=(),
        left_out=tuple(left_out),
        ladder=ladder,
        sensitivity=sensitivity,
        f1_prime=None if sensitivity is None else f1_prime(sensitivity),
        findings=(),
    )


def _findings(
    chosen: Combination, patches: Sequence[ColourPatch], prior: Prior, sensitivities_known: bool
) -> list[Finding]:
    findings = []
    if chosen.undetermined > _DETERMINED * prior.width:
        findings.append(warning("patches-of-one-colour-f1" if sensitivities_known else "patches-of-one-colour"))
    if chosen.spectral > 0:
        worst = int(np.argmax(np.abs(chosen.deviation)))
        deviation_rel = float(chosen.deviation[worst])
        findings.append(warning("colours-do-not-fit", patches[worst].name, deviation_rel=deviation_rel))
    return findings
