"""RAW files: DN bit by bit, facts of the picture, and files that cannot serve."""

import struct
from datetime import UTC, datetime
from math import log10

import numpy as np
import pytest
import tifffile

from labcdp.core.errors import InputError
from labcdp.core.frame import CameraIdentity
from labcdp.files import PictureOptions, read_picture, read_raw

from .conftest import write_dng

DN = np.random.default_rng(1).integers(0, 4096, (40, 60), dtype=np.uint16)
DEFAULTS = PictureOptions(camera=CameraIdentity("Vendor", "Model", "Serial"))


@pytest.mark.parametrize(
    ("pattern", "byteorder", "planes"),
    [("RG", "<", (64, 65, 66, 67)), ("GR", ">", (65, 64, 67, 66)), ("GB", "<", (66, 67, 64, 65)),
     ("BG", ">", (67, 66, 65, 64))],
)  # fmt: skip
def test_pixels_and_black_levels_are_those_that_were_written(tmp_path, pattern, planes, byteorder):
    path = write_dng(tmp_path / "a.dng", DN.astype(f"{byteorder}u2"), pattern, black=(64, 65, 66, 67))
    frame = read_raw(path, DEFAULTS).frame
    assert np.array_equal(frame.dn, DN)
    assert (frame.colour_filter, frame.pixel_format, frame.bit_depth) == (pattern, f"Bayer{pattern}12", 12)
    assert (frame.saturation_dn, frame.black_level_dn, frame.plane_black_levels_dn) == (4095.0, 65.5, planes)


def test_facts_of_the_picture_come_from_its_tags(tmp_path):
    read = read_raw(write_dng(tmp_path / "a.dng", DN), DEFAULTS)
    facts = read.frame.exposure_s, read.frame.gain_db, read.f_number, read.focal_length_m
    assert facts == (1 / 125, pytest.approx(20 * log10(2)), 2.8, 0.05)
    assert read.frame.camera == CameraIdentity("Acme", "Still 1", "0815")
    assert read.frame.timestamp == datetime(2026, 3, 1, 11, tzinfo=UTC)
    # As a picture too, whatever its name.
    picture = read_picture((tmp_path / "a.dng").rename(tmp_path / "a.tif"))
    assert np.array_equal(picture.frame.dn, DN)
    assert (picture.frame.exposure_s, picture.f_number, picture.exposure_stated) == (1 / 125, 2.8, True)


def test_six_by_six_patterns_are_refused(tmp_path):
    x_trans = tuple(map(int, "110112112110201021112110110112021201"))
    with pytest.raises(InputError, match=r"has no Bayer pattern of red, green and blue"):
        read_raw(write_dng(tmp_path / "a.dng", DN, cfa=(6, x_trans)), DEFAULTS)


def test_a_monochrome_sensor_gives_a_mono_frame(tmp_path):
    path = write_dng(tmp_path / "a.dng", DN, cfa=None)
    data = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as tiff:
        # Linear raw, which tifffile writes for three samples only.
        struct.pack_into("<H", data, tiff.pages.first.tags[262].valueoffset, 34892)
    path.write_bytes(data)
    frame = read_raw(path, DEFAULTS).frame
    assert np.array_equal(frame.dn, DN)
    assert (frame.colour_filter, frame.pixel_format, frame.black_level_dn) == (None, "Mono12", 64.0)


@pytest.mark.parametrize(("clip", "spread"), [(3790, 0), (3790, 60), (3600, 30), (None, 0)])
def test_clipping_is_found_below_the_level_that_the_file_states(tmp_path, clip, spread):
    """Of a scene that fades towards the bright end; a bright surface, at other DN in each colour, is not clipped."""
    rng = np.random.default_rng(1)
    electrons = rng.gamma(1.2, 900, (800, 1200)) * np.tile([[0.5, 1.0], [0.96, 0.6]], (400, 600))
    dn = 128 + electrons + rng.normal(0, np.sqrt(0.3 * electrons + 4))
    if clip is None:
        dn = np.minimum(dn, 3000)
        for at, level in enumerate((3500, 3900, 3900, 3700)):
            dn[200 + at // 2 : 400 : 2, 200 + at % 2 : 400 : 2] = rng.normal(level, 25, (100, 100))
    else:
        dn = np.where(dn > clip, clip + rng.uniform(0, spread, dn.shape), dn)
    picture = read_picture(write_dng(tmp_path / "a.dng", dn.astype(np.uint16), black=(128,)))
    assert picture.frame.saturation_dn == pytest.approx(clip or 4095, abs=16)
    assert ("raw-clips-early" in [one.code for one in picture.findings]) == (clip is not None)
