"""RAW files: DN bit by bit, facts of the picture, and files that cannot serve."""

from __future__ import annotations

import struct
from dataclasses import replace
from datetime import UTC, datetime
from math import log10

import numpy as np
import pytest
import tifffile

from labcdp.errors import InputError
from labcdp.frame import CameraIdentity
from labcdp.sources import read_raw


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


def test_what_the_file_does_not_say_is_taken_from_the_defaults(tmp_path, new_dng, dn, defaults):
    path = new_dng(tmp_path / "a.dng", dn, exposure=None, iso=None, serial="")
    frame = read_raw(path, replace(defaults, exposure_s=0.5, gain_db=6.0)).frame
    assert (frame.exposure_s, frame.gain_db, frame.camera.serial) == (0.5, 6.0, "Serial")


def test_a_missing_exposure_is_asked_for(tmp_path, new_dng, dn, defaults):
    path = new_dng(tmp_path / "a.dng", dn, exposure=None)
    with pytest.raises(InputError, match=r"a\.dng does not say its exposure time: give it with --exposure, in seconds"):
        read_raw(path, defaults)


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


def test_no_raw_file_is_refused(tmp_path, defaults):
    for content, match in ((b"", r"is empty"), (b"hello" * 100, r"cannot be read as RAW|is not a camera RAW file")):
        path = tmp_path / "a.nef"
        path.write_bytes(content)
        with pytest.raises(InputError, match=match):
            read_raw(path, defaults)
    with pytest.raises(InputError, match=r"none\.nef cannot be read \(No such file"):
        read_raw(tmp_path / "none.nef", defaults)


def test_six_by_six_patterns_are_refused(tmp_path, new_dng, dn, defaults):
    x_trans = (
        1,
        1,
        0,
        1,
        1,
        2,
        1,
        1,
        2,
        1,
        1,
        0,
        2,
        0,
        1,
        0,
        2,
        1,
        1,
        1,
        2,
        1,
        1,
        0,
        1,
        1,
        0,
        1,
        1,
        2,
        0,
        2,
        1,
        2,
        0,
        1,
    )
    path = new_dng(tmp_path / "a.dng", dn, cfa=(6, x_trans))
    with pytest.raises(InputError, match=r"has no Bayer pattern of red, green and blue"):
        read_raw(path, defaults)


def test_a_filter_array_without_a_pattern_is_refused(tmp_path, new_dng, dn, defaults):
    with pytest.raises(InputError, match=r"has no Bayer pattern of red, green and blue"):
        read_raw(new_dng(tmp_path / "a.dng", dn, pattern=None), defaults)


def test_a_linear_dng_is_refused(tmp_path, new_dng, dn, defaults):
    path = new_dng(tmp_path / "a.dng", np.stack([dn] * 3, axis=-1), pattern=None, photometric=34892)
    with pytest.raises(InputError, match=r"holds several values for each pixel \(a linear DNG or a layered sensor\)"):
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
