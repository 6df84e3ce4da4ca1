"""Readings of a patch, combined to one luminance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from math import inf, sqrt
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..core.errors import CalibrationError
from ..core.reading import CD_M2_PER_FL, Reading
from ..core.result import Finding, FindingValue, info, warning
from .fit_records import LeftOut
from .setup import MeterScale, require_one_correction
from .uncertainty import (
    effective_dof,
    expanded_rel,
    expanded_uncertainty,
    p_value_of_chi_squared,
    variance_from_one_estimate,
)

#: p-values of the scatter below which a patch itself has changed, by chance as rarely in one of ten as three standard
#: deviations of one are exceeded, and below which all readings scatter more than stated.
_CHANCE, _CHANCE_OF_ALL = 3e-4, 3e-3
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
    dof : float
        Degrees of freedom of `random_cd_m2`; infinite where the meter's repeatability is as stated.
    of_all : bool
        Whether it follows from the scatter of all patches' readings, so that it is one estimate for them.
    """

    patch: str
    luminance_cd_m2: float
    random_cd_m2: float
    n_readings: int
    read_at: datetime
    left_out: tuple[LeftOut, ...] = ()
    dof: float = inf
    of_all: bool = False

    @property
    def random_rel(self) -> float:
        """Relative standard uncertainty without the meter's scale."""
        return self.random_cd_m2 / self.luminance_cd_m2

    @property
    def variance_rel(self) -> float:
        """Square of the relative random uncertainty."""
        return self.random_rel**2

    def U_rel(self, meter: MeterScale) -> float:  # noqa: N802 - the symbol of the GUM
        """Return the relative expanded uncertainty U (95 %), the scale error of the meter included."""
        return expanded_rel([meter], self.random_rel, self.dof)

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
        From the calibrated camera.
    exposures_s : tuple of float
        Exposures that were used.
    reading_U_rel : float or None
        Relative U (95 %) of the reading, the meter's scale error included; None in files of labcdp 0.2.0.
    """

    patch: str
    reading_cd_m2: float
    reading_random_cd_m2: float
    n_readings: int
    luminance_cd_m2: float
    exposures_s: tuple[float, ...]
    reading_U_rel: float | None = field(default=None, kw_only=True)  # noqa: N815 - the symbol of the GUM

    @classmethod
    def of(cls, reading: PatchReading, *more: Any, **named: Any) -> Self:
        """Row of a reading, a luminance, its exposures, and what else this kind of row has."""
        of_meter = reading.patch, reading.luminance_cd_m2, reading.random_cd_m2, reading.n_readings
        return cls(*of_meter, *more, **named)


def combine_readings(patch: str, readings: Sequence[Reading]) -> tuple[PatchReading, list[Finding]]:
    """Combine the readings of one patch.

    The repeatability averages; the digit error does not, as the same light gives the same rounded number. Duplicate
    rows are counted once. Of three or more readings, one that contradicts the others is named if these agree. If the
    readings scatter more than expected from repeatability and digits, their standard deviation is used instead of the
    repeatability, with its degrees of freedom.

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
    used, findings = _used(patch, readings)
    return _combined(patch, readings, used), [*findings, *_scatter_findings(patch, used)]


