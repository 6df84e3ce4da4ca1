"""What a person gave counts before what a file says; what cannot count is named."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from labcdp.cli.pictures.picture_options import picture_options
from labcdp.core.finding import warning
from labcdp.evaluate.picture.light.picture import picture_conversion
from labcdp.files import PictureOptions, read_picture
from labcdp.files.video.open import Selection, frames_of, open_video
from labcdp.session.frame_file import frame_to_tiff

GREY = np.random.default_rng(4).integers(0, 256, (12, 16), dtype=np.uint8)
SESSION = Path(__file__).parents[2] / "labcdp/data/example-session"
REPLACED = ["exposure-replaced", "gain-replaced"]


def codes(source):
    """Codes of the warnings about a picture or a video."""
    return [one.code for one in source.findings if one.severity == "warning"]


def given(**changes):
    """Options as the commands make them of what was typed."""
    nothing = dict.fromkeys(("exposure", "gain_db", "bit_depth", "pixel_format", "size"))
    return picture_options(PictureOptions(), **nothing | changes)


@pytest.fixture
def stated(tmp_path, new_dng):
    """Files that say 8 ms and 6.02 dB, by suffix."""
    block = Image.Exif()
    block.get_ifd(0x8769).update({0x829A: 0.008, 0x8827: 200})
    Image.fromarray(GREY).save(tmp_path / "a.jpg", exif=block)
    tags = [(33434, "2I", 1, (1, 125), True), (34855, "H", 1, 200, True)]
    tifffile.imwrite(tmp_path / "a.tif", GREY, photometric="minisblack", extratags=tags)
    new_dng(tmp_path / "a.dng", np.tile(GREY.astype(np.uint16), (4, 4)), exposure=(1, 125), iso=200)
    frame = read_picture(tmp_path / "a.tif").frame
    (tmp_path / "recorded.tiff").write_bytes(frame_to_tiff(frame, compress=False))
    return {path.suffix: path for path in tmp_path.iterdir()}


@pytest.mark.parametrize("suffix", [".jpg", ".tif", ".dng", ".tiff"])
def test_a_typed_exposure_and_gain_count_before_those_of_the_file(stated, suffix):
    picture = read_picture(stated[suffix], given(exposure="5ms", gain_db=12.0))
    assert (picture.frame.exposure_s, picture.frame.gain_db) == (0.005, 12.0)
    assert codes(picture) == REPLACED
    assert set(REPLACED) <= {one.code for one in picture_conversion(None, None, None).findings(picture)}
    exposure = next(one for one in picture.findings if one.code == "exposure-replaced")
    assert exposure.values == {"stated_s": pytest.approx(0.008), "given_s": 0.005}


def test_what_a_calibration_knows_does_not_overrule_the_file(stated):
    picture = read_picture(stated[".tif"], PictureOptions(exposure_s=0.005, gain_db=12.0))
    assert (picture.frame.exposure_s, codes(picture)) == (0.008, [])


def test_a_typed_exposure_counts_before_that_of_a_session():
    assert open_video(SESSION).findings == open_video(SESSION, PictureOptions(exposure_s=1.0)).findings
    source = open_video(SESSION, given(exposure="5s", bit_depth=4))
    first = next(iter(frames_of(source, Selection())))
    assert first.frame.exposure_s == 5.0
    assert {"exposure-replaced", "session-bit-depth"} <= set(codes(source))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"bit_depth": 4}, warning("bit-depth-ignored", given=4, bits=8)),
        ({"size": "10x9"}, warning("size-ignored", given_width=10, given_height=9, width=16, height=12)),
        ({"pixel_format": "Mono12Packed"}, warning("pixel-format-ignored", given="Mono12Packed")),
    ],
)
def test_options_that_cannot_count_are_named(tmp_path, changes, expected):
    cv2.imwrite(str(tmp_path / "a.png"), GREY)
    changes |= {"pixel_format": "Mono8"} if "size" in changes else {}
    assert read_picture(tmp_path / "a.png", given(**changes)).findings == (expected,)


# What a PNG says of its curve


def with_chunk(path, name, body):
    """Write a grey PNG with a further chunk behind its header."""
    data = cv2.imencode(".png", GREY)[1].tobytes()
    chunk = struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    path.write_bytes(data[:33] + chunk + data[33:])
    return read_picture(path)


@pytest.mark.parametrize(
    ("gamma", "encoding", "note"),
    [
        (100_000, "linear", None),
        (45_455, "srgb", None),
        (45_454, "srgb", None),
        (55_556, "srgb", warning("png-gamma", gamma=0.55556, encoding="sRGB")),
    ],
)
def test_a_gamma_that_is_not_known_is_named(tmp_path, gamma, encoding, note):
    picture = with_chunk(tmp_path / "a.png", b"gAMA", struct.pack(">I", gamma))
    assert picture.encoding == encoding
    assert picture.findings == (() if note is None else (note,))


def test_nothing_of_dn_counts_for_floats(tmp_path):
    np.save(tmp_path / "a.npy", GREY.astype(np.float32))
    options = picture_options(picture_conversion(None, None, "srgb").options, "5ms", None, None, None, None)
    assert read_picture(tmp_path / "a.npy", options).findings == (
        warning("option-needs-dn", option="exposure"),
        warning("encoding-ignored", given="srgb", encoding="linear"),
    )


def test_a_profile_of_grey_values_is_named(tmp_path):
    from PIL import ImageCms

    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    picture = with_chunk(tmp_path / "a.png", b"iCCP", b"grey\0\0" + zlib.compress(profile))
    assert picture.encoding == "linear"
    assert warning("png-icc-profile", encoding="linear") in picture.findings
