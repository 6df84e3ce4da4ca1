"""Readings of a patch, combined to one luminance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from math import hypot, sqrt
from typing import Any, Self

import numpy as np

from ..core.errors import CalibrationError
from ..core.reading import CD_M2_PER_FL, Reading
from ..core.result import Finding, FindingValue, info, warning
from .findings import LeftOut
from .setup import require_one_correction
from .uncertainty import p_value_of_chi_squared

#: p-value of the scatter below which the patch itself has changed.
_CHANCE = 0.001
#: Relative tolerance for recognising a factor as 10 or as fL per cd/m^2.
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
        Number of readings used.
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

    def scaled(self, factor: float) -> PatchReading:
        """Return the reading of a part of the patch that is brighter by a factor."""
        luminance_cd_m2, random_cd_m2 = self.luminance_cd_m2 * factor, self.random_cd_m2 * factor
        return replace(self, luminance_cd_m2=luminance_cd_m2, random_cd_m2=random_cd_m2)


@dataclass(frozen=True)
class MeasuredPatch:
    """A patch by the meter and by the calibrated camera.

    Parameters
    ----------
    patch : str
        Name of the patch.
    reading_cd_m2, reading_random_cd_m2 : float
        By the meter: mean of the readings, and its standard uncertainty without the scale.
    n_readings : int
        Number of readings.
    luminance_cd_m2 : float
        By the calibrated camera.
    exposures_s : tuple of float
        Exposures that were used.
    """

    patch: str
    reading_cd_m2: float
    reading_random_cd_m2: float
    n_readings: int
    luminance_cd_m2: float
    exposures_s: tuple[float, ...]

    @classmethod
    def of(cls, reading: PatchReading, *own: Any, **named: Any) -> Self:
        """Row of a reading, a luminance, its exposures, and what else this kind of row has."""
        of_meter = reading.patch, reading.luminance_cd_m2, reading.random_cd_m2, reading.n_readings
        return cls(*of_meter, *own, **named)


def combine_readings(patch: str, readings: Sequence[Reading]) -> tuple[PatchReading, list[Finding]]:
    """Combine the readings of one patch.

    The repeatability averages; the digit error does not, as the same light gives the same rounded number. Duplicate
    rows are counted once. Of three or more readings, one that contradicts the others is left out if these agree. If the
    readings scatter more than expected from repeatability and digits, their standard deviation is used instead of the
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
    list of Finding
        Findings for the user.

    Raises
    ------
    CalibrationError
        If there is no reading, one is a held peak, or they were taken with different corrections.
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
    require_one_correction((f"reading {n} of patch {patch!r}", r) for n, r in enumerate(readings, start=1))
    findings: list[Finding] = []
    once = distinct(readings)
    copies = [number for number in range(1, len(readings) + 1) if number not in once]
    left_out = [LeftOut(patch, None, number, "copy of another reading") for number in copies]
    if copies:
        findings.append(info("readings-repeated", patch, count=len(copies)))
    bad = _contradicting(once)
    if bad is not None:
        wrong = once.pop(bad).luminance_cd_m2
        others = float(np.mean([r.luminance_cd_m2 for r in once.values()]))
        left_out.append(LeftOut(patch, None, bad, "contradicts the other readings"))
        findings.append(contradiction("reading-contradicts", patch, wrong, others, number=bad))
    kept = [*once.values()]
    mean, random, steady = _mean(kept)
    if not steady:
        scatter = float(np.std([r.luminance_cd_m2 for r in kept], ddof=1)) / mean
        findings.append(warning("readings-scatter", patch, scatter_rel=scatter))
    first = kept[0].timestamp
    read_at = first + sum((r.timestamp - first for r in kept), timedelta()) / len(kept)
    return PatchReading(patch, mean, random, len(kept), read_at, tuple(left_out)), findings


def distinct(readings: Sequence[Reading]) -> dict[int, Reading]:
    """Return readings by their number, counted from 1, without copies of others."""
    return {number: r for number, r in enumerate(readings, start=1) if r not in readings[: number - 1]}


def contradict(readings: Sequence[Reading]) -> bool:
    """Whether readings of one patch scatter more than the meter does."""
    return not _mean(readings)[2]


def contradiction(
    code: str, patch: str, reading_cd_m2: float, expected_cd_m2: float, **values: FindingValue
) -> Finding:
    """Return the finding of a reading that is wrong; the likely cause of the factor is added to the code."""
    ratio = reading_cd_m2 / expected_cd_m2

    def near(factor: float) -> bool:
        return any(abs(ratio / f - 1) < _HINT_TOLERANCE for f in (factor, 1 / factor))

    other_cause = "-unit" if near(CD_M2_PER_FL) else ""
    cause = "-decimal-point" if any(map(near, (10.0, 100.0, 1000.0))) else other_cause
    shown = {"reading_cd_m2": reading_cd_m2, "expected_cd_m2": expected_cd_m2, "ratio": ratio}
    return warning(f"{code}{cause}", patch, **values, **shown)


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
        # Exact readings that differ contradict each other.
        expected = max(variance + float(np.mean(np.square(digits))), 1e-300)
        steady = observed <= expected or p_value_of_chi_squared((n - 1) * observed / expected, n - 1) >= _CHANCE
        if not steady:
            variance = observed
    return float(values.mean()), hypot(sqrt(variance / n), float(np.mean(digits))), steady


def _contradicting(readings: Mapping[int, Reading]) -> int | None:
    """Find the number of the one reading that contradicts the others; None if all agree, or more than one is wrong."""
    if len(readings) < 3 or not contradict([*readings.values()]):
        return None
    sound = [n for n in readings if not contradict([r for number, r in readings.items() if number != n])]
    return sound[0] if len(sound) == 1 else None
