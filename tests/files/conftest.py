"""Synthetic RAW files whose pixels are known bit by bit."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from labcdp.core.frame import CameraIdentity
from labcdp.files import FileDefaults

#: Colours of DNG, tag CFAPattern: 0 red, 1 green, 2 blue.
PATTERNS = {"RG": (0, 1, 1, 2), "GB": (1, 2, 0, 1), "GR": (1, 0, 2, 1), "BG": (2, 1, 1, 0)}
CFA = 32803


def write_dng(
    path: Path,
    dn: np.ndarray[Any, Any],
    pattern: str | None = "RG",
    *,
    black: Sequence[int] = (64,),
    white: int = 4095,
    exposure: tuple[int, int] | None = (1, 125),
    iso: int | None = 200,
    serial: str = "0815",
    cfa: tuple[int, tuple[int, ...]] | None = None,
    photometric: int = CFA,
    byteorder: str = "<",
) -> Path:
    """Write an uncompressed DNG; `black` has one level, or those of the upper left 2 x 2 pixels."""
    tags: list[tuple[Any, ...]] = [
        (50706, "B", 4, bytes((1, 4, 0, 0)), True),
        (50708, "s", 0, "Acme Still 1", True),
        (271, "s", 0, "Acme", True),
        (272, "s", 0, "Still 1", True),
        (50735, "s", 0, serial, True),
        (33437, "2I", 1, (28, 10), True),
        (37386, "2I", 1, (50, 1), True),
        (36867, "s", 0, "2026:03:01 12:00:00", True),
        (36881, "s", 0, "+01:00", True),
        (50717, "I", 1, white, True),
        (50714, "H", len(black), tuple(black) if len(black) > 1 else black[0], True),
        (50721, "2i", 9, (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1), True),
    ]
    if len(black) > 1:
        tags.append((50713, "H", 2, (2, 2), True))
    if exposure is not None:
        tags.append((33434, "2I", 1, exposure, True))
    if iso is not None:
        tags.append((34855, "H", 1, iso, True))
    size, colours = cfa or (2, PATTERNS[pattern] if pattern else ())
    if colours:
        tags += [(33421, "H", 2, (size, size), True), (33422, "B", size * size, bytes(colours), True)]
    tifffile.imwrite(path, dn, photometric=photometric, metadata=None, extratags=tags, byteorder=byteorder)
    return path


@pytest.fixture(scope="session")
def new_dng() -> Callable[..., Path]:
    return write_dng


@pytest.fixture(scope="session")
def defaults() -> FileDefaults:
    return FileDefaults(exposure_s=None, gain_db=0.0, camera=CameraIdentity("Vendor", "Model", "Serial"))


@pytest.fixture(scope="session")
def dn() -> np.ndarray[Any, Any]:
    return np.random.default_rng(1).integers(0, 4096, (40, 60), dtype=np.uint16)


CONFIGURATION = """\
format = 1
name = "A still camera and a chart"
operator = "A. Müller"

[camera]
vendor = "Acme"
model = "Still 1"
pixel_pitch_m = 4e-6
spectral_sensitivity = "sensitivity.csv"

[lens]
model = "Prime 50"
serial = "7"
focal_length_m = 0.05
f_number = 2.8

[meter]
model = "LS-110"
serial = "73323007"

[source]
spectrum = "LED-B3"

[target]
name = "chart"

