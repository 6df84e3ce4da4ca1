"""Deviations of the camera from the meter, with independent and common errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.reading import Reading
from ...core.result import Finding
from ..colour.conversion import own_rel
from ..colour.model import ColourCalibration
from ..convert.patch import PatchLuminance, numbered, patch_luminance
from ..frames.observations import PatchObservation
from ..meter import METER_SOURCES, MeterScale
from ..model import Calibration
from ..readings import PatchReading, combine_readings
from ..uncertainty import expanded_half_width, expanded_rel
from .result import Drift, VerifiedPatch, VerifiedPlane


@dataclass(frozen=True)
class Readings:
    """The meter's side of a comparison.

    Parameters
    ----------
    joined : dict of str to PatchReading
        Readings by patch.
    scale : MeterScale
        Of the meter that read them.
    scales : tuple of MeterScale
        Meters whose errors count: none if both are one in the same state.
    measured : datetime
        Time of the last reading.
    findings : tuple of Finding
        Findings for the user.
    """

    joined: Mapping[str, PatchReading]
    scale: MeterScale
    scales: tuple[MeterScale, ...]
    measured: datetime
    findings: tuple[Finding, ...]


def join_readings(
    patches: Iterable[str], readings: Mapping[str, Sequence[Reading]], scale: MeterScale, calibrated: MeterScale
) -> Readings:
    """Combine the readings of each patch, and determine the relevant scale errors.

    Raises
    ------
    CalibrationError
        If a patch has no reading or reads 0.
    """
    joined: dict[str, PatchReading] = {}
    findings: list[Finding] = []
    for patch in patches:
        joined[patch], of_patch = combine_readings(patch, readings.get(patch, ()))
        findings += of_patch
        if joined[patch].luminance_cd_m2 == 0:
            raise CalibrationError(
                f"patch {patch!r} reads 0 cd/m^2, below the meter's range: verify with a brighter patch"
            )
    measured = max(reading.timestamp for patch in joined for reading in readings[patch])
    scales: tuple[MeterScale, ...] = () if scale.is_as_in(calibrated) else (scale, calibrated)
    if (scale.meter.model, scale.meter.serial) == (calibrated.meter.model, calibrated.meter.serial):
        # One instrument: its spectral mismatch is the same in the same light.
        scales = tuple(replace(one, f1_prime=None) for one in scales)
    return Readings(joined, scale, scales, measured, (*findings, *scale.findings(measured)))


@dataclass(frozen=True, eq=False)
class Comparison:
    """Deviations of n patches by camera and meter.

    Parameters
    ----------
    seen : tuple of PatchLuminance
        By the camera.
    readings : Readings
        By the meter.
    deviation_rel : ndarray of float, shape (n,)
        Relative deviations of the camera from the meter.
    covariance : ndarray of float, shape (n, n)
        Their covariance without the scales of the meters.
    """

    seen: tuple[PatchLuminance, ...]
    readings: Readings
    deviation_rel: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @classmethod
    def of(cls, seen: Sequence[PatchLuminance], readings: Readings, uneven_rel: Mapping[str, float]) -> Comparison:
        """Compare patches; `uneven_rel` is the non-uniformity of each, which camera and meter view differently."""
        read = [readings.joined[one.patch] for one in seen]
        deviation = np.array([s.luminance_cd_m2 / r.luminance_cd_m2 - 1 for s, r in zip(seen, read, strict=True)])
        own = [
            hypot(s.random_rel, r.random_cd_m2 / r.luminance_cd_m2, uneven_rel[s.patch])
            for s, r in zip(seen, read, strict=True)
        ]
        covariance = np.diag(np.square(own))
        common = [numbered(one.common) for one in seen]
        for name in dict.fromkeys(name for errors in common for name in errors if name[0] not in METER_SOURCES):
            pattern = np.array([float(errors[name].relative) if name in errors else 0.0 for errors in common])
            covariance = covariance + np.outer(pattern, pattern)
        return cls(tuple(seen), readings, deviation, covariance)

    def mean(self) -> tuple[float, float]:
        """Mean deviation by generalised least squares, and its standard uncertainty without the meters' scales."""
        weights = np.linalg.solve(self.covariance, np.ones(self.deviation_rel.size))
        return float(weights @ self.deviation_rel / weights.sum()), 1 / sqrt(weights.sum())

    def drift(self, calibration: Calibration) -> Drift:
        """Return the mean deviation as a change of a plane's responsivity."""
        mean, u = self.mean()
        scale, scales = self.readings.scale, self.readings.scales
        responsivity = calibration.responsivity.responsivity_dn_s_cd_m2 * (1 + mean)
        return Drift(mean, expanded_rel(scales, u), responsivity, expanded_rel([scale], u))

    def rows(self, tolerance_rel: float) -> tuple[VerifiedPatch, ...]:
        """One row per patch."""
        scales, normal = self.readings.scales, np.sqrt(np.diag(self.covariance))
        of_scales = hypot(*(one.common_rel for one in scales))
        return tuple(
            VerifiedPatch.of(
                self.readings.joined[s.patch],
                s.luminance_cd_m2,
                s.exposures_s,
                deviation_rel=deviation,
                standard_uncertainty_rel=hypot(u, of_scales),
                expanded_rel=expanded_rel(scales, u),
                independent_rel=u,
                tolerance_rel=tolerance_rel,
            )
            for s, deviation, u in zip(self.seen, self.deviation_rel.tolist(), normal.tolist(), strict=True)
        )


