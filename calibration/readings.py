"""What the meter saw: the readings of a patch joined to one luminance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from ..errors import CalibrationError
from ..reading import MeterIdentity, Reading

#: Probability of scatter this large by chance, below which the patch itself must have changed.
_CHANCE = 0.001


@dataclass(frozen=True)
class PatchReading:
    """Luminance of a patch by the meter.

    Parameters
    ----------
    patch : str
        Name of the patch.
    luminance_cd_m2 : float
        Mean of the readings.
    random_cd_m2 : float
        Standard uncertainty without the meter's scale, in cd/m^2.
    n_readings : int
        How many readings.
    """

    patch: str
    luminance_cd_m2: float
    random_cd_m2: float
    n_readings: int


@dataclass(frozen=True)
class MeterScale:
    """The meter, and the error all its readings share.

    Parameters
    ----------
    meter : MeterIdentity
        Which meter.
    half_width_rel : float
        Half width of the relative scale error (rectangular).
    """

    meter: MeterIdentity
    half_width_rel: float


def meter_scale(readings: Mapping[str, Sequence[Reading]]) -> MeterScale:
    """Return the one meter of all readings, and the largest scale error stated with them.

    Raises
    ------
    CalibrationError
        If there is no reading, or the readings come from several meters.
    """
    every = [reading for group in readings.values() for reading in group]
    if not every:
        raise CalibrationError("there are no meter readings: measure every patch with the luminance meter")
    first = every[0].meter
    for reading in every:
        if reading.meter != first:
            raise CalibrationError(
                f"readings come from meters {first.model} {first.serial} and {reading.meter.model} "
                f"{reading.meter.serial}: calibrate with one meter, its scale error is common to all patches"
            )
    return MeterScale(first, max(reading.scale_half_width_rel for reading in every))


def combine_readings(patch: str, readings: Sequence[Reading]) -> tuple[PatchReading, list[str]]:
    """Join the readings of one patch.

    The repeatability averages down. The digits do not: the same light gives the same rounded number again. If the
    readings scatter more than repeatability and digits explain, their own standard deviation takes the place of the
    repeatability.

    Parameters
    ----------
    patch : str
        Name of the patch.
    readings : sequence of Reading
        At least one, of present values (not peaks), in cd/m^2 or fL.

    Returns
    -------
    PatchReading
        Mean and standard uncertainty.
    list of str
        Warnings.

    Raises
    ------
    CalibrationError
        If there is no reading, or one is a held peak.
    InputError
        If a reading is a ratio in %.
    """
    if not readings:
        raise CalibrationError(f"patch {patch!r} has no meter reading: measure it, or leave the patch out")
    for reading in readings:
        if reading.peak:
            raise CalibrationError(
                f"reading {reading.raw!r} of patch {patch!r} is a held peak: set the meter to CONT and measure again"
            )
    values = np.array([reading.luminance_cd_m2 for reading in readings])
    n = values.size
    repeatability = [r.repeatability_rel * r.luminance_cd_m2 for r in readings]
    digits = [r.digits_half_width * r.cd_m2_per_unit / sqrt(3) for r in readings]
    variance = float(np.mean(np.square(repeatability)))
    warnings = []
    if n > 1:
        observed = float(np.var(values, ddof=1))
        if _chance_of_scatter(observed, variance + float(np.mean(np.square(digits))), n - 1) < _CHANCE:
            warnings.append(
                f"the readings of patch {patch!r} scatter by {sqrt(observed) / values.mean():.2%}, more than the "
                "meter does: check that the light is steady and the meter points at the same spot"
            )
            variance = observed
    mean = float(values.mean())
    return PatchReading(patch, mean, hypot(sqrt(variance / n), float(np.mean(digits))), n), warnings


def _chance_of_scatter(observed_variance: float, expected_variance: float, freedom: int) -> float:
    from scipy.special import chdtrc

    if observed_variance <= expected_variance:
        return 1.0
    if expected_variance == 0:
        return 0.0
    return float(chdtrc(freedom, freedom * observed_variance / expected_variance))
