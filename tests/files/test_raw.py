"""RAW files: DN bit by bit, facts of the picture, and files that cannot serve."""

from __future__ import annotations

import struct
from datetime import UTC, datetime
from math import log10

import numpy as np
import pytest
import tifffile

from labcdp.core.errors import InputError
from labcdp.core.frame import CameraIdentity
from labcdp.files import read_picture, read_raw


@pytest.mark.parametrize("byteorder", ["<", ">"])
@pytest.mark.parametrize("pattern", ["RG", "GB", "GR", "BG"])
def test_pixels_are_those_that_were_written(tmp_path, new_dng, dn, defaults, pattern, byteorder):
    frame = read_raw(new_dng(tmp_path / "a.dng", dn, pattern, byteorder=byteorder), defaults).frame
    assert np.array_equal(frame.dn, dn)
    assert (frame.colour_filter, frame.pixel_format, frame.bit_depth) == (pattern, f"Bayer{pattern}12", 12)
    assert (frame.saturation_dn, frame.black_level_dn, frame.plane_black_levels_dn) == (4095.0, 64.0, None)


def test_facts_of_the_picture_come_from_its_tags(tmp_path, new_dng, dn, defaults):
    read = read_raw(new_dng(tmp_path / "a.dng", dn), defaults)
    assert read.frame.exposure_s == 1 / 125
    assert read.frame.gain_db == pytest.approx(20 * log10(2))
    assert read.frame.camera == CameraIdentity("Acme", "Still 1", "0815")
    assert read.frame.timestamp == datetime(2026, 3, 1, 11, tzinfo=UTC)
    assert (read.f_number, read.focal_length_m) == (2.8, 0.05)


@pytest.mark.parametrize(
    ("pattern", "planes"),
    [
        ("RG", (64, 65, 66, 67)),
        ("GR", (65, 64, 67, 66)),
        ("GB", (66, 67, 64, 65)),
        ("BG", (67, 66, 65, 64)),
    ],
)
def test_black_levels_follow_their_planes(tmp_path, new_dng, dn, defaults, pattern, planes):
    frame = read_raw(new_dng(tmp_path / "a.dng", dn, pattern, black=(64, 65, 66, 67)), defaults).frame
    assert frame.black_level_dn == 65.5
    assert frame.plane_black_levels_dn == planes


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_truncated_file_is_refused(tmp_path, new_dng, dn, defaults, share):
    whole = new_dng(tmp_path / "a.dng", dn).read_bytes()
    short = tmp_path / "short.dng"
    short.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"short\.dng (is truncated|cannot be read as RAW|is not a camera RAW)"):
        read_raw(short, defaults)


def test_missing_pixels_are_noticed_before_libraw_reads_them(tmp_path, new_dng, dn, defaults, capfd):
    whole = new_dng(tmp_path / "a.dng", dn).read_bytes()
    short = tmp_path / "short.dng"
    short.write_bytes(whole[:-1])
    match = rf"short\.dng is truncated: its pixels reach to byte {len(whole)}, it has {len(whole) - 1}: copy it again"
    with pytest.raises(InputError, match=match):
        read_raw(short, defaults)
    assert capfd.readouterr().err == ""


def test_six_by_six_patterns_are_refused(tmp_path, new_dng, dn, defaults):
    x_trans = tuple(map(int, "110112112110201021112110110112021201"))
    path = new_dng(tmp_path / "a.dng", dn, cfa=(6, x_trans))
    with pytest.raises(InputError, match=r"has no Bayer pattern of red, green and blue"):
        read_raw(path, defaults)


def test_a_monochrome_sensor_gives_a_mono_frame(tmp_path, new_dng, dn, defaults):
    path = new_dng(tmp_path / "a.dng", dn, pattern=None, photometric=1)
    data = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as tiff:
        at = tiff.pages.first.tags[262].valueoffset
    # Linear raw, which tifffile writes for three samples only.
    data[at : at + 2] = struct.pack("<H", 34892)
    path.write_bytes(data)
    frame = read_raw(path, defaults).frame
    assert np.array_equal(frame.dn, dn)
    assert (frame.colour_filter, frame.pixel_format, frame.black_level_dn) == (None, "Mono12", 64.0)


def scene(planes=(0.5, 1.0, 0.96, 0.6)):
    """DN of a scene behind a Bayer pattern that fades towards the bright end, with photon noise."""
    rng = np.random.default_rng(1)
    electrons = rng.gamma(1.2, 900, (800, 1200)) * np.tile(np.array(planes).reshape(2, 2), (400, 600))
    return 128 + electrons + rng.normal(0, np.sqrt(0.3 * electrons + 4))


@pytest.mark.parametrize(("clip", "spread"), [(3790, 0), (3790, 60), (3600, 30)])
def test_clipping_is_found_below_the_level_that_the_file_states(tmp_path, new_dng, clip, spread):
    dn = scene()
    dn = np.where(dn > clip, clip + np.random.default_rng(2).uniform(0, spread, dn.shape), dn).astype(np.uint16)
    picture = read_picture(new_dng(tmp_path / "a.dng", dn, black=(128,)))
    assert picture.frame.saturation_dn == pytest.approx(clip, abs=16)
    assert "raw-clips-early" in [one.code for one in picture.findings]


def test_a_bright_surface_is_not_clipped(tmp_path, new_dng):
    """It is at other DN in each colour, with the noise of its light."""
    dn = np.minimum(scene(), 3000)
    rng = np.random.default_rng(3)
    for at, level in enumerate((3500, 3900, 3900, 3700)):
        dn[200 + at // 2 : 400 : 2, 200 + at % 2 : 400 : 2] = rng.normal(level, 25, (100, 100))
    picture = read_picture(new_dng(tmp_path / "a.dng", dn.astype(np.uint16), black=(128,)))
    assert picture.frame.saturation_dn == 4095
