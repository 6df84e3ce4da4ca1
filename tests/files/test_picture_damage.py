"""Files that are no pictures, broken ones, and ones that would eat all memory: one clear line each.

Any damaged byte is the matter of the fuzz targets.
"""

import os
import struct
import tracemalloc
import zipfile
import zlib
from functools import partial

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from labcdp.core.errors import InputError
from labcdp.core.luminance import LuminanceMap
from labcdp.core.result import warning
from labcdp.files import PictureOptions, read_picture
from labcdp.files.luminance_file import save_luminance

from .conftest import write_dng
from .png_bytes import chunk
from .test_picture import exr
from .test_picture import tiff as write_tiff

DN = np.random.default_rng(1).integers(0, 4096, (40, 60), dtype=np.uint16)
GREY = (DN >> 4).astype(np.uint8)
COLOURS = np.dstack([GREY, GREY // 2, GREY // 3])
FLOATS = DN.astype(np.float32)


def luminance(path):
    save_luminance(LuminanceMap(FLOATS, FLOATS, 0.1, GREY), path, {}, force=True)


def tiff(values, **how):
    return partial(write_tiff, dn=values, **how)


def with_opencv(values):
    return lambda path: cv2.imwrite(str(path), values)


WRITERS = {
    "grey.png": with_opencv(DN),
    "grey.jpg": with_opencv(GREY),
    "plain.tif": tiff(DN),
    "deflate.tif": tiff(DN, compression="zlib", predictor=2),
    "tiles.tif": tiff(COLOURS, photometric="rgb", tile=(16, 16)),
    "rgb.exr": lambda path: exr(path, R=FLOATS, G=FLOATS, B=FLOATS),
    # Heights that end within a chunk too.
    **{f"{kind}{height}.exr": lambda path, kind=kind, height=height:
       exr(path, {"compression": getattr(OpenEXR, f"{kind}_COMPRESSION")}, Y=np.tile(FLOATS, (1, 2))[:height])
       for kind, height in (("NO", 1), ("RLE", 40), ("ZIPS", 33), ("PIZ", 33), ("PXR24", 1), ("B44A", 33),
                            ("DWAB", 33))},
    "array.npy": lambda path: np.save(path, DN),
    "luminance.tif": luminance,
    "luminance.npz": luminance,
    "luminance.exr": luminance,
    "raw.dng": lambda path: write_dng(path, DN),
}  # fmt: skip


@pytest.mark.parametrize("name", WRITERS)
@settings(max_examples=8)
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_file_that_is_cut_is_refused(tmp_path_factory, name, share):
    path = tmp_path_factory.getbasetemp() / name
    WRITERS[name](path)
    read_picture(path)
    # The last bytes of a TIFF and of a RAW file may be of other things than pixels.
    cut = int(share * path.stat().st_size * (0.99 if name.endswith(("tif", "dng")) else 1))
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(InputError) as error:
        read_picture(path)
    assert name in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 500


def test_what_a_decoder_prints_is_a_finding(tmp_path, capfd):
    path = tmp_path / "grey.jpg"
    WRITERS["grey.jpg"](path)
    path.write_bytes(path.read_bytes()[:-30] + b"\xff\xd9")
    message = "Corrupt JPEG data: premature end of data segment"
    assert warning("decoder-message", message=message) in read_picture(path).findings
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("image", [GREY, COLOURS])
def test_scans_that_a_progressive_jpeg_lacks_are_named(tmp_path, image):
    """Where an end mark follows, libjpeg says nothing."""
    Image.fromarray(image).save(path := tmp_path / "a.jpg", progressive=True)
    assert warning("jpeg-scans-missing") not in read_picture(path).findings
    data = path.read_bytes()
    scans = [at for at in range(len(data)) if data.startswith(b"\xff\xda", at)]
    for at in scans[1:]:
        path.write_bytes(data[:at] + b"\xff\xd9")
        assert warning("jpeg-scans-missing") in read_picture(path).findings


# No pictures, and damage that a header shows


def with_tags(write, **values):
    """Write a TIFF with other values of 16 bits in its tags: `width` and `height`."""

    def run(path):
        write(path)
        data = bytearray(path.read_bytes())
        with tifffile.TiffFile(path) as file:
            for name, value in values.items():
                tag = file.pages.first.tags[{"width": 256, "height": 257}[name]]
                struct.pack_into("<H", data, tag.valueoffset, value)
        path.write_bytes(data)

    return run


def circle(path):
    """A TIFF whose last page names the first one as the next."""
    tiff(DN)(path)
    data = bytearray(path.read_bytes())
    (first,) = struct.unpack_from("<I", data, 4)
    struct.pack_into("<I", data, first + 2 + 12 * struct.unpack_from("<H", data, first)[0], first)
    path.write_bytes(data)


def animation(path):
    Image.fromarray(GREY).save(path, save_all=True, append_images=[Image.fromarray(255 - GREY)])


def preview(path):
    """A TIFF with a small copy, whose picture was lost."""
    with tifffile.TiffWriter(path) as file:
        file.write(GREY[::4, ::4], subfiletype=1, subifds=1)
        file.write(GREY)
    data = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as file:
        struct.pack_into("<I", data, file.pages.first.tags[330].valueoffset, len(data) + 100)
    path.write_bytes(data)


PICKLE = np.array([[print]], dtype=object)
DUMP = {"size": (60, 40), "pixel_format": "Mono8"}
REFUSED = [
    ("a.png", b"", {}, r"a\.png is empty"),
    ("a.jpg", b"GIF89a and so on", {}, r"a\.jpg is a GIF file, which labcdp does not read: convert it to PNG or"),
    ("a.jpg", b"neither this nor that", {}, r"a\.jpg is not an image"),
    ("a.heic", b"\0\0\0\x18ftypheic\0\0\0\0mif1heic", {}, r"a\.heic is a HEIC file, which labcdp does not read"),
    ("a.avif", b"\0\0\0\x1cftypmif1\0\0\0\0avifmif1miaf", {}, r"a\.avif is a HEIF file, which labcdp does not read"),
    ("a.webp", b"RIFF\x9a\0\0\0WEBPVP8X\n\0\0\0\x02", {}, r"a\.webp is a WebP file, which labcdp does not read"),
    ("a.png", b"\0\0\0\x0cJXL \r\n\x87\n", {}, r"a\.png is a JPEG XL file, which labcdp does not read"),
    ("a.mp4", b"\0\0\0\x20ftypisom\0\0\2\0isomiso2avc1", {}, r"a\.mp4 is a video \(MP4 or QuickTime\)"),
    *[("a.jpg", b"\xff\xd8\xff" + sof + b"\0\x0b" + bits + bytes(8) + b"\xff\xd9", {},
       rf"a\.jpg is {kind}, which labcdp does not read: convert it to 16-bit TIFF")
      for sof, bits, kind in ((b"\xc1", b"\x0c", "JPEG of 12 bits"), (b"\xc3", b"\x10", "lossless JPEG"),
                              (b"\xf7", b"\x08", "JPEG-LS"), (b"\xc9", b"\x08", "arithmetic-coded JPEG"))],
    ("a.png", animation, {}, r"a\.png is an animated PNG of 2 pictures, which labcdp does not read"),
    ("a.tif", tiff(np.zeros((8, 8), np.complex64)), {}, r"a\.tif holds complex numbers, which labcdp does not read"),
    ("a.npz", b"PK\x03\x04" + bytes(50), {}, r"a\.npz is not a luminance map"),
    ("a.png", os.mkfifo, {}, r"a\.png cannot be read \(it is a pipe"),
    ("a.npy", lambda path: np.save(path, np.full((2, 2), -1)), {}, r"has values from -1 to -1"),
    # A pickle is never opened.
    ("a.npy", lambda path: np.save(path, PICKLE, allow_pickle=True), {}, r"a\.npy: it holds 'object'"),
    ("a.tif", tiff(np.zeros((3, 8, 8), np.uint8)), {}, r"a\.tif holds 3 pictures"),
    ("a.jpg", lambda path: Image.fromarray(COLOURS).convert("CMYK").save(path), {}, r"a\.jpg has CMYK colours"),
    *[("a.tif", tiff(np.stack([DN] * 4), truncate=True, imagej=imagej), {},
       r"a\.tif holds 4 pictures in one block but lists only the first one") for imagej in (True, False)],
    ("a.tif", preview, {}, r"a\.tif contains only small copies"),
    # Twice as wide, or twice as high: a strip is too short, or one is missing.
    ("a.tif", with_tags(tiff(DN), width=120), {}, r"a\.tif is damaged: its part at byte \d+ holds fewer"),
    ("a.tif", with_tags(tiff(DN), height=80), {}, r"a\.tif has data for a part of its pixels only"),
    ("a.tif", circle, {}, r"a\.tif is damaged: its list of pages leads back to byte \d+"),
    ("a.raw", bytes(3600), DUMP, r"a\.raw has 3600 bytes, 60 x 40 pixels of Mono8 take 2400"),
    ("a.raw", b"\xff" * 4800, DUMP | {"pixel_format": "Mono12"}, r"a\.raw has values up to 65535, Mono12 ends at 4095"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "content", "options", "message"), REFUSED)
def test_what_is_not_one_image_is_refused(tmp_path, name, content, options, message):
    path = tmp_path / name
    content(path) if callable(content) else path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_picture(path, PictureOptions(**options))


# Bombs


def png_bomb(path):
    """A PNG of a single value whose few bytes announce any number of pixels."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 1, 0, 0, 0, 0))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(7501))) + chunk(b"IEND", b""))


def jpeg_bomb(path):
    cv2.imwrite(str(path), GREY)
    data = bytearray(path.read_bytes())
    struct.pack_into(">HH", data, data.index(b"\xff\xc0") + 5, 65000, 65000)
    path.write_bytes(data)


def exr_bomb(path):
    exr(path, Y=FLOATS)
    data = bytearray(path.read_bytes())
    for name in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        struct.pack_into("<4i", data, data.index(name) + len(name) + 4, 0, 0, 99_999, 99_999)
    path.write_bytes(data)


def npy_header(side):
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({side}, {side}), }}\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode()


def npz_bomb(path):
    """A whole archive in which one array is far larger than the others say."""
    luminance(path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("more.npy", npy_header(60000) + bytes(10_000_000))


BOMBS = {
    "a.png": png_bomb,
    "a.jpg": jpeg_bomb,
    "a.tif": with_tags(tiff(np.zeros((2048, 2048), np.uint8), tile=(1024, 1024), compression="zlib"),
                       width=60000, height=60000),
    "a.exr": exr_bomb,
    "a.npy": lambda path: path.write_bytes(npy_header(100_000)),
    "a.npz": npz_bomb,
}  # fmt: skip


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_before_memory_is_taken(tmp_path, name):
    path = tmp_path / name
    BOMBS[name](path)
    assert path.stat().st_size < 1e6
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"announces \d+ x \d+ pixels, more than the limit of 250|its values re"):
            read_picture(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 20e6


def test_an_exif_block_may_name_pixels_of_the_file_it_was_copied_from(tmp_path):
    block = Image.Exif()
    block[273], block[279], block[271] = 10_000_000, 5000, "Acme"
    Image.fromarray(COLOURS).save(tmp_path / "a.jpg", exif=block)
    assert read_picture(tmp_path / "a.jpg").statements.vendor == "Acme"


@pytest.mark.parametrize(
    "more", [b"", b"ftypmp42 a film \xff\xda without an end", b"\xff\xd8\xff\xda\0\x0c another picture"]
)
def test_what_follows_the_picture_of_a_jpeg_is_not_of_it(tmp_path, more):
    """The film of a motion photo, a second picture, or a maker's trailer."""
    Image.fromarray(COLOURS).save(tmp_path / "a.jpg", restart_marker_rows=1)
    alone = read_picture(tmp_path / "a.jpg")
    with open(tmp_path / "a.jpg", "ab") as file:
        file.write(more)
    picture = read_picture(tmp_path / "a.jpg")
    assert np.array_equal(picture.frame.dn, alone.frame.dn)
    assert picture.findings == alone.findings