[plan]
"""
#: Reflectances of ideal grey patches, and coloured patches of the chart with measured ones.
GREYS = {"white": 0.9, "light grey": 0.5, "grey": 0.25, "dark grey": 0.1, "black": 0.04}
COLOURS = ("blue", "green", "red", "yellow", "cyan", "foliage", "magenta", "blue sky")
SIDE = 24
EXPOSURES = ((1, 400), (1, 100), (1, 25))
BLACK_DN = {"R": 510, "Gr": 512, "Gb": 512, "B": 515}
FULL_SCALE_DN = {"R": 60e3, "Gr": 110e3, "Gb": 109e3, "B": 70e3}  # DN/s for a white of WHITE_CD_M2
WHITE_CD_M2 = 250.0
K_DN_PER_E, READ_DN, WHITE_LEVEL_DN = 0.8, 3.0, 15000


@dataclass(frozen=True)
class StillCamera:
    """Files of a RAW-shooting camera before a chart, in a folder, and the truth about them."""

    folder: Path
    luminance_cd_m2: dict[str, float]

    def arguments(self, session: str = "session") -> list[str]:
        """Arguments of the command, for this folder."""
        return ["import", "bench.toml", session, "--light", "light", "--dark", "dark", "--readings", "readings.csv"]


@pytest.fixture(scope="session")
def chart() -> dict[str, dict[str, float]]:
    """Relative signals of the patches in the planes, and "L" for their luminance; 1 for a perfect white."""
    from labcdp.core.photometry import source_names, spectral_weights

    source_names()  # imports colour without its warnings
    import colour

    nm, power, visibility = spectral_weights("LED-B3")
    camera = colour.MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    curves = {c: np.interp(nm, camera.wavelengths, v) for c, v in zip("RGB", camera.values.T, strict=True)}
    weights = {"R": curves["R"], "Gr": curves["G"], "Gb": curves["G"], "B": curves["B"], "L": visibility}
    measured = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]
    reflectances: dict[str, Any] = dict(GREYS)
    reflectances |= {name: np.interp(nm, measured[name].wavelengths, measured[name].values) for name in COLOURS}
    return {
        name: {p: float((power * reflectance) @ w / (power @ w)) for p, w in weights.items()}
        for name, reflectance in reflectances.items()
    }


@pytest.fixture
def still_camera(tmp_path: Path, photographed: StillCamera) -> StillCamera:
    """Files of a still camera that a test may change."""
    shutil.copytree(photographed.folder, tmp_path, dirs_exist_ok=True)
    return StillCamera(tmp_path, photographed.luminance_cd_m2)


@pytest.fixture(scope="session")
def photographed(tmp_path_factory: pytest.TempPathFactory, chart: dict[str, dict[str, float]]) -> StillCamera:
    import colour

    folder = tmp_path_factory.mktemp("still-camera")

    rng = np.random.default_rng(6)
    camera = colour.MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    rows = [",".join(f"{v:.9g}" for v in row) for row in np.column_stack([camera.wavelengths, camera.values])]
    (folder / "sensitivity.csv").write_text("\n".join(["wavelength_nm,R,G,B", *rows]), encoding="utf-8")
    patches = "".join(
        f'\n[[target.patch]]\nname = "{name}"\nroi = [{SIDE * i + 4}, 4, {SIDE - 8}, {2 * SIDE}]\n'
        for i, name in enumerate(chart)
    )
    (folder / "bench.toml").write_text(CONFIGURATION.replace("[plan]\n", f"{patches}\n[plan]\n"), encoding="utf-8")
    luminance = {name: WHITE_CD_M2 * signals["L"] for name, signals in chart.items()}
    readings = [f"{name};{luminance[name] * (1 + rng.normal(0, 0.002)):.2f};2026-03-01 12:0{i}" for i in range(3)
                for name in chart]  # fmt: skip
    text = "\n".join(["patch;luminance_cd_m2;time", *readings]).replace(".", ",").replace(",2026", ".2026")
    (folder / "readings.csv").write_text(text, encoding="utf-8")
    shape = (2 * SIDE + 8, SIDE * len(chart))
    for role in ("light", "dark"):
        (folder / role).mkdir()
        for numerator, denominator in EXPOSURES:
            for number in (1, 2):
                dn = np.empty(shape)
                for plane, (row, column) in {"R": (0, 0), "Gr": (0, 1), "Gb": (1, 0), "B": (1, 1)}.items():
                    rate = [FULL_SCALE_DN[plane] * signals[plane] * (role == "light") for signals in chart.values()]
                    net = np.tile(np.repeat(rate, SIDE // 2), (shape[0] // 2, 1)) * numerator / denominator
                    noise = rng.normal(0, 1, net.shape) * np.sqrt(K_DN_PER_E * net + READ_DN**2)
                    dn[row::2, column::2] = BLACK_DN[plane] + net + noise
                path = folder / role / f"{denominator}_{number}.dng"
                pixels = np.clip(np.rint(dn), 0, WHITE_LEVEL_DN).astype(np.uint16)
                black = tuple(BLACK_DN[plane] for plane in ("R", "Gr", "Gb", "B"))
                write_dng(path, pixels, black=black, white=WHITE_LEVEL_DN, exposure=(numerator, denominator), iso=100)
    return StillCamera(folder, luminance)


@pytest.fixture
def labcdp(still_camera: StillCamera, labcdp_in: Callable[..., Any]) -> Callable[..., Any]:
    """Run the command in the folder of the still camera's files."""
    return partial(labcdp_in, still_camera.folder)
