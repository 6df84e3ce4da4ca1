"""RAW files: DN bit by bit, facts of the picture, and files that cannot serve."""

import struct
from datetime import UTC, datetime
from functools import partial
from math import log10

import numpy as np
import pytest
import tifffile

from labcdp.calibration.frames.measure import split
from labcdp.core.errors import InputError
from labcdp.core.frame import CameraIdentity
from labcdp.core.result import info, warning
from labcdp.evaluate.picture.converter import make_converter
from labcdp.files import PictureOptions, read_picture, read_raw

from .conftest import write_dng, write_mono_dng

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
    assert (frame.saturation_dn, frame.black_level_dn) == (4095.0, 65.5)
    assert tuple(one.black_level_dn for one in split(frame).values()) == planes


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
    path = write_mono_dng(tmp_path / "a.dng", DN)
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


def rationals(*values):
    """Signed fractions of 256ths."""
    return "2i", len(values), tuple(part for value in values for part in (round(256 * value), 256))


RNG = np.random.default_rng(2)
GROUP = RNG.uniform(40, 400, (3, 4)).round(2)
COLUMNS, ROWS = RNG.uniform(-30, 30, 48).round(), RNG.uniform(-30, 30, 32).round()
BLACK_TAGS = {
    "group": [(50713, "H", 2, GROUP.shape), (50714, *rationals(*GROUP.ravel()))],
    "lines": [(50714, *rationals(100.5)), (50715, *rationals(*COLUMNS)), (50716, *rationals(*ROWS))],
}


