"""Files that are no pictures, broken ones, and ones that would eat all memory: one clear line each."""

from __future__ import annotations

import os
import struct
import tracemalloc
import zipfile
import zlib

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from labcdp.core.errors import InputError
from labcdp.core.finding import warning
from labcdp.core.luminance import LuminanceMap
from labcdp.files import PictureOptions, read_picture
from labcdp.files.luminance_file import save_luminance

DN = np.random.default_rng(1).integers(0, 4096, (40, 60), dtype=np.uint16)
GREY = (DN >> 4).astype(np.uint8)
COLOURS = np.dstack([GREY, GREY // 2, GREY // 3])
FLOATS = DN.astype(np.float32)


def exr(path, **channels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


WRITERS = {
    "grey.png": lambda path: cv2.imwrite(str(path), DN),
    "colours.png": lambda path: cv2.imwrite(str(path), COLOURS),
    "palette.png": lambda path: Image.fromarray(COLOURS).quantize(9).save(path),
    "grey.jpg": lambda path: cv2.imwrite(str(path), GREY),
    "progressive.jpg": lambda path: Image.fromarray(COLOURS).save(path, progressive=True),
    "plain.tif": lambda path: tifffile.imwrite(path, DN, photometric="minisblack"),
    "deflate.tif": lambda path: tifffile.imwrite(path, DN, photometric="minisblack", compression="zlib", predictor=2),
    "tiles.tif": lambda path: tifffile.imwrite(path, COLOURS, photometric="rgb", tile=(16, 16)),
    "lzw.tif": lambda path: Image.fromarray(COLOURS).save(path, compression="tiff_lzw"),
    "floats.tif": lambda path: tifffile.imwrite(path, FLOATS, photometric="minisblack"),
    "y.exr": lambda path: exr(path, Y=FLOATS),
    "rgb.exr": lambda path: exr(path, R=FLOATS, G=FLOATS, B=FLOATS),
    "array.npy": lambda path: np.save(path, DN),
    "luminance.tif": lambda path: save_luminance(LuminanceMap(FLOATS, FLOATS, 0.1, GREY), path, {}),
    "luminance.npz": lambda path: save_luminance(LuminanceMap(FLOATS, FLOATS, 0.1, GREY), path, {}),
    "luminance.exr": lambda path: save_luminance(LuminanceMap(FLOATS, FLOATS, 0.1, GREY), path, {}),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory, new_dng):
    """Bytes of a good file of each kind."""
    folder = tmp_path_factory.mktemp("whole")
    for name, write in WRITERS.items():
        write(folder / name)
    new_dng(folder / "raw.dng", DN)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged")


def one_line(error):
    text = str(error.value)
    assert "\n" not in text
    assert len(text) < 500
    return text


# Damage


@pytest.mark.parametrize("name", [*WRITERS, "raw.dng"])
@settings(max_examples=25)
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_file_that_is_cut_is_refused(whole, folder, name, share):
    path, data = folder / f"cut_{name}", whole[name]
    # The last bytes of a TIFF and of a RAW file may be of other things than pixels.
    cut = int(share * len(data) * (0.99 if name.endswith(("tif", "dng")) else 1))
    path.write_bytes(data[:cut])
    with pytest.raises(InputError) as error:
        read_picture(path)
    assert path.name in one_line(error)


@pytest.mark.parametrize("name", [*WRITERS, "raw.dng"])
@settings(max_examples=25)
@given(data=st.data())
def test_a_file_with_other_bytes_is_read_or_refused(whole, folder, name, data):
    path, damaged = folder / f"flipped_{name}", bytearray(whole[name])
    end = data.draw(st.sampled_from([min(500, len(damaged)), len(damaged)]))
    for at in data.draw(st.lists(st.integers(0, end - 1), min_size=1, max_size=4)):
        damaged[at] = data.draw(st.integers(0, 255))
    path.write_bytes(damaged)
    try:
        text = str([one.values for one in read_picture(path).findings])
    except InputError as error:
        text = str(error)
    assert "\n" not in text


@pytest.mark.parametrize("name", ["grey.png", "luminance.npz"])
def test_formats_with_checks_tell_each_changed_byte(whole, tmp_path, name):
    data = whole[name]
    start = data.index(b"IDAT" if name.endswith("png") else b"luminance_cd_m2.npy") + 60
    damaged = data[:start] + bytes([data[start] ^ 1]) + data[start + 1 :]
    (tmp_path / name).write_bytes(damaged)
    with pytest.raises(InputError):
        read_picture(tmp_path / name)


def test_pages_that_go_round_in_circles_are_refused(whole, tmp_path):
    data = bytearray(whole["plain.tif"])
    (first,) = struct.unpack_from("<I", data, 4)
    (entries,) = struct.unpack_from("<H", data, first)
    struct.pack_into("<I", data, first + 2 + 12 * entries, first)
    (tmp_path / "circle.tif").write_bytes(data)
    (tmp_path / "loop.tif").write_bytes(b"II*\0" + struct.pack("<IHI", 8, 0, 8))
    saved = bytearray(whole["luminance.tif"])
    at, previous = struct.unpack_from("<I", saved, 4)[0], 4
    for _ in range(4):
        previous = at + 2 + 12 * struct.unpack_from("<H", saved, at)[0]
        (at,) = struct.unpack_from("<I", saved, previous)
    saved[previous : previous + 4] = saved[4:8]
    (tmp_path / "luminance.tif").write_bytes(saved)
    for name in ("circle.tif", "loop.tif", "luminance.tif"):
        with pytest.raises(InputError, match=rf"{name} is damaged: its list of pages leads back to byte \d+ and never"):
            read_picture(tmp_path / name)


def test_what_decoders_print_is_said_in_its_place(whole, tmp_path, capfd):
    data = whole["grey.jpg"]
    (tmp_path / "a.jpg").write_bytes(data[:-30] + b"\xff\xd9")
    picture = read_picture(tmp_path / "a.jpg")
    message = "Corrupt JPEG data: premature end of data segment"
    assert warning("decoder-message", message=message) in picture.findings
    png = bytearray(whole["grey.png"])
    at = png.index(b"IDAT")
    (length,) = struct.unpack_from(">I", png, at - 4)
    png[at + 20] ^= 255
    struct.pack_into(">I", png, at + 4 + length, zlib.crc32(png[at : at + 4 + length]))
    (tmp_path / "a.png").write_bytes(png)
    with pytest.raises(InputError, match=r"a\.png is damaged, truncated or no PNG"):
        read_picture(tmp_path / "a.png")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("kind", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"])
def test_every_compression_of_exr_is_read_whole_and_refused_cut(tmp_path, kind):
    """Shapes that end within a chunk too."""
    for height in (1, 33, 40):
        header = {"compression": getattr(OpenEXR, f"{kind}_COMPRESSION"), "type": OpenEXR.scanlineimage}
        path = tmp_path / f"{height}.exr"
        with OpenEXR.File(header, {"Y": np.tile(FLOATS, (1, 2))[:height]}) as file:
            file.write(str(path))
        assert read_picture(path).shape == (height, 120)
        data = path.read_bytes()
        path.write_bytes(data[:-1])
        with pytest.raises(InputError, match="is truncated or damaged"):
            read_picture(path)


@pytest.mark.parametrize(("tag", "value"), [(256, 120), (257, 80)])
def test_a_tiff_with_data_for_a_part_of_its_pixels_is_refused(whole, tmp_path, tag, value):
    """Twice as wide, or twice as high: a strip is too short, or one is missing."""
    path = tmp_path / "a.tif"
    path.write_bytes(whole["plain.tif"])
    with tifffile.TiffFile(path) as tiff:
        at = tiff.pages.first.tags[tag].valueoffset
    data = bytearray(whole["plain.tif"])
    data[at : at + 2] = struct.pack("<H", value)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"a\.tif is damaged: it(s part at byte \d+ holds fewer| has data for a part)"):
        read_picture(path)


# No pictures


@pytest.mark.parametrize(
    ("name", "data", "match"),
    [
        ("a.png", b"", r"a\.png is empty: copy it again from the camera"),
        ("a.jpg", b"GIF89a and so on", r"a\.jpg is no image that labcdp reads: give PNG, JPEG, TIFF, OpenEXR, NPY"),
        ("a.png", b"<svg/>", r"a\.png is no image that labcdp reads"),
        ("a.raw", bytes(100), r"a\.raw does not say what it is: for a raw dump give its size and pixel format"),
        ("a.cr2", b"no RAW file at all", r"a\.cr2 cannot be read as RAW \(Input/output error\): copy it again"),
        ("a.png", b"\x89PNG\r\n\x1a\n", r"a\.png is damaged, truncated or no PNG"),
        ("a.npz", b"PK\x03\x04" + bytes(50), r"a\.npz is no luminance map that labcdp saved"),
    ],
)
def test_what_is_not_an_image_is_refused(tmp_path, name, data, match):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=match):
        read_picture(tmp_path / name)


def test_what_cannot_be_opened_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"missing\.png cannot be read \(No such file or directory\)"):
        read_picture(tmp_path / "missing.png")
    with pytest.raises(InputError, match=r"cannot be read \(it is a folder\): give an image file"):
        read_picture(tmp_path)
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(InputError, match=r"pipe\.png cannot be read \(it is a pipe, not a file\)"):
        read_picture(tmp_path / "pipe.png")


def test_other_arrays_are_refused(tmp_path):
    for values, match in [
        (np.zeros((3, 4, 3)), r"is an array of shape \(3, 4, 3\): give a 2-D array, one value a pixel"),
        (np.zeros(5), r"is an array of shape \(5,\)"),
        (np.zeros((2, 2), complex), r"holds complex128: give an array of whole numbers \(DN\) or floats"),
        (np.zeros((2, 2), "U3"), r"holds <U3"),
        (np.full((2, 2), -1), r"has values from -1 to -1: DN are whole numbers from 0 to 65535"),
        (np.full((2, 2), 70000), r"has values from 70000 to 70000"),
        (np.full((2, 2), 1e39), r"has values beyond 3\.4e\+38: give them in a larger unit"),
        (np.zeros((0, 5)), r"announces 5 x 0 pixels"),
    ]:
        np.save(tmp_path / "a.npy", values)
        with pytest.raises(InputError, match=match):
            read_picture(tmp_path / "a.npy")


def test_a_pickle_is_never_opened(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[print]], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match=r"a\.npy: it holds 'object': give numbers"):
        read_picture(tmp_path / "a.npy")


