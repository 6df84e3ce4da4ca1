"""Patches by camera and meter, compared: what each difference has alone, and what they share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..luminance import CommonError
from ..reading import Reading
from .model import Calibration
from .observations import DarkObservation, PatchObservation
from .patch import PatchLuminance
from .readings import MeterScale, PatchReading, combine_readings, meter_scale
from .signal import net_signal, usable
from .uncertainty import expanded_half_width
from .verification import WANDER_DN, Drift, VerifiedDark, VerifiedPatch

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Readings:
    """The meter's side of a comparison.

    Parameters
    ----------
    joined : tuple of PatchReading
        One a patch.
    scale : MeterScale
        Of the meter that read them.
    scales : tuple of float
        Half widths of the scale errors that count: none if the meter is the calibration's, in the same state of
        adjustment, else those of both meters.
    measured : datetime
        Time of the last one.
    warnings : tuple of str
        What the user should know.
    """

    joined: tuple[PatchReading, ...]
    scale: MeterScale
    scales: tuple[float, ...]
    measured: datetime
    warnings: tuple[str, ...]

    @property
    def random_rel(self) -> tuple[float, ...]:
        """Relative standard uncertainty of each reading without the scale."""
        return tuple(one.random_cd_m2 / one.luminance_cd_m2 for one in self.joined)


def join_readings(
    patches: Iterable[str], readings: Mapping[str, Sequence[Reading]], calibrated: MeterScale
) -> Readings:
    """Join the readings of each patch, and tell which errors of scale count.

    Raises
    ------
    CalibrationError
        If a patch has no reading or reads 0.
    """
    own = {patch: readings.get(patch, ()) for patch in patches}
    scale = meter_scale(own)
    joined, warnings = [], []
    for patch, group in own.items():
        reading, of_patch = combine_readings(patch, group)
        if reading.luminance_cd_m2 == 0:
            raise CalibrationError(
                f"patch {patch!r} reads 0 cd/m^2, below the meter's range: verify with a brighter patch"
            )
        joined.append(reading)
        warnings += of_patch
    same = scale.meter == calibrated.meter
    scales = () if same else (scale.half_width_rel, calibrated.half_width_rel)
    measured = max(reading.timestamp for group in own.values() for reading in group)
    return Readings(tuple(joined), scale, scales, measured, tuple(warnings))


@dataclass(frozen=True, eq=False)
class Comparison:
    """Patches by the camera against the meter.

    Parameters
    ----------
    seen : tuple of PatchLuminance
        By the camera, n patches.
    readings : Readings
        By the meter.
    relative : ndarray of float, shape (n,)
        Camera over meter, less one.
    covariance : ndarray of float, shape (n, n)
        Of these: what each has alone, and what they share.
    """

    seen: tuple[PatchLuminance, ...]
    readings: Readings
    relative: Array
    covariance: Array

    @property
    def chi_squared(self) -> float:
        """Of all differences, what they share respected; the degrees of freedom are the number of patches."""
        return float(self.relative @ np.linalg.solve(self.covariance, self.relative))

    def mean(self) -> tuple[float, float]:
        """Mean difference, and its variance."""
        mean, covariance = generalised_means(self.relative, self.covariance, np.ones((self.relative.size, 1)))
        return float(mean[0]), float(covariance[0, 0])

    def rows(self, new_dark_cd_m2: Sequence[float | None]) -> tuple[VerifiedPatch, ...]:
        """One row a patch; `new_dark_cd_m2` has the luminances with the new darkness, as far as there are."""
        uncertainty = np.sqrt(np.diag(self.covariance)).tolist()
        rows = zip(self.seen, self.readings.joined, self.relative.tolist(), uncertainty, new_dark_cd_m2, strict=True)
        return tuple(
            VerifiedPatch(
                patch=s.patch,
                reading_cd_m2=r.luminance_cd_m2,
                reading_random_cd_m2=r.random_cd_m2,
                n_readings=r.n_readings,
                luminance_cd_m2=s.luminance_cd_m2,
                difference_rel=difference,
                standard_uncertainty_rel=u,
                with_new_dark_rel=None if new is None else new / r.luminance_cd_m2 - 1,
                exposures_s=s.exposures_s,
            )
            for s, r, difference, u, new in rows
        )


def compare(seen: Sequence[PatchLuminance], readings: Readings, uneven_rel: Sequence[float]) -> Comparison:
    """Compare luminances by the camera with the meter's; `uneven_rel` is the unevenness of each patch itself."""
    relative = [s.luminance_cd_m2 / r.luminance_cd_m2 - 1 for s, r in zip(seen, readings.joined, strict=True)]
    own = [hypot(s.random_rel, r, u) for s, r, u in zip(seen, readings.random_rel, uneven_rel, strict=True)]
    covariance = with_shared_errors(np.array(own), [named_errors(s.common) for s in seen], readings.scales)
    return Comparison(tuple(seen), readings, np.array(relative), covariance)


