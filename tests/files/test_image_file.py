"""Images that other programs recorded."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.files import read_image


@dataclass(frozen=True)
class Layout:
    name: str = "Mono12"
    bit_depth: int = 12
    colour_filter: str | None = None


@pytest.fixture
def timed(defaults):
    return replace(defaults, exposure_s=0.01)


def exif_with_directory() -> bytes:
    """An EXIF block whose exposure and ISO speed stand in a directory of their own, as cameras write it."""
    first = struct.pack("<2sHIHHHIII", b"II", 42, 8, 1, 34665, 4, 1, 26, 0)
    entries = struct.pack("<HHHIIHHIHHI", 2, 33434, 5, 1, 56, 34855, 3, 1, 400, 0, 0)
    return first + entries + struct.pack("<II", 1, 50)


def with_chunk(png: bytes, name: bytes, content: bytes) -> bytes:
    body = name + content
    chunk = struct.pack(">I", len(content)) + body + struct.pack(">I", zlib.crc32(body))
    return png[:33] + chunk + png[33:]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("suffix", ["tif", "png"])
def test_pixels_are_those_that_were_written(tmp_path, dn, timed, dtype, suffix):
    path = tmp_path / f"a.{suffix}"
    pixels = (dn // 16 if dtype == np.uint8 else dn).astype(dtype)
    cv2.imwrite(str(path), pixels)
    frame = read_image(path, Layout(), timed).frame
    assert np.array_equal(frame.dn, pixels)
    assert frame.dn.dtype == dtype
    assert (frame.exposure_s, frame.saturation_dn, frame.pixel_format) == (0.01, 4095.0, "Mono12")


def test_the_colour_filter_comes_from_the_layout(tmp_path, dn, timed):
    tifffile.imwrite(tmp_path / "a.tif", dn, photometric="minisblack")
    frame = read_image(tmp_path / "a.tif", Layout("BayerGB12", 12, "GB"), timed).frame
    assert (frame.colour_filter, frame.pixel_format) == ("GB", "BayerGB12")


def test_exposure_and_gain_of_the_file_win(tmp_path, dn, timed):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), dn)
    path.write_bytes(with_chunk(path.read_bytes(), b"eXIf", exif_with_directory()))
    frame = read_image(path, Layout(), timed).frame
    assert frame.exposure_s == 0.02
    assert frame.gain_db == pytest.approx(12.04, abs=0.01)


@pytest.mark.parametrize(
    ("name", "pixels", "match"),
    [
        ("a.png", np.eye(4, dtype=np.uint8)[..., None] * (1, 2, 3), r"is coloured, of 8 bits: give a grey image"),
        ("a.tif", np.eye(4, dtype=np.uint8)[..., None] * (1, 2, 3), r"is coloured, of 8 bits: give a grey image"),
        ("a.tif", np.zeros((4, 4), dtype=np.float32), r"is of floats: give a grey image"),
        ("a.tif", np.zeros((2, 4, 4), dtype=np.uint8), r"holds 2 pictures"),
    ],
)
def test_other_images_are_refused(tmp_path, timed, name, pixels, match):
    path, pixels = tmp_path / name, pixels.astype(np.float32 if pixels.dtype == np.float32 else np.uint8)
    if name.endswith("png"):
        cv2.imwrite(str(path), pixels)
    elif pixels.ndim == 3 and pixels.shape[-1] == 3:
        tifffile.imwrite(path, pixels, photometric="rgb")
    else:
        tifffile.imwrite(path, pixels, photometric="minisblack")
    with pytest.raises(InputError, match=match):
        read_image(path, Layout(), timed)


@given(cut=st.integers(8, 1000), flip=st.booleans())
def test_a_damaged_png_is_never_taken_for_whole(tmp_path_factory, cut, flip):
    from labcdp.core.frame import CameraIdentity
    from labcdp.files import FileDefaults

    path = tmp_path_factory.getbasetemp() / "damaged.png"
    cv2.imwrite(str(path), np.arange(400, dtype=np.uint16).reshape(20, 20))
    data = bytearray(path.read_bytes())
    at = 8 + cut % (len(data) - 12 - 8)
    damaged = data[:at] + bytes([data[at] ^ 255]) + data[at + 1 :] if flip else data[:at]
    path.write_bytes(damaged)
    with pytest.raises(InputError, match=r"truncated|damaged"):
        read_image(path, Layout(), FileDefaults(0.01, 0.0, CameraIdentity("", "", "")))
