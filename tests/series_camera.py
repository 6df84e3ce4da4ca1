"""A series camera in plain NumPy: three captures, merged to 20 bits, in codes of 12 by a piecewise linear curve.

Nothing of it is labcdp's: photons, noise, hand-over, curve and rounding are written out here.
"""

import os
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
import tifffile

CODES, VALUES = (0, 2048, 3040, 4000), (0, 2048, 65536, 1048576)
#: Pedestal of the linear values, ahead of the curve.
BLACK_DN = 168
#: Ratios of the captures' exposures, read noise and gain of each, and the DN from which the next one takes over.
RATIOS, READ_DN, K_DN_PER_E, HAND_OVER_DN = (1, 16, 256), 2.0, 0.25, 3800
CURVE_TOML = f"""name = "front"
bits = 12
codes = {list(CODES)}
values = {list(VALUES)}
black_value = {BLACK_DN}
"""
START = datetime(2026, 3, 1, 12, tzinfo=UTC)


@dataclass(frozen=True)
class SeriesCamera:
    """What the camera and its target are."""

    dn_s_cd_m2: float = 2000.0
    dark_e_s: float = 5.0
    luminances_cd_m2: tuple[float, ...] = tuple(np.geomspace(0.5, 3000, 12).tolist())
    exposures_s: tuple[float, ...] = (0.002, 0.008, 0.032)
    patch_px: int = 40

    @property
    def shape(self):
        """Rows and columns: patches in rows of four."""
        return len(self.luminances_cd_m2) // 4 * self.patch_px, 4 * self.patch_px

    def scene_cd_m2(self):
        """Luminance of each pixel."""
        patches = np.reshape(self.luminances_cd_m2, (-1, 4))
        return np.kron(patches, np.ones((self.patch_px, self.patch_px)))

    def regions(self):
        """Corner and size of each patch, by name."""
        size = self.patch_px
        return {
            f"P{i:02d}": (i % 4 * size + 5, i // 4 * size + 5, size - 10, size - 10)
            for i in range(len(self.luminances_cd_m2))
        }

    def linear(self, scene_cd_m2, exposure_s, rng):
        """Linear values with pedestal: of each pixel the most sensitive capture that is not full."""
        rate_e_s = self.dn_s_cd_m2 / K_DN_PER_E * np.asarray(scene_cd_m2) + self.dark_e_s
        merged = None
        for ratio in reversed(RATIOS):
            electrons = rng.poisson(rate_e_s * exposure_s / ratio)
            noisy = K_DN_PER_E * electrons + rng.normal(0, READ_DN, electrons.shape) + BLACK_DN
            dn = np.clip(np.rint(noisy), 0, 4095)
            net = (dn - BLACK_DN) * ratio
            merged = net if merged is None else np.where(dn < HAND_OVER_DN, net, merged)
        return merged + BLACK_DN

    def codes(self, scene_cd_m2, exposure_s, rng):
        """Codes of a frame."""
        linear = self.linear(scene_cd_m2, exposure_s, rng)
        return np.clip(np.rint(np.interp(linear, VALUES, CODES)), 0, CODES[-1]).astype(np.uint16)


def write_bench(folder, camera=SeriesCamera(), encoding='"curve.toml"', pixel_format="Mono12", frames=3, seed=1,
                store=lambda frame: frame, capture=SeriesCamera.codes, colour_filter=None):  # fmt: skip
    """Write pictures, readings, curve and configuration; return arguments of import for the pictures."""
    rng = np.random.default_rng(seed)
    lines = []
    for role, scene in (("light", camera.scene_cd_m2()), ("dark", np.zeros(camera.shape))):
        (folder / role).mkdir(parents=True)
        for exposure_s in camera.exposures_s:
            for number in range(frames):
                name = folder / role / f"{round(1e3 * exposure_s)}ms_{number}.tif"
                tifffile.imwrite(name, store(capture(camera, scene, exposure_s, rng)))
                taken = START.timestamp() + len(lines)
                os.utime(name, (taken, taken))
                lines += ["--exposure", f"{name.relative_to(folder)}={exposure_s:g}s"]
    rows = ["patch,luminance_cd_m2,time"]
    for second, (name, luminance) in enumerate(zip(camera.regions(), camera.luminances_cd_m2, strict=True)):
        for again in range(3):
            value = luminance * (1 + 0.002 * rng.standard_normal())
            at = START + timedelta(seconds=10 * second + again)
            rows.append(f"{name},{value:.4g},{at.isoformat()}")
    (folder / "readings.csv").write_text("\n".join(rows) + "\n")
    (folder / "curve.toml").write_text(CURVE_TOML)
    regions = camera.regions().items()
    patches = "\n".join(f'[[target.patch]]\nname = "{name}"\nroi = {list(roi)}' for name, roi in regions)
    (folder / "bench.toml").write_text(f"""format = 1
name = "series camera"
operator = "Ada"
[camera]
vendor = "Acme"
model = "Front"
serial = "1"
pixel_pitch_m = 3e-6
{f"encoding = {encoding}" if encoding else ""}
{f'colour_filter = "{colour_filter}"' if colour_filter else ""}
[lens]
model = "telecentric"
focal_length_m = 10.0
f_number = 1.8
[meter]
model = "LS-110"
serial = "73323007"
[source]
spectrum = "LED-B4"
[target]
name = "twelve patches"
{patches}
[[contrast]]
bright = "P08"
dark = "P07"
contrast = "{100 * (camera.luminances_cd_m2[8] / camera.luminances_cd_m2[7] - 1):.1f}%"
[plan]
pixel_format = "{pixel_format}"
""")
    return ["--light", "light", "--dark", "dark", "--readings", "readings.csv", *lines]
