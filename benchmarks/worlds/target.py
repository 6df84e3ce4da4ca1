"""Targets: patches with their light, those of a calibration and others that are measured with it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .camera import Array, Device, expected_dn, expected_noise_dn, filter_pattern, random_colour
from .captures import full_scale
from .world import BRIGHTEST_CD_M2, HEIGHT, WIDTH, World


@dataclass(frozen=True, eq=False)
class Target:
    """Patches before the camera.

    Parameters
    ----------
    regions : dict of str to (int, int, int, int)
        x, y, width and height of each patch.
    luminance_cd_m2 : dict of str to float
        True luminances.
    colour : dict of str to dict of str to float
        Signal of each patch by filter, relative to grey; empty for grey.
    scene : ndarray of float, shape (height, width)
        Light as the camera receives it, the colours included.
    shape : dict of str to ndarray of float
        Light of each pixel of a region, relative to what the meter sees of the patch.
    """

    regions: dict[str, tuple[int, int, int, int]]
    luminance_cd_m2: dict[str, float]
    colour: dict[str, dict[str, float]]
    scene: Array
    shape: dict[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Pair:
    """Two patches that are compared: their light, and what is asked of them."""

    bright_cd_m2: float
    dark_cd_m2: float
    contrast: float
    epsilon: float

    @property
    def true_contrast(self) -> float:
        """Weber contrast of the light."""
        return self.bright_cd_m2 / self.dark_cd_m2 - 1


def calibration_target(world: World, rng: np.random.Generator) -> Target:
    """Draw patches with logarithmic steps, in random order in a 4 x 4 grid; the rest is grey."""
    steps = np.geomspace(world.darkest_cd_m2, BRIGHTEST_CD_M2, world.patches)
    light = rng.permutation(steps * 10 ** rng.uniform(-0.03, 0.03, world.patches))
    places = np.sort(rng.permutation(16)[: world.patches])
    patches = {f"P{place:02d}": (int(place), float(value)) for place, value in zip(places, light, strict=True)}
    return _target(world, patches, 4, 4, float(np.sqrt(world.darkest_cd_m2 * BRIGHTEST_CD_M2)), rng)


def use_target(world: World, pair: Pair, single_cd_m2: float, rng: np.random.Generator) -> Target:
    """Place both patches of a pair (B and D) and a single one (S) in a 3 x 3 grid."""
    places = rng.permutation(9).tolist()
    light = {"B": pair.bright_cd_m2, "D": pair.dark_cd_m2, "S": single_cd_m2}
    patches = {name: (places[i], value) for i, (name, value) in enumerate(light.items())}
    return _target(world, patches, 3, 6, pair.dark_cd_m2, rng)


def _target(
    world: World,
    patches: dict[str, tuple[int, float]],
    side: int,
    margin: int,
    around_cd_m2: float,
    rng: np.random.Generator,
) -> Target:
    height, width = HEIGHT // side, WIDTH // side // 2 * 2
    scene = np.full((HEIGHT, WIDTH), around_cd_m2)
    coloured = rng.permutation(len(patches)) < world.coloured * len(patches)
    regions, colours, shapes = {}, {}, {}
    for (name, (place, value)), has_colour in zip(patches.items(), coloured, strict=True):
        y, x = place // side * height, place % side * width
        colours[name] = random_colour(rng) if has_colour else {}
        seen, shape = value * (1 + world.scatter_rel * rng.normal()), shape_in_patch(world, height, width, margin, rng)
        scene[y : y + height, x : x + width] = seen * shape * filter_pattern(colours[name], (height, width))
        shapes[name] = shape[margin : height - margin, margin : width - margin].ravel()
        regions[name] = (x + margin, y + margin, width - 2 * margin, height - 2 * margin)
    return Target(regions, {name: value for name, (_, value) in patches.items()}, colours, scene, shapes)


def shape_in_patch(world: World, height: int, width: int, margin: int, rng: np.random.Generator) -> Array:
    """Light across a patch, relative to what the meter sees of it: the middle third of its region."""
    if not (world.gradient_rel or world.hot_spot_rel):
        return np.ones((height, width))
    v, u = ((np.arange(n) + 0.5 - n / 2) / (n - 2 * margin) for n in (height, width))
    angle = rng.uniform(0, 2 * np.pi)
    gradient = world.gradient_rel * (np.cos(angle) * u[None, :] + np.sin(angle) * v[:, None])
    spot = 1 - 2 * world.hot_spot_rel * (u[None, :] ** 2 + v[:, None] ** 2)
    middle = (np.abs(v) < 1 / 6)[:, None] & (np.abs(u) < 1 / 6)[None, :]
    return np.asarray((1 + gradient) * spot / spot[middle].mean())


def measured_range(world: World) -> tuple[float, float]:
    """Luminances of patches that are measured: a little inside the calibrated range."""
    return world.darkest_cd_m2 * 1.2, BRIGHTEST_CD_M2 / 1.2


def asked_pair(device: Device, rng: np.random.Generator) -> Pair:
    """Draw a pair whose CDP is neither 0 nor 1: the asked contrast and its tolerance follow from the pixels' noise."""
    world = device.world
    low, high = measured_range(world)
    contrast = 10 ** rng.uniform(-1, 0)
    dark = float(np.exp(rng.uniform(np.log(low), np.log(high / (1 + contrast)))))
    lights = np.array([dark * (1 + contrast), dark])
    t = max(
        t
        for t in world.exposures_s
        if expected_dn(device, lights[0], t) + 6 * expected_noise_dn(device, lights[0], t) < full_scale(world)
    )
    per_cd_m2 = world.k_dn_per_e * device.responsivity_e_s_cd_m2 * t
    spread = float((1 + contrast) * np.hypot(*(expected_noise_dn(device, lights, t) / (per_cd_m2 * lights))))
    asked = max(contrast + rng.uniform(-1.2, 1.2) * spread, 0.05)
    epsilon = float(np.clip(rng.uniform(0.5, 2) * spread / asked, 0.01, 1))
    return Pair(float(lights[0]), dark, float(asked), epsilon)
