"""How often stated 95 % intervals hold the truth, over simulated benches of cameras that nobody has seen before.

Run ``python benchmarks/calibration_coverage.py [--benches N] [--first N] [--processes N]``. Each bench is a random
camera (gain, noise, dark current, fixed pattern, black level, fall-off) with a random meter, a flat field of a source
that is as uneven as stated, by up to 1 %, dark frames and 8 to 12 patches over four decades of luminance. It is
calibrated, and then patches it has not seen are measured: one for the luminance, two for their contrast and its CDP.
The truth is known: the luminances of the scene, and the CDP of 144 000 pixels of each region behind a conversion
without error.
"""

from __future__ import annotations

import argparse
import logging
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import floor, log, log10, sqrt

import numpy as np

from labcdp.calibration import (
    Calibration,
    LensIdentity,
    PatchLuminance,
    Setup,
    contrast_uncertainty,
    fit,
    observe_dark,
    observe_patches,
    patch_luminance,
)
from labcdp.calibration.flat_field import measure_fall_off
from labcdp.calibration.pixel_statistics import pixel_statistics
from labcdp.chain import ImagingChain, Optics, Sensor
from labcdp.contrast import cdp, cdp_with_common_errors
from labcdp.evaluate.pair import paired_errors
from labcdp.frame import CameraIdentity, Frame
from labcdp.reading import MeterIdentity, Reading
from labcdp.roi import Roi
from labcdp.vignetting import AnyVignetting

HEIGHT, WIDTH = 156, 240
COLUMNS, ROWS = 4, 3
#: Distance of a region from the edges of its patch.
MARGIN = 8
TILES = (10, 10)
TEMPERATURE_C = 30.0
LAMBERT_RANGE = (0.05, 500.0)
FRAMES, FLAT_FRAMES = 3, 16
METER = MeterIdentity("LS-110", "73323007")
#: LS-110: +-2 %, +-1 digit, +-2 digits below 10 cd/m^2; repeatability 0.2 %.
SCALE_HALF_WIDTH_REL, REPEATABILITY_REL, READINGS = 0.02, 0.002, 3
EPSILON = 0.5
#: Most that the source of the flat field is uneven by; its certificate says by how much.
MOST_UNEVEN_REL = 0.01


@dataclass(frozen=True)
class Outcome:
    """What one bench showed: whether each interval holds the truth, and the relative error of the luminance."""

    luminance: bool
    contrast: bool
    cdp: bool
    luminance_cd_m2: float
    error_rel: float
    error_rel_to_meter: float


def regions() -> list[Roi]:
    height, width = HEIGHT // ROWS, WIDTH // COLUMNS
    return [
        Roi.rectangle(
            f"P{row * COLUMNS + column}",
            column * width + MARGIN,
            row * height + MARGIN,
            width - 2 * MARGIN,
            height - 2 * MARGIN,
        )
        for row in range(ROWS)
        for column in range(COLUMNS)
    ]


def random_chain(rng: np.random.Generator) -> ImagingChain:
    bits = int(rng.choice([10, 12, 14]))
    full_well_e = 10 ** rng.uniform(3.8, 4.6)
    black_dn = rng.uniform(0.01, 0.05) * 2**bits
    k_dn_per_e = (2**bits - black_dn) / full_well_e * rng.uniform(1.05, 1.3)
    sensor = Sensor(
        pixel_pitch_m=rng.uniform(2.2e-6, 6e-6),
        width=WIDTH,
        height=HEIGHT,
        quantum_efficiency=rng.uniform(0.3, 0.7),
        full_well_e=full_well_e,
        k_dn_per_e=k_dn_per_e,
        # Less than half a DN of noise does not dither the rounding.
        read_noise_e=max(rng.uniform(2, 20), 0.6 / k_dn_per_e),
        dark_current_e_s=10 ** rng.uniform(-0.5, 2),
        bits=bits,
        black_level_dn=black_dn,
        prnu_rel=rng.uniform(0.002, 0.015),
        dsnu_e=rng.uniform(0, 5),
        dsnu_e_s=0.0,
        device_seed=int(rng.integers(2**31)),
    )
    # The corner sees the light under up to 25 degrees.
    corner_m = sensor.pixel_pitch_m * np.hypot(HEIGHT, WIDTH) / 2
    optics = Optics(rng.uniform(1.4, 5.6), rng.uniform(0.7, 0.95), corner_m / np.tan(np.radians(rng.uniform(5, 25))))
    return ImagingChain("D65", None, optics, sensor)


