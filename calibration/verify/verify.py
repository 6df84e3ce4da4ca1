"""Verification of a calibration by measuring patches and dark signal again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from math import hypot, inf, sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.clock import exposure_text
from ...core.errors import CalibrationError
from ...core.luminance import CommonError
from ...core.reading import Reading
from ...core.result import Finding, warning
from ..camera import EXPOSURE_TIME, FLAT_FIELD, OF_FRAMES, STABILITY, VIGNETTING
from ..colour.conversion import ByPlane, luminance_of_planes, own_rel
from ..colour.model import AnyCalibration
from ..colour.patches import by_patch, nonuniformity_rel
from ..convert.patch import PatchLuminance, numbered, patch_luminance
from ..fit_records import summarised
from ..frames.observations import DarkObservation, PatchObservation
from ..model import Calibration
from ..readings import PatchReading, combine_patches, parts_of_readings
from ..sensor.dark import DarkModel, fit_dark
from ..setup import METER_SOURCES, MeterScale
from ..signal import temperature_findings
from ..tolerance import Part, expanded_with_scales, own_tolerance_rel
from ..uncertainty import (
    FALSE_ALARM,
    SMALL_EFFECT_REL,
    effective_dof,
    expanded_half_width,
    p_value_of_chi_squared,
    scales_apart,
    student_factor,
    three_over_two,
    variance_from_one_estimate,
)
from .findings import verification_findings
from .result import DRIFT_DN, Drift, Verification, VerifiedDark, VerifiedPatch, VerifiedPlane, require_tolerance

#: Source of what light of the surroundings does in a region.
SURROUNDINGS = "surroundings"
#: Begin the names of common errors of the frames, and not of the calibration.
_MEASURED = (*OF_FRAMES, EXPOSURE_TIME)


def verify(
    calibration: AnyCalibration,
    observations: ByPlane[PatchObservation],
    darks: ByPlane[DarkObservation],
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
        The one to verify.
    observations, darks : mapping of str to sequence
        New ones, with the calibration's vignetting, by plane (R, Gr, Gb, B; None for a monochrome sensor).
    readings : mapping of str to sequence of Reading
        New readings by the name of the patch, with the correction of the meter's certificate.
    meter : MeterScale
        The meter that took them, from `labcdp.calibration.setup.meter_scale`.
    tolerance_rel : float or None
        Largest relative deviation that conforms; None for the calibration's U (95 %) with the assumed vignetting, see
        `own_tolerance_rel`. Deviations show that vignetting, and what a flat field leaves: no part of their U.

    Raises
    ------
    CalibrationError
        If a patch, plane or reading is missing or of no use, or camera, settings or vignetting are not as calibrated.
    InputError
        If the tolerance is not above 0 and up to 1.
    """
    stated_rel = None if tolerance_rel is None else require_tolerance(tolerance_rel)
    # What another temperature of the camera does is seen on the dark frames.
    calibration = calibration.at_their_temperature()
    calibration = calibration.for_use(reading.timestamp for group in readings.values() for reading in group)
    groups = by_patch(observations, [plane.state.plane for plane in calibration.planes])
    seen, unusable, of_frames = _measured(calibration, groups)
    comparison, of_readings = _compared(calibration, groups, list(seen.values()), readings, meter)
    mean_rel, mean_expanded_rel = comparison.mean()
    measured = max(reading.timestamp for patch in seen for reading in readings[patch])
    result = Verification(
        findings=(),
        state=calibration.state,
        lens=calibration.lens,
        measured=measured,
        calibration_measured=calibration.provenance.measured,
        calibration_sha256=calibration.provenance.input_sha256,
        meter=meter,
        calibration_meter=calibration.meter_scale,
        tolerance_rel=stated_rel or own_tolerance_rel(calibration),
        tolerance_stated=stated_rel is not None,
        patches=tuple(comparison.rows(lambda of_place_rel: stated_rel or own_tolerance_rel(calibration, of_place_rel))),
        unusable=unusable,
        darks=tuple(_dark_rows(calibration, darks)),
        planes=_planes(calibration, darks, comparison, {name: groups[name] for name in seen}),
        mean_rel=mean_rel,
        mean_expanded_rel=mean_expanded_rel,
    )
    # Where the scale cancels, its traceability does not matter.
    of_meter = [f for f in meter.findings(readings) if comparison.scales or f.code != "meter-without-certificate"]
    all_findings = [*of_readings, *of_meter, *(f for row in seen.values() for f in row.findings), *of_frames]
    return replace(result, findings=(*verification_findings(result), *summarised(all_findings)))