def generalised_means(values: Array, covariance: Array, design: Array) -> tuple[Array, Array]:
    """Means m of values = design m by generalised least squares, and their covariance."""
    weighted = np.linalg.solve(covariance, design)
    of_means: Array = np.linalg.inv(design.T @ weighted)
    return of_means @ (weighted.T @ values), of_means


def with_shared_errors(
    own_rel: Array, common: Sequence[Mapping[tuple[str, ...], float]], scales: Sequence[float]
) -> Array:
    """Covariance of values: `own_rel` of each, shape (n,), signed errors by name that they share, and scales of all."""
    covariance: Array = np.diag(np.square(own_rel))
    for name in dict.fromkeys(name for errors in common for name in errors):
        pattern = np.array([errors.get(name, 0.0) for errors in common])
        covariance = covariance + np.outer(pattern, pattern)
    for half_width in scales:
        covariance = covariance + half_width**2 / 3
    return covariance


def named_errors(common: Sequence[CommonError]) -> dict[tuple[str, ...], float]:
    """Shared errors of a patch by source and number, without the scale of the calibration's meter."""
    counted: Counter[str] = Counter()
    named: dict[tuple[str, ...], float] = {}
    for error in common:
        # Whether that scale counts is not for the patch to say.
        if error.source != "meter scale":
            counted[error.source] += 1
            named[error.source, f"{counted[error.source]}"] = float(error.relative)
    return named


def unevenness_rel(group: Sequence[PatchObservation], calibration: Calibration) -> float:
    """Unevenness of a patch itself: meter and camera see it at slightly different places, as in the fit."""
    kept, _, _ = usable(group, calibration.settings)
    return float(np.median([net_signal(o, calibration.settings).slow_rel for o in kept]))


def dark_row(dark: DarkObservation, calibration: Calibration, lowest_cd_m2: float, weight: float = 1.0) -> VerifiedDark:
    """One exposure of new dark frames; `weight` is that of the plane in the luminance."""
    model = calibration.setting(dark.state.gain_db).dark
    expected_dn = model.mean_dn(dark.exposure_s, dark.temperature_c)
    own = dark.mean_variance_dn2 + model.variance_dn2(dark.exposure_s, dark.temperature_c)
    light_dn_s = calibration.responsivity.responsivity_dn_s_cd_m2 * lowest_cd_m2
    # The lowest luminance is measured with the longest exposures.
    effect_rel = weight * (dark.mean_dn - expected_dn) / (light_dn_s * calibration.exposures_s[-1])
    uncertainty = hypot(sqrt(own), WANDER_DN / sqrt(3))
    return VerifiedDark(dark.state.plane, dark.exposure_s, dark.mean_dn, expected_dn, uncertainty, effect_rel)


def drift_of(calibration: Calibration, relative: float, variance: float, readings: Readings) -> Drift:
    """Drift of a plane's responsivity, of a mean difference and its variance."""
    without = max(variance - sum(half_width**2 / 3 for half_width in readings.scales), 0.0)
    return Drift(
        relative,
        half_width(variance, readings.scales),
        calibration.responsivity.responsivity_dn_s_cd_m2 * (1 + relative),
        expanded_half_width(readings.scale.half_width_rel, sqrt(without)),
    )


def half_width(variance: float, scales: Sequence[float]) -> float:
    """95 % half width; the largest of the rectangular parts is taken as such, the others as normal."""
    largest = max(scales, default=0.0)
    return expanded_half_width(largest, sqrt(max(variance - largest**2 / 3, 0.0)))


def chance_of(chi_squared: float, degrees_of_freedom: int) -> float:
    """Probability of a chi^2 at least this large."""
    from scipy.special import chdtrc

    return float(chdtrc(degrees_of_freedom, chi_squared))
