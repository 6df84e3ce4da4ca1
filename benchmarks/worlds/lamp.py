"""Light of a lamp that is not steady, mean over an exposure in closed form."""

from __future__ import annotations

from math import cos, pi

import numpy as np

from .world import World


def light_of_lamp(world: World, exposure_s: float, rng: np.random.Generator, phase: float | None = None) -> float:
    """Light of the lamp in a frame, relative to its mean.

    The sum of two effects: a random one from frame to frame, of which a longer exposure may see less, and a periodic
    one, which the frame begins at a phase in periods, None for any.
    """
    # Not below 0: a lamp that flickers still shines.
    share = min(1.0, world.flicker_period_s / exposure_s)
    light = max(1 + world.flicker_rel * share * float(rng.normal()), 0.0)
    if world.ripple_rel:
        begins = float(rng.uniform()) if phase is None else phase
        light *= 1 + world.ripple_rel * mean_of_wave(world, begins, exposure_s)
    return light


def mean_of_wave(world: World, begins: float, exposure_s: float) -> float:
    """Mean of a wave between -1 and 1, a sine or pulses of half of the period, from a phase on.

    A sine is the first harmonic of what a rectifier leaves of the mains, at twice their frequency; LEDs are dimmed by
    pulses (IEEE Std 1789-2015, whose modulation, (max - min) / (max + min), is the wave's amplitude over the mean).
    """
    periods = world.ripple_hz * exposure_s
    ends = begins + periods
    if world.ripple == "sine":
        return (cos(2 * pi * begins) - cos(2 * pi * ends)) / (2 * pi * periods)
    return (_of_pulses(ends) - _of_pulses(begins)) / periods


def _of_pulses(phase: float) -> float:
    """Integral of pulses, 1 in the first half of each period and -1 in the second, from 0 to a phase."""
    return 0.5 - abs(phase % 1 - 0.5)