def grey_patches(calibration: ColourCalibration) -> set[str]:
    """Names of the patches that the planes were fitted to: those of one spectrum, for which all planes agree."""
    return set.intersection(*({row.patch for row in plane.residuals} for plane in calibration.planes))


def balanced(
    calibration: ColourCalibration,
    groups: Mapping[str, Mapping[str, Sequence[PatchObservation]]],
    readings: Readings,
    uneven_rel: Mapping[str, float],
    planes: Sequence[VerifiedPlane],
) -> list[VerifiedPlane]:
    """Add to each plane its change against the meter, and its deviation from all planes together.

    Parameters
    ----------
    calibration : ColourCalibration
        Calibration to verify.
    groups : mapping
        New observations by patch, then by plane; only the grey patches of the calibration are used.
    readings : Readings
        Of these patches.
    uneven_rel : mapping of str to float
        Non-uniformity of each of these patches.
    planes : sequence of VerifiedPlane
        The planes, in the calibration's order.
    """
    seen = [
        own for name in groups if name in grey_patches(calibration) and (own := _of_planes(calibration, groups[name]))
    ]
    if not seen:
        return list(planes)
    by_plane = list(zip(*seen, strict=True))
    luminance = np.array([[one.luminance_cd_m2 for one in of_plane] for of_plane in by_plane])
    shares = np.array(calibration.weights)[:, None] * luminance
    shares = (shares / shares.sum(axis=0)).mean(axis=1)
    balance = (luminance / (np.array(calibration.weights) @ luminance) - 1).mean(axis=1)
    errors = np.array([_own_rel(plane, own) for plane, own in zip(calibration.planes, by_plane, strict=True)])
    against_all = np.eye(len(planes)) - shares
    u = np.sqrt(np.square(against_all) @ np.square(errors))
    return [
        replace(
            one,
            drift=Comparison.of(own, readings, uneven_rel).drift(plane),
            balance_rel=float(balance[n]),
            balance_expanded_rel=expanded_half_width(0.0, float(u[n])),
            share=float(shares[n]),
        )
        for n, (one, plane, own) in enumerate(zip(planes, calibration.planes, by_plane, strict=True))
    ]


def _of_planes(
    calibration: ColourCalibration, group: Mapping[str, Sequence[PatchObservation]]
) -> list[PatchLuminance] | None:
    try:
        return [patch_luminance(plane, group[f"{plane.state.plane}"]) for plane in calibration.planes]
    except CalibrationError:
        return None


def _own_rel(plane: Calibration, own: Sequence[PatchLuminance]) -> float:
    """Relative standard uncertainty of the mean over patches of a plane, by what differs from plane to plane."""
    noise = sum(own_rel(plane, one) ** 2 for one in own) / len(own) ** 2
    scatter = plane.responsivity.scatter_rel**2 / len(own)
    return sqrt(noise + scatter + max(one.fit_rel for one in own) ** 2)