def test_raw_dumps_of_another_size_or_format_are_refused(tmp_path):
    (tmp_path / "a.raw").write_bytes(bytes(3600))
    size = (60, 40)
    assert read_picture(tmp_path / "a.raw", PictureOptions(size=size, pixel_format="Mono12Packed")).shape == (40, 60)
    with pytest.raises(InputError, match=r"a\.raw has 3600 bytes, 60 x 40 pixels of Mono8 take 2400: give the size"):
        read_picture(tmp_path / "a.raw", PictureOptions(size=size, pixel_format="Mono8"))
    with pytest.raises(InputError, match=r"a\.raw is a raw dump: give its pixel format too"):
        read_picture(tmp_path / "a.raw", PictureOptions(size=size))
    (tmp_path / "b.bin").write_bytes(b"\xff" * 4800)
    with pytest.raises(InputError, match=r"b\.bin has values up to 65535, Mono12 ends at 4095"):
        read_picture(tmp_path / "b.bin", PictureOptions(size=size, pixel_format="Mono12"))


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"exposure_s": 0.0}, r"the exposure is 0\.0 s: give a time above 0 s"),
        ({"gain_db": float("nan")}, r"the gain is nan dB"),
        ({"bit_depth": 17}, r"the bit depth is 17: give 1 to 16 bits"),
        ({"pixel_format": "RGB8"}, r"pixel format 'RGB8' is not supported: choose one of .*Mono12Packed"),
        ({"size": (0, 5)}, r"the size is 0 x 5 pixels: give at least 1 x 1"),
        ({"max_pixels": 0}, r"the limit is 0 pixels"),
    ],
)
def test_impossible_options_are_refused(options, match):
    with pytest.raises(InputError, match=match):
        PictureOptions(**options)