def combine_patches(
    readings: Mapping[str, Sequence[Reading]],
) -> tuple[dict[str, PatchReading], list[Finding]]:
    """Combine the readings of several patches by one meter, whose scatter is that of all of them.

    Two or three readings say little of their scatter. Where those of all patches together scatter more than the meter
    does, all get what they show together, with the degrees of freedom of all, and none is left out for contradicting
    the others. A patch that scatters more than the others has its own scatter.

    Parameters
    ----------
    readings : mapping of str to sequence of Reading
        By patch; as `combine_readings`.

    Returns
    -------
    dict of str to PatchReading
        By patch.
    list of Finding
        Findings for the user.

    Raises
    ------
    CalibrationError, InputError
        As `combine_readings`.
    """
    used: dict[str, dict[int, Reading]] = {}
    findings: list[Finding] = []
    for patch, given in readings.items():
        used[patch], of_patch = _used(patch, given)
        findings += of_patch
    alike = _alike({patch: [*group.values()] for patch, group in used.items() if len(group) > 1})
    dof = sum(len(used[patch]) - 1 for patch in alike)
    chi_squared = sum(_chi_squared([*used[patch].values()]) for patch in alike)
    # One patch alone says nothing of the others.
    widened = len(alike) > 1 and p_value_of_chi_squared(chi_squared, dof) < _CHANCE_OF_ALL
    if widened:
        findings.append(warning("readings-scatter-all", ratio=sqrt(chi_squared / dof), dof=dof))
    result = {}
    for patch, group in used.items():
        if widened and (patch in alike or len(group) == 1):
            result[patch] = _combined(patch, readings[patch], group, (chi_squared / dof, dof))
        else:
            result[patch] = _combined(patch, readings[patch], group)
            findings += _scatter_findings(patch, group)
    return result, findings


def _used(patch: str, readings: Sequence[Reading]) -> tuple[dict[int, Reading], list[Finding]]:
    """Return the readings of a patch that are used, by their number, and findings on the others."""
    if not readings:
        raise CalibrationError(f"patch {patch!r} has no meter reading: measure it, or leave the patch out")
    for reading in readings:
        if reading.peak:
            raise CalibrationError(
                f"reading {reading.raw!r} of patch {patch!r} is a held peak value: set the meter to CONT and measure "
                "again"
            )
    require_one_correction((f"reading {n} of patch {patch!r}", r) for n, r in enumerate(readings, start=1))
    once = distinct(readings)
    n_copies = len(readings) - len(once)
    return once, [info("readings-repeated", patch, count=n_copies)] if n_copies else []


def _values(readings: Sequence[Reading]) -> NDArray[np.float64]:
    return np.array([reading.luminance_cd_m2 for reading in readings])


def _stated(readings: Sequence[Reading]) -> tuple[float, float]:
    """Return the standard uncertainties of a reading by repeatability, and by the digit."""
    repeatability = [r.repeatability_rel * r.luminance_cd_m2 for r in readings]
    digits = [r.digits_half_width * r.cd_m2_per_unit / sqrt(3) for r in readings]
    return sqrt(float(np.mean(np.square(repeatability)))), sqrt(float(np.mean(np.square(digits))))


def _variance(readings: Sequence[Reading]) -> float:
    """Return the expected variance of a reading; exact readings that differ contradict each other."""
    repeatability, digits = _stated(readings)
    return max(repeatability**2 + digits**2, 1e-300)


def _chi_squared(readings: Sequence[Reading]) -> float:
    dof = len(readings) - 1
    return dof * float(np.var(_values(readings), ddof=1)) / _variance(readings) if dof else 0.0


def _is_steady(readings: Sequence[Reading]) -> bool:
    """Whether the readings scatter as the meter does."""
    chi_squared, dof = _chi_squared(readings), len(readings) - 1
    return chi_squared <= dof or p_value_of_chi_squared(chi_squared, dof) >= _CHANCE


def _scatter_findings(patch: str, used: Mapping[int, Reading]) -> list[Finding]:
    readings = [*used.values()]
    if _is_steady(readings):
        return []
    bad = _contradicting(used)
    if bad is not None:
        others = float(np.mean([r.luminance_cd_m2 for number, r in used.items() if number != bad]))
        return [contradiction("reading-contradicts", patch, used[bad].luminance_cd_m2, others, number=bad)]
    values = _values(readings)
    return [warning("readings-scatter", patch, scatter_rel=float(np.std(values, ddof=1) / np.mean(values)))]