@dataclass(frozen=True, eq=False)
class _Comparison:
    """Deviations of n patches; `scales` are those that matter, by `scales_apart`.

    Errors of the sources `shown` are what the deviations are to show, and no part of their uncertainty.
    """

    seen: Sequence[PatchLuminance]
    read: Mapping[str, PatchReading]
    nonuniformity_rel: Mapping[str, float]
    meter: MeterScale
    scales: Sequence[MeterScale]
    field_rel: float
    shown: tuple[str, ...]

    @property
    def deviation_rel(self) -> NDArray[np.float64]:
        return np.array([patch.luminance_cd_m2 / self.read[patch.patch].luminance_cd_m2 - 1 for patch in self.seen])

    @property
    def _own_rel2(self) -> NDArray[np.float64]:
        """Variances by the pixels and the place of each patch."""
        of_pixels = [patch.random_rel**2 - patch.scatter_rel**2 - self.field_rel**2 for patch in self.seen]
        if SURROUNDINGS in self.shown:
            of_pixels = [part - patch.rim_rel**2 for part, patch in zip(of_pixels, self.seen, strict=True)]
        uneven = [self.nonuniformity_rel[patch.patch] ** 2 for patch in self.seen]
        variances: NDArray[np.float64] = np.maximum(of_pixels, 0.0) + uneven
        return variances

    @cached_property
    def _common(self) -> list[tuple[str, NDArray[np.float64], float]]:
        """Source, pattern and degrees of freedom of each common error but those of the meter and those to be shown."""
        common = [numbered(patch.common) for patch in self.seen]
        patterns = []
        for name in dict.fromkeys(name for errors in common for name in errors):
            if name[0] not in (*METER_SOURCES, *self.shown):
                same = [errors.get(name, CommonError(name[0], 0.0)) for errors in common]
                pattern = np.array([float(error.relative) for error in same])
                patterns.append((name[0], pattern, min(error.dof for error in same)))
        return patterns

    @property
    def covariance(self) -> NDArray[np.float64]:
        readings = np.array([self.read[patch.patch].variance_rel for patch in self.seen])
        scatter = np.square([patch.scatter_rel for patch in self.seen])
        covariance = np.diag(self._own_rel2 + readings + scatter + self.field_rel**2)
        for _, pattern, _ in self._common:
            covariance = covariance + np.outer(pattern, pattern)
        return covariance

    def _measured(self, weights: NDArray[np.float64]) -> list[Part]:
        """Parts of a weighted mean of the deviations by what is measured now."""
        readings = parts_of_readings([self.read[patch.patch] for patch in self.seen], weights.tolist())
        of_frames = [variance_from_one_estimate(self._source_parts(weights, source)) for source in OF_FRAMES]
        of_times = self._source_parts(weights, EXPOSURE_TIME)
        return [(float(weights**2 @ self._own_rel2), inf), *readings, *of_frames, *of_times]

    def _calibrated(self, weights: NDArray[np.float64]) -> list[Part]:
        """Parts by the calibration, without what flat field or vignetting leave."""
        scatter = [
            (w**2 * patch.scatter_rel**2, patch.scatter_dof) for w, patch in zip(weights, self.seen, strict=True)
        ]
        of_fit = variance_from_one_estimate([*self._source_parts(weights, "fit"), *scatter])
        others = {source for source, _, _ in self._common if not source.startswith(("fit", *_MEASURED, FLAT_FIELD))}
        return [of_fit, *(part for source in sorted(others) for part in self._source_parts(weights, source))]

    def _position_parts(self, weights: NDArray[np.float64]) -> list[Part]:
        """Parts by what a flat field leaves at the patches."""
        return [(float(np.sum(weights**2)) * self.field_rel**2, inf), *self._source_parts(weights, FLAT_FIELD)]

    def _source_parts(self, weights: NDArray[np.float64], start: str) -> list[Part]:
        same = [(pattern, dof) for source, pattern, dof in self._common if source.startswith(start)]
        return [(float(weights @ pattern) ** 2, dof) for pattern, dof in same]

    def mean(self) -> tuple[float, float]:
        """Mean deviation by generalised least squares, and its U (95 %)."""
        weights = self._weights()
        return float(weights @ self.deviation_rel), expanded_with_scales(self.scales, self._whole(weights))

    @property
    def dof(self) -> float:
        """Degrees of freedom of the mean's uncertainty."""
        return effective_dof(self._whole(self._weights()))

    def _weights(self) -> NDArray[np.float64]:
        weights = np.linalg.solve(self.covariance, np.ones(len(self.seen)))
        normed: NDArray[np.float64] = weights / weights.sum()
        return normed

    def _whole(self, weights: NDArray[np.float64]) -> list[Part]:
        return [*self._measured(weights), *self._calibrated(weights), *self._position_parts(weights)]

    def parts_of(self, number: int) -> list[Part]:
        """Parts of the deviation of one patch."""
        return self._whole(np.eye(len(self.seen))[number])

    def drift(self, plane: Calibration) -> Drift:
        """Return the mean deviation as a change of a plane's responsivity.

        What the calibration is uncertain by is part of the change, and not of the responsivity now.
        """
        weights = self._weights()
        mean, now = float(weights @ self.deviation_rel), [*self._measured(weights), *self._position_parts(weights)]
        return Drift(
            relative=mean,
            expanded_rel=expanded_with_scales(self.scales, self._whole(weights)),
            responsivity_dn_s_cd_m2=plane.responsivity.responsivity_dn_s_cd_m2 * (1 + mean),
            responsivity_expanded_rel=expanded_with_scales([self.meter], now),
            responsivity_own_rel=expanded_with_scales(self._scales_now, now),
        )

    @property
    def _scales_now(self) -> Sequence[MeterScale]:
        """Scales whose errors are no part of the calibration's."""
        return [self.meter] if self.meter in self.scales else self.scales

    def rows(self, tolerance_rel: Callable[[float], float]) -> Iterator[VerifiedPatch]:
        """One row per patch; what flat field or assumed vignetting leave at its place is part of its tolerance."""
        of_scales, variances = hypot(*(scale.common_rel for scale in self.scales)), np.diag(self.covariance).tolist()
        for n, (s, deviation, variance) in enumerate(
            zip(self.seen, self.deviation_rel.tolist(), variances, strict=True)
        ):
            of_place = hypot(*(float(e.relative) for e in s.common if e.source == VIGNETTING))
            alone = np.eye(len(self.seen))[n]
            measured, calibrated = self._measured(alone), self._calibrated(alone)
            u = sqrt(sum(part for part, _ in (*measured, *calibrated)))
            yield VerifiedPatch.of(
                self.read[s.patch],
                s.luminance_cd_m2,
                s.exposures_s,
                reading_U_rel=self.read[s.patch].U_rel(self.meter),
                deviation_rel=deviation,
                standard_uncertainty_rel=hypot(u, of_scales),
                expanded_rel=expanded_with_scales(self.scales, [*measured, *calibrated]),
                guard_rel=expanded_with_scales(self._scales_now, measured),
                independent_rel=sqrt(variance) * student_factor(effective_dof(self._whole(alone))),
                tolerance_rel=tolerance_rel(of_place),
            )


