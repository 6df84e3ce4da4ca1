"""A sensor that merges captures inside, and sends a curve's codes or linear values, in plain NumPy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .world import FULL_SCALE_DN, World

Array = NDArray[np.float64]
#: Knees of the curve of AR0231: codes of 12 bits and their linear values of 20 bits.
CODES, VALUES = (0, 2048, 3040, 4000), (0, 2048, 65536, 1048576)
#: Share of its range up to which a capture is taken.
_TAKEN = 0.9


def ratios(world: World) -> list[float]:
    """Signal of the first capture over that of each."""
    first = world.captures[0]
    return [first.light * first.k_dn_per_e / (one.light * one.k_dn_per_e) for one in world.captures]


def full_scale(world: World) -> float:
    """Highest linear value, or DN of a single capture."""
    if not world.captures:
        return FULL_SCALE_DN
    last = world.captures[-1]
    end_dn = min(FULL_SCALE_DN - world.black_dn, last.k_dn_per_e * last.full_well_e)
    return world.black_dn + end_dn * ratios(world)[-1]


def merged(
    light_e: Array, world: World, exposure_s: float, offset_dn: Array | float, rng: np.random.Generator
) -> Array:
    """Linear values with black level, not rounded: of each pixel the most sensitive capture that has room.

    Parameters
    ----------
    light_e : ndarray
        Mean photoelectrons of the first capture's photodiode.
    world : World
        With captures; those of the same light are readouts of one charge.
    exposure_s : float
        Exposure time, for dark electrons: what a photodiode of less light has beside its share is taken off.
    offset_dn : ndarray or float
        Further offsets of the first readout's DN; other readouts have as much.
    rng : numpy.random.Generator
        Of all noise.
    """
    dark_e, value = world.dark_current_e_s * exposure_s, np.zeros(np.shape(light_e))
    charges: dict[float, Array] = {}
    first_dark_dn = world.captures[0].k_dn_per_e * dark_e
    is_open = np.ones(np.shape(light_e), dtype=bool)
    for one, ratio in zip(world.captures, ratios(world), strict=True):
        if one.light not in charges:
            charges[one.light] = rng.poisson(light_e * one.light + dark_e)
        seen_e = np.minimum(charges[one.light], one.full_well_e) + one.read_noise_e * rng.normal(size=is_open.shape)
        dn = np.clip(np.rint(one.k_dn_per_e * seen_e + world.black_dn + offset_dn), 0, FULL_SCALE_DN)
        end_dn = min(FULL_SCALE_DN - world.black_dn, one.k_dn_per_e * one.full_well_e)
        net_dn = (dn - world.black_dn) * ratio
        value[is_open] = net_dn[is_open] - (one.k_dn_per_e * dark_e * ratio - first_dark_dn)
        is_open &= dn - world.black_dn > _TAKEN * end_dn
    return value + world.black_dn


def sent(values: Array, world: World) -> NDArray[np.unsignedinteger]:
    """Codes of the curve, or linear values as they are."""
    values = np.minimum(values, full_scale(world))
    if world.coded:
        return np.clip(np.rint(np.interp(values, VALUES, CODES)), 0, CODES[-1]).astype(np.uint16)
    return np.clip(np.rint(values), 0, 2**20 - 1).astype(np.uint32)


def received(dn: Array, world: World) -> Array:
    """Linear values of what was sent."""
    return np.interp(dn, CODES, VALUES) if world.coded else dn


def noise_dn(signal_e: Array, world: World) -> Array:
    """Return the standard deviation of linear values: of the capture that is taken, and of rounding."""
    signal_e, chosen = np.asarray(signal_e, dtype=float), 0
    first = world.captures[0]
    for number, one in enumerate(world.captures[:-1], 1):
        end_dn = min(FULL_SCALE_DN - world.black_dn, one.k_dn_per_e * one.full_well_e)
        chosen = np.where(signal_e * one.light * one.k_dn_per_e > _TAKEN * end_dn, number, chosen)
    light, k, read_e = (np.array([getattr(one, name) for one in world.captures])[chosen]
                        for name in ("light", "k_dn_per_e", "read_noise_e"))  # fmt: skip
    ratio = np.array(ratios(world))[chosen]
    value = world.black_dn + first.k_dn_per_e * signal_e
    slopes = np.array([(b - a) / (d - c) for (a, b), (c, d) in zip(pairwise(VALUES), pairwise(CODES), strict=True)])
    step = slopes[np.clip(np.searchsorted(VALUES, value, side="right") - 1, 0, 2)] if world.coded else 1.0
    return np.sqrt(ratio**2 * (k**2 * (signal_e * light + read_e**2) + 1 / 12) + step**2 / 12)
