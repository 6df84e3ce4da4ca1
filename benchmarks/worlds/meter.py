"""Readings of a luminance meter in plain NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .world import World

#: Dates of the meter's calibrations: before the bench, and after half the patches.
DATES = ("2025-06-01", "2026-01-01")


@dataclass(frozen=True)
class Shown:
    """A reading: patch, value and time in seconds, and the date of the meter's calibration."""

    patch: str
    value_cd_m2: float
    second: float
    calibrated: str


def scale_errors(world: World, rng: np.random.Generator) -> tuple[float, float]:
    """Relative scale error of the readings before and after the meter may be readjusted, or the lamp change at once."""
    first, second = rng.uniform(-world.scale_half_width_rel, world.scale_half_width_rel, 2)
    if world.lamp_step_rel:
        second = first + world.lamp_step_rel * rng.normal()
    return float(first), float(second if world.recalibrated or world.lamp_step_rel else first)


def read_patches(
    world: World,
    luminances_cd_m2: dict[str, float],
    scales: tuple[float, float],
    rng: np.random.Generator,
    start_s: float,
    end_s: float,
) -> list[Shown]:
    """Read patch by patch between two times; the light of each falls with the lamp.

    The error of the digits is the same for all readings of a patch, as the same light gives the same number. A meter
    that lags is a low pass of first order: each reading has a share of the one before, the first ones settled.
    """
    total = len(luminances_cd_m2) * world.readings
    wrong = set(rng.permutation(total)[: world.wrong_readings].tolist()) if world.wrong_reading_rel else set()
    shown, settled = list[Shown](), float("nan")
    for number, (patch, luminance) in enumerate(luminances_cd_m2.items()):
        half = int(number >= len(luminances_cd_m2) / 2)
        shift = rng.uniform(-(world.digits - 0.5), world.digits - 0.5) * world.resolution_cd_m2
        for again in range(world.readings):
            index = number * world.readings + again
            second = start_s + (end_s - start_s) * index / total
            light = luminance * lamp(world, second) * (1 + scales[half])
            settled = light if index == 0 else light + world.meter_lag_rel * (settled - light)
            value = settled * (1 + rng.normal(0, world.repeatability_rel * world.noisier)) + shift
            if index in wrong:
                value *= 1 + float(rng.choice([-1, 1])) * world.wrong_reading_rel
            value = max(round(value / world.resolution_cd_m2), 0) * world.resolution_cd_m2
            stated = half if world.recalibrated == "stated" else 0
            shown.append(Shown(patch, value, second, DATES[stated]))
    return shown


#: Length of a calibration.
SESSION_S = 3600.0


def lamp(world: World, second: float) -> float:
    """Light of the lamp relative to the first frame."""
    return 1 - world.drift_rel * second / SESSION_S