# Bombs


def png_bomb(path, width, height):
    """A PNG of a single value whose few bytes announce any number of pixels."""
    rows = zlib.compressobj(9)
    data = rows.compress(bytes(1 + width // 8)) + rows.flush()
    parts = [(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)), (b"IDAT", data), (b"IEND", b"")]
    chunks = [struct.pack(">I", len(b)) + n + b + struct.pack(">I", zlib.crc32(n + b)) for n, b in parts]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))


def jpeg_bomb(path):
    cv2.imwrite(str(path), GREY)
    data = bytearray(path.read_bytes())
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = struct.pack(">HH", 65000, 65000)
    path.write_bytes(data)


def tiff_bomb(path):
    with tifffile.TiffWriter(path, bigtiff=False) as tiff:
        tiff.write(
            iter([np.zeros((1024, 1024), np.uint8)] * 4),
            shape=(2048, 2048),
            dtype=np.uint8,
            tile=(1024, 1024),
            photometric="minisblack",
            compression="zlib",
        )
    with tifffile.TiffFile(path) as tiff:
        tags = tiff.pages.first.tags
        places = [tags[code].valueoffset for code in (256, 257)]
    data = bytearray(path.read_bytes())
    for at in places:
        data[at : at + 2] = struct.pack("<H", 60000)
    path.write_bytes(data)


