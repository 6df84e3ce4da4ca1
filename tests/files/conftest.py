"""Synthetic RAW files whose pixels are known bit by bit."""

import shutil
import struct
from collections import namedtuple
from functools import partial

import numpy as np
import pytest
import tifffile

from labcdp.acquire.import_check import ImportFile

#: Colours of DNG, tag CFAPattern: 0 red, 1 green, 2 blue.
PATTERNS = {"RG": (0, 1, 1, 2), "GB": (1, 2, 0, 1), "GR": (1, 0, 2, 1), "BG": (2, 1, 1, 0)}
CFA = 32803


def write_dng(path, dn, cfa="RG", *, black=(64,), white=4095, exposure=(1, 125), iso=200, serial="0815", more=()):
    """Write an uncompressed DNG in the byte order of `dn`.

    `black` has one level, or those of the upper left 2 x 2 pixels, and is None for no such tag; `cfa` is a Bayer
    pattern, size and colours of another one, or None for a picture without. `more` are tags of tifffile.
    """
    tags = [
        (50706, "B", 4, bytes((1, 4, 0, 0))),
        (50708, "s", 0, "Acme Still 1"),
        (271, "s", 0, "Acme"),
        (272, "s", 0, "Still 1"),
        (50735, "s", 0, serial),
        (33437, "2I", 1, (28, 10)),
        (37386, "2I", 1, (50, 1)),
        (36867, "s", 0, "2026:03:01 12:00:00"),
        (36881, "s", 0, "+01:00"),
        (50717, "I", 1, white),
        *([(50714, "H", len(black), tuple(black) if len(black) > 1 else black[0])] if black is not None else []),
        (50721, "2i", 9, (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1)),
        (34855, "H", 1, iso),
    ]
    if black is not None and len(black) > 1:
        tags.append((50713, "H", 2, (2, 2)))
    if exposure is not None:
        tags.append((33434, "2I", 1, exposure))
    if cfa is not None:
        size, colours = (2, PATTERNS[cfa]) if isinstance(cfa, str) else cfa
        tags += [(33421, "H", 2, (size, size)), (33422, "B", size * size, bytes(colours))]
    tags = [(*tag, True) for tag in (*tags, *more)]
    stored = {"photometric": CFA if cfa else "minisblack", "byteorder": ">" if dn.dtype.byteorder == ">" else "<"}
    tifffile.imwrite(path, dn, metadata=None, extratags=tags, **stored)
    return path


def write_mono_dng(path, dn, **how):
    """Write the DNG of a monochrome sensor, whose kind tifffile writes for three samples only: linear raw."""
    data = bytearray(write_dng(path, dn, cfa=None, **how).read_bytes())
    with tifffile.TiffFile(path) as tiff:
        struct.pack_into("<H", data, tiff.pages.first.tags[262].valueoffset, 34892)
    path.write_bytes(data)
    return path


CONFIGURATION = """\
format = 1
name = "A still camera and a chart"
operator = "A. Müller"
camera = { vendor = "Acme", model = "Still 1", pixel_pitch_m = 4e-6, spectral_sensitivity = "sensitivity.csv" }
lens = { model = "Prime 50", serial = "7", focal_length_m = 0.05, f_number = 2.8, vignetting_rel = 0 }
meter = { model = "LS-110", serial = "73323007" }
source = { spectrum = "LED-B3" }
[target]
name = "chart"
"""
#: Reflectances of ideal grey patches, and coloured patches of the chart with measured ones.
GREYS = {"white": 0.9, "light grey": 0.5, "grey": 0.25, "dark grey": 0.1, "black": 0.04}
COLOURS = ("blue", "green", "red", "yellow", "cyan", "foliage", "magenta", "blue sky")
SIDE = 24
EXPOSURES = (400, 100, 25)
PLACES = {"R": (0, 0), "Gr": (0, 1), "Gb": (1, 0), "B": (1, 1)}
BLACK_DN = {"R": 510, "Gr": 512, "Gb": 512, "B": 515}
FULL_SCALE_DN = {"R": 60e3, "Gr": 110e3, "Gb": 109e3, "B": 70e3}  # DN/s for a white of WHITE_CD_M2
WHITE_CD_M2 = 250.0
K_DN_PER_E, READ_DN, WHITE_LEVEL_DN = 0.8, 3.0, 15000


