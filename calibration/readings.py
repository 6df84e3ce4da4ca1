"""What the meter saw: the readings of a patch joined to one luminance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from math import hypot, sqrt

import numpy as np

from ..errors import CalibrationError
from ..reading import CD_M2_PER_FL, MeterIdentity, Reading
from .findings import LeftOut

#: Probability of scatter this large by chance, below which the patch itself must have changed.
_CHANCE = 0.001
#: How near a factor must be to 10 or to fL per cd/m^2 to be called by that name: meters and cameras agree to this.
_HINT_TOLERANCE = 0.1


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
        How many readings were used.
    read_at : datetime
        Mean time of the readings.
    left_out : tuple of LeftOut
        Readings that were not used.
    """

    patch: str
    luminance_cd_m2: float
    random_cd_m2: float
    n_readings: int
    read_at: datetime
    left_out: tuple[LeftOut, ...] = ()


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

    The repeatability averages down. The digits do not: the same light gives the same rounded number again. Rows that
    are there twice count once. Of three or more readings one that contradicts the others, which agree, is left out. If
    the readings scatter more than repeatability and digits explain, their own standard deviation takes the place of the
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
    numbered = list(enumerate(readings, start=1))
    once = [(k, r) for i, (k, r) in enumerate(numbered) if r not in readings[:i]]
    warnings, left_out = [], []
    if len(once) < len(numbered):
        warnings.append(
            f"{len(numbered) - len(once)} readings of patch {patch!r} are there twice, with the same time and value: "
            "each is used once"
        )
        kept_numbers = {k for k, _ in once}
        left_out += [
            LeftOut(patch, None, k, "is a copy of another reading") for k, _ in numbered if k not in kept_numbers
        ]
    bad = _contradicting([reading for _, reading in once])
    if bad is not None:
        number, reading = once.pop(bad)
        others = float(np.mean([r.luminance_cd_m2 for _, r in once]))
        left_out.append(_bad_reading(patch, number, reading, others))
        warnings.append(f"{left_out[-1].reason}: left out")
    mean, random, steady = _mean([reading for _, reading in once])
    if not steady:
        scatter = float(np.std([r.luminance_cd_m2 for _, r in once], ddof=1)) / mean
        warnings.append(
            f"the readings of patch {patch!r} scatter by {scatter:.2%}, more than the meter does: check that the light "
            "is steady and the meter points at the same spot"
        )
    first = once[0][1].timestamp
    read_at = first + sum((r.timestamp - first for _, r in once), timedelta()) / len(once)
    return PatchReading(patch, mean, random, len(once), read_at, tuple(left_out)), warnings


def single_reading(joined: PatchReading, readings: Sequence[Reading], number: int) -> PatchReading:
    """Take one of two readings that contradict each other.

    Parameters
    ----------
    joined : PatchReading
        What `combine_readings` made of both.
    readings : sequence of Reading
        All of the patch.
    number : int
        Which to keep, counted from 1.
    """
    kept = readings[number - 1]
    left_out = [
        _bad_reading(joined.patch, k, r, kept.luminance_cd_m2)
        for k, r in enumerate(readings, start=1)
        if k != number and r != kept and all(k != row.reading for row in joined.left_out)
    ]
    mean, random, _ = _mean([kept])
    return PatchReading(joined.patch, mean, random, 1, kept.timestamp, (*joined.left_out, *left_out))


def contradict(readings: Sequence[Reading]) -> bool:
    """Whether readings of one patch scatter more than the meter does."""
    return not _mean(readings)[2]


def _bad_reading(patch: str, number: int, reading: Reading, expected_cd_m2: float) -> LeftOut:
    shown = reading.luminance_cd_m2
    return LeftOut(
        patch,
        None,
        number,
        f"reading {number} of patch {patch!r} is {shown:.4g} cd/m^2, {shown / expected_cd_m2:.3g} times "
        f"{expected_cd_m2:.4g} cd/m^2{ratio_hint(shown / expected_cd_m2)}",
    )


def ratio_hint(ratio: float) -> str:
    """Say what a factor between a reading and the truth looks like, as a clause; empty if like nothing known."""
    for factor, meaning in (
        (10.0, "a decimal point in the wrong place"),
        (100.0, "a decimal point in the wrong place"),
        (1000.0, "a decimal point in the wrong place"),
        (CD_M2_PER_FL, "a value in fL taken as cd/m^2, or the reverse"),
    ):
        if any(abs(ratio / f - 1) < _HINT_TOLERANCE for f in (factor, 1 / factor)):
            return f" (it looks like {meaning})"
    return ""


def _mean(readings: Sequence[Reading]) -> tuple[float, float, bool]:
    """Mean, its standard uncertainty without the scale, and whether the readings agree."""
    values = np.array([reading.luminance_cd_m2 for reading in readings])
    n = values.size
    repeatability = [r.repeatability_rel * r.luminance_cd_m2 for r in readings]
    digits = [r.digits_half_width * r.cd_m2_per_unit / sqrt(3) for r in readings]
    variance = float(np.mean(np.square(repeatability)))
    steady = True
    if n > 1:
        observed = float(np.var(values, ddof=1))
        steady = _chance_of_scatter(observed, variance + float(np.mean(np.square(digits))), n - 1) >= _CHANCE
        if not steady:
            variance = observed
    return float(values.mean()), hypot(sqrt(variance / n), float(np.mean(digits))), steady


def _contradicting(readings: Sequence[Reading]) -> int | None:
    """Place of the one reading without which the others agree; None if they all do, or more than one is wrong."""
    if len(readings) < 3 or _mean(readings)[2]:
        return None
    sound = [i for i in range(len(readings)) if _mean([r for k, r in enumerate(readings) if k != i])[2]]
    return sound[0] if len(sound) == 1 else None


def _chance_of_scatter(observed_variance: float, expected_variance: float, freedom: int) -> float:
    from scipy.special import chdtrc

    if observed_variance <= expected_variance:
        return 1.0
    if expected_variance == 0:
        return 0.0
    return float(chdtrc(freedom, freedom * observed_variance / expected_variance))