def _compared(
    calibration: AnyCalibration,
    groups: Mapping[str, ByPlane[PatchObservation]],
    seen: Sequence[PatchLuminance],
    readings: Mapping[str, Sequence[Reading]],
    meter: MeterScale,
    shown: tuple[str, ...] = (VIGNETTING, STABILITY),
) -> tuple[_Comparison, list[Finding]]:
    """Combine the readings of each patch, and determine the relevant scale errors."""
    read, findings = combine_patches({row.patch: readings.get(row.patch, ()) for row in seen})
    for patch in read:
        if read[patch].luminance_cd_m2 == 0:
            raise CalibrationError(f"patch {patch!r} reads 0 cd/m², below the meter's range: verify a brighter one")
    calibrated = calibration.meter_scale
    scales = scales_apart(meter, calibrated)
    if (meter.meter.model, meter.meter.serial) == (calibrated.meter.model, calibrated.meter.serial):
        # One instrument: its spectral mismatch is the same in the same light.
        scales = tuple(replace(scale, f1_prime=None) for scale in scales)
    uneven = {patch: nonuniformity_rel(calibration.planes, groups[patch]) for patch in read}
    return _Comparison(seen, read, uneven, meter, scales, calibration.field_rel, shown), findings


def changes_since(
    calibration: AnyCalibration,
    observations: ByPlane[PatchObservation],
    seen: Sequence[PatchLuminance],
    readings: Mapping[str, Sequence[Reading]],
    meter: MeterScale,
) -> tuple[AnyCalibration, dict[str, float], list[Finding]]:
    """Compare the patches of a session with its readings: a finding by chance in 0.27 % (three standard deviations).

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        As it holds in the session.
    observations, readings : mapping
        Of the session, as of `verify`.
    seen : sequence of PatchLuminance
        Its patches.
    meter : MeterScale
        The meter that took the readings.

    Returns
    -------
    Calibration or ColourCalibration
        As uncertain as all patches, alike, contradict the meter.
    dict of str to float
        Relative deviations of patches that contradict it alone.
    list of Finding
        What was found.
    """
    groups = by_patch(observations, [plane.state.plane for plane in calibration.planes])
    comparison, _ = _compared(calibration, groups, seen, readings, meter, (STABILITY, SURROUNDINGS))
    deviation, expanded = comparison.mean()
    left, n = comparison.deviation_rel - deviation, len(seen) - 1
    chi_squared = float(left @ np.linalg.solve(comparison.covariance, left))
    if n > 0 and p_value_of_chi_squared(chi_squared, n) < FALSE_ALARM:
        return calibration, *_deviating(comparison, calibration.stability_rel)
    by_chance_rel = expanded * three_over_two(comparison.dof)
    with_stability_rel = hypot(expanded, expanded_half_width(0.0, calibration.stability_rel))
    if abs(deviation) <= max(by_chance_rel, with_stability_rel, SMALL_EFFECT_REL):
        return calibration, {}, []
    measured = f"{calibration.provenance.measured:%Y-%m-%d}"
    change = warning("responsivity-changed", deviation_rel=deviation, expanded_rel=expanded, measured=measured)
    return calibration.changed_by(deviation), {}, [change]


