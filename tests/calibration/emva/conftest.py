"""A data set whose camera is known: Poisson electrons, normal read noise, fixed patterns, rounding and clipping."""

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from labcdp.calibration.emva.index import INDEX_NAME


@dataclass(frozen=True)
class KnownCamera:
    """The truth, and how it is recorded."""

    k_dn_per_e: float = 0.25
    quantum_efficiency: float = 0.5
    read_noise_e: float = 8.0
    dark_current_e_s: float = 2000.0
    black_level_dn: float = 20.0
    prnu_rel: float = 0.01
    dsnu_e: float = 30.0
    bits: int = 12
    shape: tuple[int, int] = (64, 80)
    seed: int = 1

    def images(self, photons, exposure_s, count, rng):
        patterns = np.random.default_rng(self.seed)
        gain = 1 + self.prnu_rel * patterns.standard_normal(self.shape)
        offset = self.dsnu_e * patterns.standard_normal(self.shape)
        mean = self.quantum_efficiency * photons * gain + self.dark_current_e_s * exposure_s
        images = []
        for _ in range(count):
            signal = rng.poisson(np.maximum(mean, 0)) + offset + self.read_noise_e * rng.standard_normal(self.shape)
            dn = np.rint(self.k_dn_per_e * signal + self.black_level_dn)
            images.append(np.clip(dn, 0, 2**self.bits - 1).astype(np.uint16))
        return images


@dataclass(frozen=True)
class Recording:
    """How a data set is written."""

    levels: int = 16
    last_photons: float = 40_000.0
    stack: int = 12
    images: int = 2
    exposure_unit_s: float = 1e-9
    photon_factor: float = 1.0
    bits_told: int | None = None
    multiply: int = 1


#: Of a few pixels, and of few levels.
SMALL, SHORT = KnownCamera(shape=(24, 32)), Recording(levels=10, stack=4)


def write_data_set(folder, camera=KnownCamera(), how=Recording()):
    """Write a data set with exposures of 1 to 20 ms; returns its index."""
    rng = np.random.default_rng(camera.seed + 100)
    lines = ["# known camera", "v 3.1", f"n {how.bits_told or camera.bits} {camera.shape[1]} {camera.shape[0]}"]
    (folder / "images").mkdir(parents=True)
    exposures_s = np.linspace(1e-3, 20e-3, how.levels)
    photons = np.linspace(how.last_photons / how.levels / 4, how.last_photons, how.levels)
    blocks = [(photons[i], exposures_s[i], how.images) for i in range(how.levels)]
    middle = min(range(how.levels), key=lambda i: abs(photons[i] - 14_000))
    blocks += [(photons[middle], exposures_s[middle], how.stack)] if how.stack else []
    for number, (light, exposure_s, count) in enumerate(blocks):
        told = f"{exposure_s / how.exposure_unit_s:.6g}"
        for letter, value in (("b", light), ("d", 0.0)):
            shown = f" {value * how.photon_factor:.10g}" if letter == "b" else ""
            lines.append(f"{letter} {told}{shown}")
            for index, image in enumerate(camera.images(value, exposure_s, count, rng)):
                name = f"{letter}_{number:03d}_{index:03d}.png"
                write_image(folder / "images" / name, image * np.uint16(how.multiply))
                lines.append(f"i images\\{name}")
    index = folder / INDEX_NAME
    index.write_text("\n".join(lines) + "\n")
    return index


def write_image(path, image):
    if path.suffix == ".png":
        assert cv2.imwrite(str(path), image)
    else:
        tifffile.imwrite(path, image)


@pytest.fixture(scope="session")
def data_set(tmp_path_factory):
    """Index of a data set of `KnownCamera()`."""
    return write_data_set(tmp_path_factory.mktemp("known") / "set")


def reference_set(name):
    """A reference data set of the standard's makers, or skip."""
    default = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "emva1288"
    folder = Path(os.environ.get("LABCDP_EMVA_DATA", default)) / f"EMVA1288_ReferenceSet_{name}"
    if not folder.is_dir():
        pytest.skip(f"there is no {folder} (LABCDP_EMVA_DATA says where)")
    return folder