def exr_bomb(path):
    exr(path, Y=FLOATS)
    data = bytearray(path.read_bytes())
    for name in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = data.index(name) + len(name) + 4
        data[at : at + 16] = struct.pack("<4i", 0, 0, 99_999, 99_999)
    path.write_bytes(data)


def npy_bomb(path):
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (100000, 100000), }"
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode())


def npz_bomb(path):
    """A whole archive in which one array is far larger than the others say."""
    save_luminance(LuminanceMap(FLOATS, FLOATS, 0.1, GREY), path, {})
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (60000, 60000), }\n"
    content = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + bytes(10_000_000)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("more.npy", content)


BOMBS = {
    "a.png": lambda path: png_bomb(path, 60_000, 60_000),
    "a.jpg": jpeg_bomb,
    "a.tif": tiff_bomb,
    "a.exr": exr_bomb,
    "a.npy": npy_bomb,
    "a.npz": npz_bomb,
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_before_memory_is_taken(tmp_path, name):
    path = tmp_path / name
    BOMBS[name](path)
    assert path.stat().st_size < 1e6
    tracemalloc.start()
    try:
        with pytest.raises(
            InputError, match=r"announces \d+ x \d+ pixels, more than the limit of 250|its values reach to"
        ):
            read_picture(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 20e6


def test_several_pictures_in_a_file_are_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((3, 8, 8), np.uint8), photometric="minisblack")
    with pytest.raises(InputError, match=r"a\.tif holds 3 pictures: give files of one picture each"):
        read_picture(tmp_path / "a.tif")
    frames = [Image.fromarray(GREY), Image.fromarray(255 - GREY)]
    frames[0].save(tmp_path / "a.png", save_all=True, append_images=frames[1:])
    with pytest.raises(InputError, match=r"a\.png holds several pictures"):
        read_picture(tmp_path / "a.png")


def test_other_kinds_are_refused(tmp_path):
    Image.fromarray(COLOURS).convert("CMYK").save(tmp_path / "a.jpg")
    with pytest.raises(InputError, match=r"a\.jpg has the colours CMYK, as for print: save it as grey or RGB"):
        read_picture(tmp_path / "a.jpg")
    Image.fromarray(COLOURS).convert("CMYK").save(tmp_path / "a.tif")
    with pytest.raises(InputError, match=r"a\.tif holds 4 values a pixel as SEPARATED: save it as grey or RGB"):
        read_picture(tmp_path / "a.tif")
    exr(tmp_path / "a.exr", depth=FLOATS, Z=FLOATS)
    with pytest.raises(
        InputError, match=r"a\.exr has the channels Z, depth: give one with Y, luminance, or R, G and B"
    ):
        read_picture(tmp_path / "a.exr")
