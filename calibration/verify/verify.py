"""Verification of a calibration by measuring patches and dark signal again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import hypot, inf, sqrt

import numpy as np

from ...core.errors import CalibrationError
from ...core.reading import Reading
from ...core.result import Finding, warning
from ..colour.conversion import luminance_of_planes
from ..colour.model import AnyCalibration, ColourCalibration
from ..colour.patches import by_patch
from ..convert.patch import PatchLuminance
from ..frames.observations import DarkObservation, PatchObservation
from ..meter import MeterScale
from ..model import Calibration
from ..sensor.dark import DarkModel, fit_dark
from ..signal import net_signal, temperature_findings, usable
from ..uncertainty import effective_dof, expanded_rel, of_one_estimate
from .comparison import Comparison, balanced, join_readings
from .findings import findings_of
from .result import WANDER_DN, Verification, VerifiedDark, VerifiedPlane, require_tolerance


def verify(
    calibration: AnyCalibration,
    observations: Mapping[str, Sequence[PatchObservation]],
    darks: Mapping[str, Sequence[DarkObservation]],
    readings: Mapping[str, Sequence[Reading]],
    meter: MeterScale,
    tolerance_rel: float | None = None,
) -> Verification:
    """Compare patches measured again by the calibrated camera with the meter.

    Each deviation is decided by `labcdp.calibration.verify.result.decide`. The scale error of the meter cancels if it
    is the calibration's meter in the same state of adjustment; otherwise the scales of both count.

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        Calibration to verify.
    observations, darks : mapping of str to sequence
        New observations, with the calibration's vignetting, and new dark frames, by plane (R, Gr, Gb, B); by an empty
        name for a monochrome sensor.
    readings : mapping of str to sequence of Reading
        New readings by the name of the patch, with the correction of the meter's certificate.
    meter : MeterScale
        The meter that took them, from `labcdp.calibration.meter.meter_scale`.
    tolerance_rel : float or None
        Largest relative deviation that conforms; None for the U (95 %) of the calibration, see `own_tolerance_rel`.

    Raises
    ------
    CalibrationError
        If there is no patch, a plane is missing, a patch has no reading or reads 0, all are clipped or black at every
        exposure, or camera, settings or vignetting are not the calibration's.
    InputError
        If the tolerance is not above 0 and up to 1.
    """
    tolerance = own_tolerance_rel(calibration) if tolerance_rel is None else require_tolerance(tolerance_rel)
    groups = by_patch(observations, [_name(plane) for plane in calibration.planes])
    if not groups:
        raise CalibrationError("there is no patch to verify the calibration with: give frames and readings of one")
    planes = [VerifiedPlane(one.state.plane, _dark(one, darks.get(_name(one), ())), None) for one in calibration.planes]
    seen, unusable, findings = _measured(calibration, groups)
    read = join_readings(seen, readings, meter, calibration.meter_scale)
    brightest = max(calibration.planes, key=lambda one: one.responsivity.responsivity_dn_s_cd_m2)
    uneven = {name: _uneven_rel(groups[name][_name(brightest)], brightest) for name in seen}
    comparison = Comparison.of(list(seen.values()), read, uneven)
    if isinstance(calibration, ColourCalibration):
        planes = balanced(calibration, {name: groups[name] for name in seen}, read, uneven, planes)
    else:
        planes = [replace(planes[0], drift=comparison.drift(calibration))]
    result = _result(calibration, comparison, darks, planes, tolerance)
    of_patches = [*read.findings, *(one for row in seen.values() for one in row.findings), *findings]
    result = replace(result, tolerance_stated=tolerance_rel is not None, unusable=unusable)
    return replace(result, findings=(*findings_of(result), *dict.fromkeys(of_patches)))


def _result(
    calibration: AnyCalibration,
    comparison: Comparison,
    darks: Mapping[str, Sequence[DarkObservation]],
    planes: Sequence[VerifiedPlane],
    tolerance_rel: float,
) -> Verification:
    """Return the result without findings."""
    mean, u = comparison.mean()
    read = comparison.readings
    return Verification(
        findings=(),
        state=calibration.state,
        lens=calibration.lens,
        measured=read.measured,
        calibration_measured=calibration.provenance.measured,
        calibration_sha256=calibration.provenance.input_sha256,
        meter=read.scale,
        calibration_meter=calibration.meter_scale,
        tolerance_rel=tolerance_rel,
        tolerance_stated=True,
        patches=comparison.rows(tolerance_rel),
        unusable=(),
        darks=tuple(
            _dark_row(d, one, calibration.range_cd_m2[0], share)
            for one, share in zip(calibration.planes, calibration.weights, strict=True)
            for d in sorted(darks[_name(one)], key=lambda d: d.exposure_s)
        ),
        planes=tuple(planes),
        mean_rel=mean,
        mean_expanded_rel=expanded_rel(read.scales, u),
    )


def own_tolerance_rel(calibration: AnyCalibration) -> float:
    """Relative U (95 %) of a calibration: meter, fit and scatter of the patches, without the noise of a patch."""
    if isinstance(calibration, Calibration):
        fit = calibration.responsivity
        parts = ((fit.random_rel**2, fit.dof or inf), (fit.scatter_rel**2, fit.scatter_dof or inf))
        variance, dof = of_one_estimate(parts)
        refocus = calibration.lens.refocus_rel**2
        dof = effective_dof(((variance, dof), (refocus, inf)))
        return expanded_rel([calibration.meter_scale], sqrt(variance + refocus), dof)
    of_weights = float(np.linalg.norm(calibration.weight_errors.sum(axis=1)))
    return expanded_rel(
        [calibration.meter_scale], hypot(of_weights, calibration.scatter_rel, calibration.planes[0].lens.refocus_rel)
    )


def _name(plane: Calibration) -> str:
    return plane.state.plane or ""


def _measured(
    calibration: AnyCalibration, groups: Mapping[str, Mapping[str, Sequence[PatchObservation]]]
) -> tuple[dict[str, PatchLuminance], tuple[str, ...], list[Finding]]:
    """Luminances of the patches that can be measured, names of the others, and findings; raises if there is none."""
    seen: dict[str, PatchLuminance] = {}
    errors: dict[str, CalibrationError] = {}
    findings: list[Finding] = []
    for name, group in groups.items():
        try:
            seen[name] = luminance_of_planes(calibration, group)
        except CalibrationError as error:
            errors[name] = error
            findings.append(warning("patch-not-verified", name, reason=str(error)))
            of_planes = ((plane, group.get(_name(plane), ())) for plane in calibration.planes)
            findings += [one for plane, own in of_planes for one in temperature_findings(own, plane.settings)]
    if not seen:
        raise next(iter(errors.values()))
    return seen, tuple(errors), findings


def _uneven_rel(group: Sequence[PatchObservation], calibration: Calibration) -> float:
    """Non-uniformity of a patch, which meter and camera view at slightly different positions, as in the fit."""
    kept, _, _ = usable(group, calibration.settings)
    return float(np.median([net_signal(o, calibration.settings).slow_rel for o in kept]))


def _dark(plane: Calibration, darks: Sequence[DarkObservation]) -> DarkModel:
    of_plane = f" of plane {plane.state.plane}" if plane.state.plane else ""
    if not darks:
        raise CalibrationError(f"there are no dark frames{of_plane}: cover the lens and record some")
    for d in darks:
        plane.require(d.state, f"the set of dark frames{of_plane} at {d.exposure_s:g} s")
    return fit_dark(darks)[0]


def _dark_row(dark: DarkObservation, calibration: Calibration, lowest_cd_m2: float, weight: float) -> VerifiedDark:
    """One exposure of new dark frames; `weight` is that of the plane in the luminance."""
    model = calibration.setting(dark.state.gain_db).dark
    own = dark.mean_variance_dn2 + model.variance_dn2(dark.exposure_s, dark.temperature_c)
    light_dn_s = calibration.responsivity.responsivity_dn_s_cd_m2 * lowest_cd_m2
    return VerifiedDark(
        plane=dark.state.plane,
        exposure_s=dark.exposure_s,
        mean_dn=dark.mean_dn,
        expected_dn=model.mean_dn(dark.exposure_s, dark.temperature_c),
        standard_uncertainty_dn=hypot(sqrt(own), WANDER_DN / sqrt(3)),
        # The lowest luminance is measured with the longest exposures.
        effect_rel_per_dn=weight / (light_dn_s * calibration.exposures_s[-1]),
    )