def _deviating(comparison: _Comparison, stability_rel: float) -> tuple[dict[str, float], list[Finding]]:
    """Return the patches that contradict the meter alone, with their deviations, and findings."""
    deviating, findings = {}, []
    for n, (patch, deviation) in enumerate(zip(comparison.seen, comparison.deviation_rel.tolist(), strict=True)):
        parts = comparison.parts_of(n)
        expanded = expanded_with_scales(comparison.scales, [*parts, (stability_rel**2, inf)])
        if abs(deviation) > max(expanded * three_over_two(effective_dof(parts)), SMALL_EFFECT_REL):
            deviating[patch.patch] = deviation
            values = {"deviation_rel": deviation, "expanded_rel": expanded}
            findings.append(warning("patch-contradicts-meter", patch.patch, **values))
    return deviating, findings


def _planes(
    calibration: AnyCalibration,
    darks: ByPlane[DarkObservation],
    comparison: _Comparison,
    groups: Mapping[str, ByPlane[PatchObservation]],
) -> tuple[VerifiedPlane, ...]:
    """Each plane with its change against the meter, and its deviation from all planes together, by grey patches."""
    planes = [
        VerifiedPlane(plane.state.plane, _dark(plane, darks.get(plane.state.plane, ())), None)
        for plane in calibration.planes
    ]
    if isinstance(calibration, Calibration):
        return (replace(planes[0], drift=comparison.drift(calibration)),)
    seen: list[list[PatchLuminance]] = []
    for group in (group for name, group in groups.items() if name in calibration.grey_patches):
        with suppress(CalibrationError):
            seen.append([patch_luminance(plane, group[plane.state.plane]) for plane in calibration.planes])
    if not seen:
        return tuple(planes)
    by_plane, weights = list(zip(*seen, strict=True)), np.array(calibration.weights)
    luminance = np.array([[patch.luminance_cd_m2 for patch in of_plane] for of_plane in by_plane])
    shares = weights[:, None] * luminance
    shares = (shares / shares.sum(axis=0)).mean(axis=1)
    balance = (luminance / (weights @ luminance) - 1).mean(axis=1)
    errors = np.array([_own_rel(plane, patches) for plane, patches in zip(calibration.planes, by_plane, strict=True)])
    u = np.sqrt(np.square(np.eye(len(planes)) - shares) @ np.square(errors))
    return tuple(
        replace(
            verified,
            drift=replace(comparison, seen=patches).drift(plane),
            balance_rel=float(balance[n]),
            balance_expanded_rel=expanded_half_width(0.0, float(u[n])),
            share=float(shares[n]),
        )
        for n, (verified, plane, patches) in enumerate(zip(planes, calibration.planes, by_plane, strict=True))
    )