@pytest.mark.parametrize("cfa", ["RG", None])
@pytest.mark.parametrize("name", BLACK_TAGS)
@pytest.mark.parametrize("kind", ["DNG", "DNG of floats", "TIFF"])
def test_each_pixel_has_the_black_level_that_the_file_states(tmp_path, kind, name, cfa):
    """The part without masked pixels begins at (4, 6): the levels begin there (DNG 1.7, tags 50713 to 50716)."""
    top, left = (0, 0) if kind == "TIFF" else (4, 6)
    shape = 32, 48
    black = 100.5 + COLUMNS + ROWS[:, None] if name == "lines" else np.tile(GROUP, (11, 12))[: shape[0], : shape[1]]
    net = np.full(shape, 500.0)
    net[:, 24:] = 2000
    dn = np.zeros((shape[0] + top, shape[1] + left))
    dn[top:, left:] = net + black
    tags, path = list(BLACK_TAGS[name]), tmp_path / "a"
    write_raw = write_mono_dng if cfa is None else partial(write_dng, cfa=cfa)
    active = (50829, "H", 4, (top, left, top + shape[0], left + shape[1]))
    if kind == "TIFF":
        path = write_tiff(path, np.rint(dn).astype(np.uint16), tags)
    elif kind == "DNG":
        write_raw(path, np.rint(dn).astype(np.uint16), black=None, more=[*tags, active])
    else:
        # Values from 0 to 1, and levels in the same unit.
        factors = np.tile([1, 4096], 48)
        scaled = [
            (code, kind, n, tuple((np.array(values) * factors[: 2 * n]).tolist()) if kind == "2i" else values)
            for code, kind, n, values in tags
        ]
        write_raw(path, (dn / 4096).astype(np.float32), black=None, white=1, more=[*scaled, active])
    picture = read_picture(path, PictureOptions(exposure_s=1))
    light = make_converter().luminance(picture)
    right = light.luminance_cd_m2[:, light.shape[1] // 2 :]
    # DN are rounded, of which the green pixels are averaged.
    assert right / light.luminance_cd_m2[:, : light.shape[1] // 2] == pytest.approx(4, abs=0.006)
    assert "black-pattern" in [one.code for one in picture.findings]
    if kind == "DNG of floats":
        assert picture.frame.saturation_dn == 65535


def write_tiff(path, dn, tags, description=""):
    tifffile.imwrite(path, dn, metadata=None, extratags=[(*tag, True) for tag in tags], description=description)
    return path


def test_pixels_are_saturated_by_what_is_stored(tmp_path):
    """However high the black level of the pixel."""
    dn = np.full((32, 32), 4000, np.uint16)
    dn[0, 0] = dn[1, 1] = 4095
    path = write_mono_dng(tmp_path / "a.dng", dn, black=(64, 64, 64, 3000))
    assert read_raw(path, DEFAULTS).frame.saturated.nonzero()[0].tolist() == [0, 1]
    path = write_tiff(tmp_path / "a.tif", dn, [(50714, "H", 1, 64), (50717, "H", 1, 4000)])
    picture = read_picture(path)
    assert (picture.frame.saturated.all(), picture.frame.black_level_dn) == (True, 64)


def test_differences_may_bring_a_black_level_below_0(tmp_path):
    """BlackLevel 0 with a difference of -10 in each row (DNG 1.7, tag 50716)."""
    dn = np.full((32, 48), 500, np.uint16)
    dn[:, 24:] = 2000
    path = write_tiff(tmp_path / "a.tif", dn, [(50714, "H", 1, 0), (50716, *rationals(*[-10] * 32))])
    light = make_converter().luminance(read_picture(path)).luminance_cd_m2
    assert light[:, 30:].mean() / light[:, :20].mean() == pytest.approx(2010 / 510)


def test_masked_pixels_give_the_black_level_that_is_not_stated(tmp_path):
    dn = RNG.integers(1000, 1010, (40, 60)).astype(np.uint16)
    dn[:, :20] = 200
    tags = [(50829, "H", 4, (0, 20, 40, 60)), (50830, "H", 4, (0, 0, 40, 20))]
    picture = read_picture(write_dng(tmp_path / "a.dng", dn, black=None, more=tags))
    assert (picture.frame.black_level_dn, picture.shape) == (200, (40, 40))
    assert info("black-level-measured", black_dn=200.0) in picture.findings
    picture = read_picture(write_dng(tmp_path / "b.dng", dn, black=(64,), more=tags))
    assert picture.frame.black_level_dn == 64
    assert warning("black-level-contradicted", stated_dn=64.0, measured_dn=200.0) in picture.findings


def test_what_is_stated_and_not_applied_is_named(tmp_path):
    gain_map = struct.pack(">IIIII", 1, 9, 0x01030000, 0, 4) + bytes(4)
    picture = read_picture(write_dng(tmp_path / "a.dng", DN, more=[(51009, "B", len(gain_map), gain_map)]))
    assert warning("sensor-corrections-not-applied", names=["GainMap"]) in picture.findings
    xmp = (
        b'<x:xmpmeta><rdf:Description Camera:BlackCurrent="4096" drone-dji:VignettingData="1e-5, 2e-7">'
        b"<MicaSense:RadiometricCalibration><rdf:Seq><rdf:li>1e-4</rdf:li></rdf:Seq></MicaSense:RadiometricCalibration>"
    )
    picture = read_picture(write_tiff(tmp_path / "a.tif", 4 * DN + 4096, [(700, "B", len(xmp), xmp)]))
    assert picture.frame.black_level_dn == 4096
    assert info("black-level-from-xmp", name="BlackCurrent", black_dn=4096.0) in picture.findings
    names = ["RadiometricCalibration", "VignettingData"]
    assert warning("sensor-corrections-not-applied", names=names) in picture.findings


@pytest.mark.parametrize("suffix", ["dng", "tif"])
def test_a_table_of_linearisation_is_applied(tmp_path, suffix):
    table = (np.arange(4096) ** 2 // 4096).astype(np.uint16)
    tags = [(50712, "H", 4096, tuple(table.tolist()))]
    path = tmp_path / f"a.{suffix}"
    write_dng(path, DN, more=tags) if suffix == "dng" else write_tiff(path, DN, tags)
    picture = read_picture(path)
    assert np.array_equal(picture.frame.dn, table[DN])
    assert info("linearization-applied") in picture.findings


def test_a_black_level_and_a_filter_that_are_given_count_before_those_of_the_file(tmp_path):
    path = write_dng(tmp_path / "a.dng", DN, black=(64,))
    picture = read_picture(path, PictureOptions().given(black_level_dn=80.0, bayer="BGGR"))
    assert (picture.frame.black_level_dn, picture.frame.colour_filter) == (80.0, "BG")
    assert warning("black-level-replaced", stated_dn=64.0, given_dn=80.0) in picture.findings
    assert warning("colour-filter-replaced", stated="RGGB", given="BGGR") in picture.findings
    same = read_picture(path, PictureOptions().given(black_level_dn=64.0, bayer="RGGB"))
    assert not [one.code for one in same.findings if one.code.endswith("-replaced")]