def _combined(
    patch: str, given: Sequence[Reading], used: Mapping[int, Reading], of_all: tuple[float, int] | None = None
) -> PatchReading:
    """Mean and uncertainty; `of_all` is a factor of the variance, and degrees of freedom, of all patches."""
    readings = [*used.values()]
    repeatability, digits = _stated(readings)
    variance, dof = repeatability**2, inf
    if of_all is not None:
        variance, dof = of_all[0] * _variance(readings), of_all[1]
    elif not _is_steady(readings):
        dof = len(readings) - 1
        variance = _chi_squared(readings) / dof * _variance(readings)
    times = [r.timestamp for r in readings]
    n, first = len(times), times[0]
    parts = (variance / n, dof), (digits**2, inf)
    copies = [number for number in range(1, len(given) + 1) if number not in used]
    return PatchReading(
        patch=patch,
        luminance_cd_m2=float(_values(readings).mean()),
        random_cd_m2=sqrt(sum(part for part, _ in parts)),
        n_readings=n,
        read_at=first + sum((time - first for time in times), timedelta()) / n,
        left_out=tuple(LeftOut(patch, None, number, "copy of another reading") for number in copies),
        dof=effective_dof(parts),
        of_all=of_all is not None,
    )


def _alike(readings: Mapping[str, Sequence[Reading]]) -> list[str]:
    """Patches whose readings scatter alike: without those of readings beyond the scatter of all others (F test).

    Bad readings hide each other: the one that deviates most from its patch is left out in turn, up to a quarter, and as
    many count as the last one that is significant has before it, as of patches
    (`labcdp.calibration.fitting.selection`).
    """
    from scipy.special import fdtrc

    left = [_values(group) / sqrt(_variance(group)) for group in readings.values()]
    without: set[int] = set()
    odd: set[int] = set()
    n_left = sum(values.size for values in left)
    for _ in range(n_left // 4):
        drops = ((k, _drops(values).max()) for k, values in enumerate(left) if values.size > 1)
        worst, drop = max(drops, key=lambda pair: pair[1])
        left[worst] = np.delete(left[worst], int(np.argmax(_drops(left[worst]))))
        without.add(worst)
        dof = sum(values.size - 1 for values in left)
        if dof < 1:
            break
        usual = max(sum(float(np.sum((values - values.mean()) ** 2)) for values in left) / dof, 1.0)
        if n_left * fdtrc(1, dof, drop / usual) < _CHANCE:
            odd = set(without)
    return [patch for k, patch in enumerate(readings) if k not in odd]


def _drops(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Decrease of the sum of squares about the mean without each value."""
    n = values.size
    drops: NDArray[np.float64] = (values - values.mean()) ** 2 * n / max(n - 1, 1)
    return drops


def parts_of_readings(readings: Sequence[PatchReading], weights: Sequence[float]) -> list[tuple[float, float]]:
    """Relative variances of a weighted sum of readings, with their degrees of freedom, without the meter's scale."""
    parts = [(w**2 * reading.variance_rel, reading.dof) for w, reading in zip(weights, readings, strict=True)]
    of_all = [part for part, reading in zip(parts, readings, strict=True) if reading.of_all]
    apart = [part for part, reading in zip(parts, readings, strict=True) if not reading.of_all]
    return [*apart, variance_from_one_estimate(of_all)]


def expanded_of_readings(readings: Sequence[PatchReading]) -> float:
    """Relative U (95 %) of a product or quotient of readings by one meter, whose scale cancels."""
    return expanded_uncertainty(parts_of_readings(readings, [1.0] * len(readings)))


def distinct(readings: Sequence[Reading]) -> dict[int, Reading]:
    """Return readings by their number, counted from 1, without copies of others."""
    return {number: r for number, r in enumerate(readings, start=1) if r not in readings[: number - 1]}


def contradict(readings: Sequence[Reading]) -> bool:
    """Whether readings of one patch scatter more than the meter does."""
    return not _is_steady(readings)


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


def _contradicting(readings: Mapping[int, Reading]) -> int | None:
    """Find the number of the one reading that contradicts the others; None if all agree, or more than one is wrong."""
    if len(readings) < 3 or not contradict([*readings.values()]):
        return None
    sound = [n for n in readings if not contradict([r for number, r in readings.items() if number != n])]
    return sound[0] if len(sound) == 1 else None