def _own_rel(plane: Calibration, patches: Sequence[PatchLuminance]) -> float:
    """Relative standard uncertainty of a plane's mean over patches, by what differs from plane to plane."""
    noise = sum(own_rel(plane, patch) ** 2 for patch in patches) / len(patches) ** 2
    return sqrt(noise + plane.responsivity.scatter_rel**2 / len(patches) + max(patch.fit_rel for patch in patches) ** 2)


def _measured(
    calibration: AnyCalibration, groups: Mapping[str, ByPlane[PatchObservation]]
) -> tuple[dict[str, PatchLuminance], tuple[str, ...], list[Finding]]:
    """Luminances of the patches that can be measured, names of the others, and findings; raises if there is none."""
    if not groups:
        raise CalibrationError("there is no patch to verify the calibration with: give frames and readings of one")
    seen: dict[str, PatchLuminance] = {}
    errors: dict[str, CalibrationError] = {}
    findings: list[Finding] = []
    for name, group in groups.items():
        try:
            seen[name] = luminance_of_planes(calibration, group)
        except CalibrationError as error:
            errors[name] = error
            findings.append(warning("patch-not-verified", name, reason=str(error)))
            for plane in calibration.planes:
                findings += temperature_findings(group.get(plane.state.plane, ()), plane.settings)
    if not seen:
        raise next(iter(errors.values()))
    return seen, tuple(errors), findings


def _dark(plane: Calibration, darks: Sequence[DarkObservation]) -> DarkModel:
    of = f"dark frames{(plane.state.plane and f' of plane {plane.state.plane}') or ''}"
    if not darks:
        raise CalibrationError(f"there are no {of}: cover the lens and record some")
    for d in darks:
        plane.require(d.state, f"the set of {of} at {exposure_text(d.exposure_s)}")
    return fit_dark(darks)[0]


def _dark_rows(calibration: AnyCalibration, darks: ByPlane[DarkObservation]) -> Iterator[VerifiedDark]:
    """Compare the new dark frames of each plane and exposure with the calibration's dark signal."""
    for plane, weight in zip(calibration.planes, calibration.weights, strict=True):
        # The lowest luminance is measured with the longest exposures.
        effect_rel_per_dn = weight / (calibration.range_cd_m2[0] * plane.dn_per_cd_m2(plane.exposures_s[-1]))
        for dark in sorted(darks.get(plane.state.plane, ()), key=lambda dark: dark.exposure_s):
            model = plane.setting(dark.state.gain_db).dark
            variance_dn2 = dark.mean_variance_dn2 + model.variance_dn2(dark.exposure_s, dark.temperature_c)
            yield VerifiedDark(
                plane=dark.state.plane,
                exposure_s=dark.exposure_s,
                mean_dn=dark.mean_dn,
                expected_dn=model.mean_dn(dark.exposure_s, dark.temperature_c),
                standard_uncertainty_dn=hypot(sqrt(variance_dn2), DRIFT_DN / sqrt(3)),
                effect_rel_per_dn=effect_rel_per_dn,
            )