class Camera:
    """A specimen that takes frames; each has its own noise."""

    def __init__(self, chain: ImagingChain, seed: int) -> None:
        self.chain, self._seed, self._index = chain, seed, 0

    def frames(self, scene: np.ndarray | None, exposure_s: float, n: int) -> Iterator[Frame]:
        """Take frames of a scene, or of the lens cap."""
        rate = 0.0 if scene is None else self.chain.electron_rate(scene)
        sensor = self.chain.sensor
        for _ in range(n):
            self._index += 1
            dn = self.chain.expose(
                rate, exposure_s, temperature_c=TEMPERATURE_C, seed=self._seed, exposure_index=self._index, threads=1
            )
            yield Frame(
                dn=dn,
                exposure_s=exposure_s,
                gain_db=0.0,
                bit_depth=sensor.bits,
                saturation_dn=2.0**sensor.bits - 1,
                black_level_dn=round(sensor.black_level_dn),
                pixel_format="Mono16",
                colour_filter=None,
                temperature_c=TEMPERATURE_C,
                timestamp=datetime(2026, 1, 1, tzinfo=UTC),
                camera_timestamp_ns=self._index,
                frame_id=self._index,
                camera=CameraIdentity("labcdp", "random", "1", simulated=True),
            )


def scene_of(luminances_cd_m2: np.ndarray) -> np.ndarray:
    grid = np.resize(luminances_cd_m2, ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    return np.kron(grid, np.ones((HEIGHT // ROWS, WIDTH // COLUMNS)))


def uneven_source(rng: np.random.Generator, unevenness_rel: float) -> np.ndarray:
    """Light of a source that is uneven by a smooth random pattern with that standard deviation over the image."""
    y, x = (np.pi * (np.arange(n) + 0.5) / n for n in (HEIGHT, WIDTH))
    pattern = sum(
        rng.normal() / (i**2 + k**2) * np.outer(np.cos(i * y), np.cos(k * x))
        for i in range(3)
        for k in range(3)
        if i + k > 0
    )
    return 1 + unevenness_rel * pattern / pattern.std()


def readings_of(rng: np.random.Generator, luminance_cd_m2: float, scale_rel: float) -> list[Reading]:
    """Read one patch several times; the digit error is the same for all, as it would be."""
    digits = 2 if luminance_cd_m2 < 10 else 1
    resolution = max(10.0 ** (floor(log10(luminance_cd_m2)) - 3), 0.01)
    shift = rng.uniform(-(digits - 0.5), digits - 0.5) * resolution
    result = []
    for _ in range(READINGS):
        shown = luminance_cd_m2 * (1 + scale_rel) * (1 + rng.normal(0, REPEATABILITY_REL)) + shift
        value = max(round(shown / resolution), 1) * resolution
        result.append(
            Reading(
                value=value,
                unit="cd/m2",
                resolution=resolution,
                scale_half_width_rel=SCALE_HALF_WIDTH_REL,
                digits_half_width=digits * resolution,
                repeatability_rel=REPEATABILITY_REL,
                peak=False,
                correction="preset",
                held=False,
                meter=METER,
                # No two readings are taken at one time.
                timestamp=datetime.fromtimestamp(1.8e9 + 60 * float(rng.random()) + len(result), UTC),
                raw=f"{value:.2f}",
            )
        )
    return result


def exposures_of(chain: ImagingChain) -> list[float]:
    """From the brightest patch at 0.6 of saturation to the darkest well above the noise, in six steps."""
    longest_cd_m2 = LAMBERT_RANGE[0] * 20
    ends = [
        0.6 * chain.saturation_luminance_cd_m2(1.0, temperature_c=TEMPERATURE_C) / value
        for value in (LAMBERT_RANGE[1], longest_cd_m2)
    ]
    return [float(t) for t in np.geomspace(ends[0], max(ends[1], 30 * ends[0]), 6)]


def calibrated(rng: np.random.Generator, camera: Camera, scale_rel: float) -> tuple[Calibration, AnyVignetting]:
    n_patches = int(rng.integers(8, ROWS * COLUMNS + 1))
    luminances = rng.permutation(np.geomspace(*LAMBERT_RANGE, n_patches)) * 10 ** rng.uniform(-0.05, 0.05, n_patches)
    exposures_s = exposures_of(camera.chain)
    flat_s = camera.chain.saturation_luminance_cd_m2(1.0, temperature_c=TEMPERATURE_C) / 100 * 0.5
    unevenness_rel = rng.uniform(0, MOST_UNEVEN_REL)
    fall_off = measure_fall_off(
        [pixel_statistics(camera.frames(100.0 * uneven_source(rng, unevenness_rel), flat_s, FLAT_FRAMES))],
        [pixel_statistics(camera.frames(None, flat_s, FLAT_FRAMES))],
        source_unevenness_rel=unevenness_rel,
    )
    scene, areas = scene_of(luminances), regions()[:n_patches]
    observations = [
        o for t in exposures_s for o in observe_patches(camera.frames(scene, t, FRAMES), areas, fall_off.chosen)
    ]
    darks = [observe_dark(camera.frames(None, t, FRAMES)) for t in exposures_s[::2] + exposures_s[-1:]]
    readings = {
        area.name: readings_of(rng, float(value), scale_rel) for area, value in zip(areas, luminances, strict=True)
    }
    setup = Setup(LensIdentity("random", "1", 0.01, 2.8), "D65", "0" * 64)
    return fit(observations, darks, readings, setup), fall_off.chosen


def true_cdp(camera: Camera, rates: list[np.ndarray], slopes: list[np.ndarray], exposure_s: float, k: float) -> float:
    """CDP of the same light on many other pixels of the same make, behind a conversion without error.

    The flat field takes off the pixels' own sensitivities, and so does that conversion.
    """
    sensor, values = camera.chain.sensor, []
    for number, (rate, slope) in enumerate(zip(rates, slopes, strict=True)):
        height, width = (n * tiles for n, tiles in zip(rate.shape, TILES, strict=True))
        other = replace(sensor, width=width, height=height, device_seed=sensor.device_seed + 1 + number, prnu_rel=0.0)
        dn = other.expose(
            np.tile(rate, TILES),
            exposure_s,
            temperature_c=TEMPERATURE_C,
            seed=12345 + number,
            exposure_index=0,
            threads=1,
        )
        dark = camera.chain.conversion(temperature_c=TEMPERATURE_C).dark_dn(exposure_s)
        values.append((dn - dark) / np.tile(slope, TILES))
    return cdp(values[0], values[1], k, EPSILON).cdp


def one_bench(seed: int) -> Outcome | str:
    """Outcome of a bench, or why it was refused."""
    logging.disable(logging.CRITICAL)
    rng = np.random.default_rng([20261121, seed])
    camera = Camera(random_chain(rng), seed)
    scale_rel = rng.uniform(-SCALE_HALF_WIDTH_REL, SCALE_HALF_WIDTH_REL)
    try:
        calibration, vignetting = calibrated(rng, camera, scale_rel)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    areas = regions()
    # Bright over dark from 20 % to 1000 %, in patches of their own.
    dark_cd_m2 = np.exp(rng.uniform(log(2 * LAMBERT_RANGE[0]), log(LAMBERT_RANGE[1] / 12)))
    contrast = 10 ** rng.uniform(-0.7, 1.0)
    single_cd_m2 = np.exp(rng.uniform(*np.log(LAMBERT_RANGE)))
    chosen = rng.permutation(ROWS * COLUMNS)[:3]
    luminances = np.full(ROWS * COLUMNS, dark_cd_m2)
    luminances[chosen] = [dark_cd_m2 * (1 + contrast), dark_cd_m2, single_cd_m2]
    scene = scene_of(luminances)
    bright, dark, single = (areas[i] for i in chosen)
    seen: dict[str, list] = {area.name: [] for area in (bright, dark, single)}
    exposures_s = exposures_of(camera.chain)
    for t in exposures_s:
        for o in observe_patches(camera.frames(scene, t, FRAMES), [bright, dark, single], vignetting):
            seen[o.patch].append(o)
    patches: dict[str, PatchLuminance] = {name: patch_luminance(calibration, group) for name, group in seen.items()}
    one = patches[single.name]
    low, high = one.interval_95_cd_m2
    b, d = patches[bright.name], patches[dark.name]
    k = b.luminance_cd_m2 / d.luminance_cd_m2 - 1
    unsaturated = [t for t, o in zip(exposures_s, seen[bright.name], strict=True) if o.saturated_share == 0]
    exposure_s = max(unsaturated)
    asked = contrast * rng.uniform(0.6, 1.6)
    luminance = calibration.to_luminance(next(camera.frames(scene, exposure_s, 1)))
    measured = cdp_with_common_errors(
        luminance.select(bright),
        luminance.select(dark),
        asked,
        EPSILON,
        paired_errors(luminance, bright, luminance, dark),
    )
    rate = camera.chain.electron_rate(scene)
    conversion = camera.chain.conversion(temperature_c=TEMPERATURE_C)
    slope = (
        conversion.responsivity_dn_s_cd_m2 * exposure_s * conversion.vignetting.relative_illuminance((HEIGHT, WIDTH))
    )
    windows = [area.window((HEIGHT, WIDTH)) for area in (bright, dark)]
    truth = true_cdp(camera, [rate[w] for w in windows], [slope[w] for w in windows], exposure_s, asked)
    error = one.luminance_cd_m2 / single_cd_m2 - 1
    return Outcome(
        luminance=bool(low <= single_cd_m2 <= high),
        contrast=bool(abs(k - contrast) <= 1.959964 * contrast_uncertainty(b, d)),
        cdp=bool(measured.confidence_interval[0] <= truth <= measured.confidence_interval[1]),
        luminance_cd_m2=float(single_cd_m2),
        error_rel=float(error),
        error_rel_to_meter=float((1 + error) / (1 + scale_rel) - 1),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--benches", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first bench")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    with ProcessPoolExecutor(arguments.processes) as pool:
        seeds = range(arguments.first, arguments.first + arguments.benches)
        outcomes = list(pool.map(one_bench, seeds, chunksize=4))
    good = [o for o in outcomes if isinstance(o, Outcome)]
    for refused in sorted({o for o in outcomes if isinstance(o, str)}):
        print(f"refused: {refused}")
    print(f"{len(good)} of {len(outcomes)} benches calibrated")
    for name in ("luminance", "contrast", "cdp"):
        share = np.mean([getattr(o, name) for o in good])
        print(f"{name}: 95 % intervals hold the truth in {share:.1%} +- {sqrt(share * (1 - share) / len(good)):.1%}")
    bright = [o for o in good if o.luminance_cd_m2 >= 0.5]
    for name, text in (("error_rel", "with the meter's scale error"), ("error_rel_to_meter", "without it")):
        values = np.array([getattr(o, name) for o in bright])
        print(
            f"from 0.5 cd/m^2 up, {text}: median error {np.median(values):+.2%}, median of its size "
            f"{np.median(np.abs(values)):.2%}"
        )


if __name__ == "__main__":
    main()
