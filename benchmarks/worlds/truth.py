"""The true CDP: brute force over many pixels of the same make, converted without error."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .camera import BAYER, Array, Device, applied_s, read_out, straightened
from .target import Target

#: Pixels drawn of each region.
PIXELS = 40_000


def true_pixels(
    device: Device,
    target: Target,
    patch: str,
    exposure_s: float,
    rng: np.random.Generator,
    *,
    weights: Mapping[str, float],
    lamp: float = 1.0,
    without: frozenset[str] = frozenset(),
) -> Array:
    """Luminances that other pixels of this make show in one frame.

    Parameters
    ----------
    device : Device
        Its responsivity and world; not its patterns, which are drawn anew.
    target : Target
        True light, of which the camera may receive a little less or more.
    patch : str
        Which of its patches.
    exposure_s : float
        Exposure time.
    rng : numpy.random.Generator
        Of noise and patterns.
    weights : mapping of str to float
        Of the colour planes, on any scale; one entry for a monochrome sensor.
    lamp : float
        Light of the lamp in the frame, relative to its mean.
    without : frozenset of str
        Patterns that the calibration takes off, ``prnu`` and ``dsnu``.
    """
    world = device.world
    luminance_cd_m2, colour = target.luminance_cd_m2[patch], target.colour[patch]
    x, y, width, height = target.regions[patch]
    v, of_converter = (
        np.resize(pattern[y : y + height, x : x + width].ravel(), PIXELS)
        for pattern in (device.vignetting, device.gain)
    )
    # What the region has in common is an error of the calibration, and no property of its pixels.
    gain = 1.0 if "prnu" in without else of_converter / of_converter.mean()
    light_cd_m2 = lamp * luminance_cd_m2 * np.resize(target.shape[patch], PIXELS)
    total = sum(weight * colour.get(plane, 1.0) for plane, weight in weights.items())
    values = np.zeros(PIXELS)
    for plane, weight in weights.items():
        per_cd_m2 = device.responsivity_e_s_cd_m2 * applied_s(world, exposure_s) * BAYER.get(plane, 1.0) * v
        prnu = 1 if "prnu" in without else 1 + world.prnu_rel * rng.normal(size=PIXELS)
        dsnu_dn = 0 if "dsnu" in without else world.k_dn_per_e * world.dsnu_e * rng.normal(size=PIXELS)
        lines_dn = np.hypot(world.column_dn, world.row_dn) * rng.normal(size=PIXELS)
        light_e = per_cd_m2 * light_cd_m2 * colour.get(plane, 1.0) * prnu
        dn = read_out(light_e, world, exposure_s, dsnu_dn + lines_dn, rng, gain)
        dark_dn = world.black_dn + world.k_dn_per_e * world.dark_current_e_s * exposure_s
        net_dn = straightened(dn.astype(float), world) - dark_dn
        values += weight / total * net_dn / (world.k_dn_per_e * per_cd_m2)
    return values


def cdp(bright: Array, dark: Array, contrast: float, epsilon: float) -> float:
    """Share of all pairs whose Weber contrast is within the tolerance of the asked one."""
    low, high = contrast * (1 - epsilon), contrast * (1 + epsilon)
    positive, lit = np.sort(dark[dark > 0]), bright[bright > 0]
    first = np.searchsorted(positive, lit / (1 + high), side="left")
    last = np.searchsorted(positive, lit / (1 + low), side="right")
    return float((last - first).sum() / (bright.size * dark.size))
