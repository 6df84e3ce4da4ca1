"""Frames of a camera in plain NumPy: one function for each stage between light and DN."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import exp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .captures import full_scale, merged, noise_dn, received, sent
from .optics import spread
from .world import (
    BRIGHTEST_CD_M2,
    BRIGHTEST_SHARE,
    DOUBLING_K,
    FOCAL_LENGTH_M,
    FULL_SCALE_DN,
    HEIGHT,
    PITCH_M,
    WARM_UP_S,
    WIDTH,
    World,
)

Array = NDArray[np.float64]
#: Responsivity of red, green (both) and blue pixels, relative to green.
BAYER = {"R": 0.6, "Gr": 1.0, "Gb": 1.0, "B": 0.5}
#: Row and column of each filter in the upper left 2 x 2 pixels.
_PLACES = {"R": (0, 0), "Gr": (0, 1), "Gb": (1, 0), "B": (1, 1)}
#: V(lambda) and sensitivities of the filters at 450, 500, 550, 600 and 650 nm.
_V = np.array([0.038, 0.323, 0.995, 0.631, 0.107])
_SENSITIVITY = {
    "R": np.array([0.02, 0.05, 0.15, 0.9, 0.6]),
    "Gr": np.array([0.1, 0.6, 1.0, 0.35, 0.08]),
    "Gb": np.array([0.1, 0.6, 1.0, 0.35, 0.08]),
    "B": np.array([0.9, 0.5, 0.08, 0.03, 0.02]),
}


@dataclass(frozen=True, eq=False)
class Device:
    """One camera of a world: its responsivity in electrons, and the patterns of its pixels.

    Parameters
    ----------
    world : World
        What all cameras of this make have in common.
    responsivity_e_s_cd_m2 : float
        Of a green or monochrome pixel on the axis.
    vignetting, filters, prnu, dsnu_e, column_dn, gain : ndarray of float, shape (height, width)
        Patterns; `prnu` and `gain`, that of the converters, have the mean 1.
    """

    world: World
    responsivity_e_s_cd_m2: float
    vignetting: Array
    filters: Array
    prnu: Array
    dsnu_e: Array
    column_dn: Array
    gain: Array


def make_device(world: World, rng: np.random.Generator) -> Device:
    """Draw a camera; responsivities differ by up to 15 %."""
    shape = (HEIGHT, WIDTH)
    filters = filter_pattern(BAYER, shape) if world.bayer else np.ones(shape)
    # Coloured patches give up to twice the signal of grey ones in one of the planes.
    share = BRIGHTEST_SHARE / 2 if world.coloured else BRIGHTEST_SHARE
    full_e = share * (full_scale(world) - world.black_dn) / world.k_dn_per_e
    return Device(
        world,
        full_e / (BRIGHTEST_CD_M2 * min(world.exposures_s)) * rng.uniform(0.85, 1.15),
        vignetting(world, rng),
        filters,
        1 + world.prnu_rel * rng.normal(size=shape),
        world.dsnu_e * rng.normal(size=shape),
        np.tile(world.column_dn * rng.normal(size=WIDTH), (HEIGHT, 1)),
        gain_of_converters(world),
    )


def gain_of_converters(world: World) -> Array:
    """Gain of each pixel's converter relative to the mean.

    Sensors with several taps convert neighbouring columns, or the halves of the image, by converters whose gains agree
    only to about 1 % (EMVA 1288 Release 4.0 calls for the columns' own non-uniformity for this reason).
    """
    column = np.arange(WIDTH)
    first = column % 2 == 0 if world.converters == "columns" else column < WIDTH / 2
    return np.tile(1 + world.converters_rel * np.where(first, 0.5, -0.5), (HEIGHT, 1))


def warming(device: Device, second: float) -> Device:
    """Return a camera a time after it was switched on: cooler than in the end, and of another responsivity.

    Temperature and responsivity approach those of the camera in the end exponentially, as a body that loses heat in
    proportion to its excess temperature does (Newton's law of cooling).
    """
    world, left = device.world, exp(-second / WARM_UP_S)
    if not (world.warm_up_k or world.warm_up_rel):
        return device
    cooler_k = world.warm_up_k * left
    then = replace(
        world,
        temperature_c=world.temperature_c - cooler_k,
        dark_current_e_s=world.dark_current_e_s * 2 ** (-cooler_k / DOUBLING_K),
    )
    r = device.responsivity_e_s_cd_m2 * (1 + world.warm_up_rel * left)
    return replace(device, world=then, responsivity_e_s_cd_m2=r)


def filter_pattern(of_filter: Mapping[str, float], shape: tuple[int, int]) -> Array:
    """Give each pixel the value of its filter; without filters, that of ''."""
    pattern = np.full(shape, of_filter.get("", 1.0))
    for name, (y, x) in _PLACES.items():
        if name in of_filter:
            pattern[y::2, x::2] = of_filter[name]
    return pattern


def random_colour(rng: np.random.Generator) -> dict[str, float]:
    """Signal of a coloured patch by filter, relative to a grey one of the same luminance; its spectrum is smooth."""
    at = np.linspace(-1, 1, 5)
    spectrum = np.exp(0.5 * (rng.normal() * at + rng.normal() * (2 * at**2 - 1)))
    luminance = (_V @ spectrum) / _V.sum()
    return {name: float(s @ spectrum / s.sum() / luminance) for name, s in _SENSITIVITY.items()}


def vignetting(world: World, rng: np.random.Generator) -> Array:
    """Light on each pixel relative to the axis."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    y, x = y - (HEIGHT - 1) / 2, x - (WIDTH - 1) / 2
    cos4: Array = (1 + (x**2 + y**2) * (PITCH_M / FOCAL_LENGTH_M) ** 2) ** -2.0
    if world.vignetting == "cos4":
        return cos4
    if world.vignetting == "near cos4":
        return np.asarray(cos4 * (1 + 0.05 * rng.normal() * (x**2 + y**2) / ((HEIGHT**2 + WIDTH**2) / 4)))
    # The rim of the lens takes light from the corners, and sits a little beside the axis.
    r2 = ((x - 4) ** 2 + (y + 3) ** 2) / ((HEIGHT**2 + WIDTH**2) / 4)
    return np.asarray(cos4 * (1 - 0.12 * r2 - 0.08 * r2**2))


def veiled(light: Array, glare_rel: float) -> Array:
    """Add glare: a share of all light, spread evenly."""
    return light + glare_rel * light.mean()


def electrons(mean_e: Array, world: World, exposure_s: float, rng: np.random.Generator) -> Array:
    """Photoelectrons and dark electrons of an exposure."""
    drawn = rng.poisson(mean_e + world.dark_current_e_s * exposure_s)
    return np.minimum(drawn, world.full_well_e).astype(float)


def analogue_dn(
    charge_e: Array, world: World, offset_dn: Array | float, rng: np.random.Generator, gain: Array | float = 1.0
) -> Array:
    """DN before the response, not rounded: read noise, gain, black level and further offsets."""
    read_e = charge_e + world.read_noise_e * rng.normal(size=charge_e.shape)
    return world.k_dn_per_e * gain * read_e + world.black_dn + offset_dn


def curved(linear_dn: Array, world: World) -> Array:
    """Response of the electronics: a cubic term or straight pieces above black, or a tone curve over all DN."""
    if world.gamma != 1:
        return np.asarray(FULL_SCALE_DN * (np.maximum(linear_dn, 0) / FULL_SCALE_DN) ** (1 / world.gamma))
    if world.knees:
        return np.asarray(np.interp(linear_dn, *_pieces(world)))
    if not world.cubic:
        return linear_dn
    x = (linear_dn - world.black_dn) / (FULL_SCALE_DN - world.black_dn)
    return linear_dn - (FULL_SCALE_DN - world.black_dn) * world.cubic * x**3


def _pieces(world: World) -> tuple[Array, Array]:
    """Linear DN where the slope changes and DN of the response there, from far below black to full scale."""
    starts, slopes = np.array([(0.0, 1.0), *world.knees]).T
    range_dn = FULL_SCALE_DN - world.black_dn
    at = np.array([-1.0, *starts, 1.0])
    value = np.concatenate([[-1.0, 0.0], np.cumsum(slopes * np.diff(at[1:]))])
    # Full scale stays full scale, so that the lowest piece is steeper than 1.
    return world.black_dn + range_dn * at, world.black_dn + range_dn * value / value[-1]


def straightened(dn: Array, world: World) -> Array:
    """Inverse of `curved`; a cubic term is inverted by Newton's method."""
    if world.captures:
        return received(dn, world)
    if world.gamma != 1:
        return np.asarray(FULL_SCALE_DN * (dn / FULL_SCALE_DN) ** world.gamma)
    if world.knees:
        return np.asarray(np.interp(dn, *reversed(_pieces(world))))
    scale = FULL_SCALE_DN - world.black_dn
    y = (dn - world.black_dn) / scale
    x = y
    for _ in range(5 if world.cubic else 0):
        x = x - (x - world.cubic * x**3 - y) / (1 - 3 * world.cubic * x**2)
    return world.black_dn + scale * x


def digitised(dn: Array) -> NDArray[np.uint16]:
    """Round and clip to 12 bits."""
    return np.clip(np.rint(dn), 0, FULL_SCALE_DN).astype(np.uint16)


def expose(
    device: Device,
    scene_cd_m2: Array | float,
    exposure_s: float,
    rng: np.random.Generator,
    breathing: float = 1.0,
    lamp: float = 1.0,
    before_s: float | None = None,
) -> NDArray[np.unsignedinteger]:
    """Take a frame of a scene.

    Parameters
    ----------
    device : Device
        The camera.
    scene_cd_m2 : ndarray of float or float
        Light of the scene; 0 for the lens cap.
    exposure_s : float
        Exposure time.
    rng : numpy.random.Generator
        Of all noise.
    breathing : float
        Factor on the responsivity by the focus.
    lamp : float
        Light of the lamp relative to its mean.
    before_s : float or None
        Exposure of the frame before, of the same scene, times the light of the lamp; None for the same as this one.
    """
    world = device.world
    exposed_s = applied_s(world, exposure_s)
    light = veiled(spread(np.broadcast_to(scene_cd_m2, device.prnu.shape) * device.vignetting, world), world.glare_rel)
    per_s = device.responsivity_e_s_cd_m2 * breathing * light * device.filters * device.prnu
    mean_e = lagging(per_s * exposed_s * lamp, None if before_s is None else per_s * before_s, world)
    rows_dn = world.row_dn * rng.normal(size=(HEIGHT, 1))
    offset_dn = device.column_dn + rows_dn + world.black_drift_dn * rng.normal() + world.k_dn_per_e * device.dsnu_e
    # With the lens cap no light reaches the columns by which the black level is clamped.
    offset_dn = offset_dn + (world.light_offset_dn if np.any(light) else 0.0)
    return read_out(mean_e, world, exposure_s, offset_dn, rng, device.gain)


def read_out(
    light_e: Array,
    world: World,
    exposure_s: float,
    offset_dn: Array | float,
    rng: np.random.Generator,
    gain: Array | float = 1.0,
) -> NDArray[np.unsignedinteger]:
    """DN or codes of mean photoelectrons."""
    if world.captures:
        return sent(merged(light_e, world, exposure_s, offset_dn, rng), world)
    charge_e = electrons(light_e, world, exposure_s, rng)
    return digitised(curved(analogue_dn(charge_e, world, offset_dn, rng, gain), world))


def applied_s(world: World, exposure_s: float) -> float:
    """Exposure time that the camera applies where it states another one."""
    return exposure_s * dict(world.exposure_factors).get(exposure_s, 1.0) + world.exposure_offset_s


def lagging(mean_e: Array, before_e: Array | None, world: World) -> Array:
    """Mean photoelectrons of a frame, of which a share stays for the next one, with those that the last one has left.

    Charge that a barrier or traps hold back between photodiode and sense node is read with the next frame (L.-E.
    Bonjour et al., IEEE Electron Device Letters 33 (2012) 1735). Parts of a Poisson process are Poisson processes.
    """
    if before_e is None or not world.image_lag_rel:
        return mean_e
    kept = np.minimum(before_e, world.full_well_e)
    return (1 - world.image_lag_rel) * mean_e + world.image_lag_rel * kept


def expected_dn(device: Device, luminance_cd_m2: Any, exposure_s: float) -> Any:
    """Mean DN on the axis of a linear camera without glare, in closed form."""
    world = device.world
    signal_e = (device.responsivity_e_s_cd_m2 * luminance_cd_m2 + world.dark_current_e_s) * exposure_s
    return world.black_dn + world.k_dn_per_e * signal_e


def expected_noise_dn(device: Device, luminance_cd_m2: Any, exposure_s: float) -> Any:
    """Temporal standard deviation of these DN: shot noise, read noise, row noise and rounding (EMVA 1288)."""
    world = device.world
    signal_dn = expected_dn(device, luminance_cd_m2, exposure_s) - world.black_dn
    if world.captures:
        return noise_dn(signal_dn / world.k_dn_per_e, world)
    of_read = (world.k_dn_per_e * world.read_noise_e) ** 2 + world.row_dn**2
    return np.sqrt(world.k_dn_per_e * signal_dn + of_read + 1 / 12)