#: Files of a RAW-shooting camera before a chart, in a folder, and the truth about them.
StillCamera = namedtuple("StillCamera", "folder luminance_cd_m2")


def picture_files(folder):
    """The pictures of a folder, as they are imported."""
    return [ImportFile(path, role) for role in ("light", "dark") for path in sorted((folder / role).iterdir())]


def write_frame(path, dn):
    """Write DN of the still camera as its RAW file, whose name begins with the denominator of the exposure time."""
    pixels = np.clip(np.rint(dn), 0, WHITE_LEVEL_DN).astype(np.uint16)
    exposure = 1, int(path.name.split("_")[0])
    write_dng(path, pixels, black=tuple(BLACK_DN.values()), white=WHITE_LEVEL_DN, exposure=exposure, iso=100)


def _measured():
    """Wavelengths and curves of a camera, and relative signals of the chart's patches in its planes.

    A signal is 1 for a perfect white; "L" is luminance.
    """
    import colour

    from labcdp.core.photometry import spectral_weights

    nm, power, visibility = spectral_weights("LED-B3")
    camera = colour.MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    curves = {c: np.interp(nm, camera.wavelengths, v) for c, v in zip("RGB", camera.values.T, strict=True)}
    weights = {"R": curves["R"], "Gr": curves["G"], "Gb": curves["G"], "B": curves["B"], "L": visibility}
    of_chart = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]
    reflectances = GREYS | {name: np.interp(nm, of_chart[name].wavelengths, of_chart[name].values) for name in COLOURS}
    return np.column_stack([camera.wavelengths, camera.values]), {
        name: {p: float((power * reflectance) @ w / (power @ w)) for p, w in weights.items()}
        for name, reflectance in reflectances.items()
    }


@pytest.fixture
def still_camera(tmp_path, photographed):
    """Files of a still camera that a test may change."""
    shutil.copytree(photographed.folder, tmp_path, dirs_exist_ok=True)
    return StillCamera(tmp_path, photographed.luminance_cd_m2)


@pytest.fixture(scope="session")
def photographed(tmp_path_factory):
    """Files of a still camera before a chart of grey and coloured patches, with the luminance of each."""
    folder, rng = tmp_path_factory.mktemp("still-camera"), np.random.default_rng(6)
    curves, chart = _measured()
    rows = [",".join(f"{v:.9g}" for v in row) for row in curves]
    (folder / "sensitivity.csv").write_text("\n".join(["wavelength_nm,R,G,B", *rows]), encoding="utf-8")
    patches = "".join(
        f'\n[[target.patch]]\nname = "{name}"\nroi = [{SIDE * i + 4}, 4, {SIDE - 8}, {2 * SIDE}]\n'
        for i, name in enumerate(chart)
    )
    (folder / "bench.toml").write_text(f"{CONFIGURATION}{patches}\n[plan]\n", encoding="utf-8")
    luminance = {name: WHITE_CD_M2 * signals["L"] for name, signals in chart.items()}
    readings = [f"{name};{luminance[name] * (1 + rng.normal(0, 0.002)):.2f};2026-03-01 12:0{i}" for i in range(3)
                for name in chart]  # fmt: skip
    text = "\n".join(["patch;luminance_cd_m2;time", *readings]).replace(".", ",").replace(",2026", ".2026")
    (folder / "readings.csv").write_text(text, encoding="utf-8")
    for role in ("light", "dark"):
        (folder / role).mkdir()
        for name in (f"{denominator}_{number}.dng" for denominator in EXPOSURES for number in (1, 2)):
            dn = np.empty((2 * SIDE + 8, SIDE * len(chart)))
            for plane, (row, column) in PLACES.items():
                rate = [FULL_SCALE_DN[plane] * signals[plane] * (role == "light") for signals in chart.values()]
                net = np.tile(np.repeat(rate, SIDE // 2), (len(dn) // 2, 1)) / int(name.split("_")[0])
                noise = rng.normal(0, 1, net.shape) * np.sqrt(K_DN_PER_E * net + READ_DN**2)
                dn[row::2, column::2] = BLACK_DN[plane] + net + noise
            write_frame(folder / role / name, dn)
    return StillCamera(folder, luminance)


@pytest.fixture
def labcdp(still_camera, labcdp_in):
    """Run the command in the folder of the still camera's files."""
    return partial(labcdp_in, still_camera.folder)
