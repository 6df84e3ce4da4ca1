"""Pictures of other programs: what they wrote is what is read."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image, ImageOps

from labcdp.core.errors import InputError
from labcdp.core.finding import info, warning
from labcdp.core.frame import CameraIdentity
from labcdp.core.pixel_format import PIXEL_FORMATS
from labcdp.files import PictureOptions, frame_of_pixels, read_picture
from labcdp.files.formats.exr import luminance_weights
from labcdp.files.picture.paths import picture_paths
from labcdp.session.frame_file import frame_to_tiff

SHAPES = st.tuples(st.integers(1, 9), st.integers(1, 9))
MANTA = CameraIdentity("Allied Vision", "Manta", "1")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pictures")


@pytest.fixture
def grey():
    return np.random.default_rng(2).integers(0, 256, (12, 16), dtype=np.uint8)


@pytest.fixture
def deep():
    return np.random.default_rng(3).integers(0, 65536, (12, 16), dtype=np.uint16)


def png(values, depth, colour_type, *chunks):
    """A PNG of rows of samples, made by hand (ISO/IEC 15948), with further chunks."""
    rows = np.atleast_2d(values).reshape(values.shape[0], -1)
    samples = values.shape[2] if values.ndim == 3 else 1
    if depth == 16:
        packed = [row.astype(">u2").tobytes() for row in rows]
    else:
        bits = (rows[..., None] >> np.arange(depth)[::-1]) & 1
        packed = [np.packbits(row.ravel()).tobytes() for row in bits.astype(np.uint8)]
    header = struct.pack(">IIBBBBB", rows.shape[1] // samples, len(rows), depth, colour_type, 0, 0, 0)
    parts = [
        (b"IHDR", header),
        *chunks,
        (b"IDAT", zlib.compress(b"".join(b"\0" + row for row in packed))),
        (b"IEND", b""),
    ]
    whole = [
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body)) for name, body in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(whole)


def written(path, data):
    path.write_bytes(data)
    return path


def exif(**values):
    """EXIF as Pillow writes it."""
    block = Image.Exif()
    block[271], block[272] = "Acme", "Still 1"
    sub = block.get_ifd(0x8769)
    sub.update({0x829A: values["exposure"], 0x829D: values["f_number"], 0x8827: values["iso"], 0x920A: 50.0})
    return block


# Values


@pytest.mark.parametrize("depth", [1, 2, 4, 8, 16])
@settings(max_examples=30)
@given(data=st.data(), shape=SHAPES)
def test_grey_png_keeps_each_dn(folder, depth, data, shape):
    dn = data.draw(arrays(np.uint16, shape, elements=st.integers(0, 2**depth - 1)))
    picture = read_picture(written(folder / "a.png", png(dn, depth, 0)), PictureOptions(bit_depth=depth))
    assert np.array_equal(picture.frame.dn, dn)
    assert (picture.frame.bit_depth, picture.frame.saturation_dn, picture.encoding) == (depth, 2**depth - 1, "linear")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(
    "how",
    [
        {"compression": "zlib", "predictor": 2},
        {"byteorder": ">"},
        {"bigtiff": True},
        {"tile": (16, 16)},
        {"photometric": "miniswhite"},
    ],
)
@settings(max_examples=30)
@given(data=st.data(), shape=SHAPES)
def test_grey_tiff_keeps_each_dn(folder, dtype, how, data, shape):
    dn = data.draw(arrays(dtype, shape))
    tifffile.imwrite(folder / "a.tif", dn, **{"photometric": "minisblack", **how})
    picture = read_picture(folder / "a.tif", PictureOptions(bit_depth=16))
    expected = np.iinfo(dtype).max - dn if "photometric" in how else dn
    assert np.array_equal(picture.frame.dn, expected)
    assert picture.frame.dn.dtype == dtype
    assert bool(picture.findings) == ("photometric" in how)


def packed_tiff(dn, bits, deflate=False):
    """A TIFF of pixels that lie within bytes, made by hand (TIFF 6.0)."""
    rows = [np.packbits((row[:, None] >> np.arange(bits)[::-1]).astype(np.uint8) & 1) for row in dn]
    data = b"".join(row.tobytes() for row in rows)
    data = zlib.compress(data) if deflate else data
    height, width = dn.shape
    tags = {
        256: width,
        257: height,
        258: bits,
        259: 8 if deflate else 1,
        262: 1,
        273: 8,
        277: 1,
        278: height,
        279: len(data),
    }
    entries = b"".join(struct.pack("<HHII", code, 4, 1, value) for code, value in tags.items())
    data += bytes(len(data) % 2)
    return struct.pack("<2sHI", b"II", 42, 8 + len(data)) + data + struct.pack("<H", len(tags)) + entries + bytes(4)


@pytest.mark.parametrize("bits", [2, 4, 10, 12, 14])
@settings(max_examples=30)
@given(data=st.data(), shape=SHAPES)
def test_packed_tiff_keeps_each_dn(folder, bits, data, shape):
    dn = data.draw(arrays(np.uint16, shape, elements=st.integers(0, 2**bits - 1)))
    frame = read_picture(written(folder / "packed.tif", packed_tiff(dn, bits))).frame
    assert np.array_equal(frame.dn, dn)
    assert (frame.bit_depth, frame.saturation_dn) == (bits, 2**bits - 1)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
@settings(max_examples=30)
@given(data=st.data(), shape=SHAPES)
def test_floats_keep_each_value(folder, dtype, data, shape):
    values = data.draw(arrays(dtype, shape, elements=st.floats(-60000, 60000, width=16)))
    tifffile.imwrite(folder / "f.tif", values, photometric="minisblack")
    np.save(folder / "f.npy", values)
    for name in ("f.tif", "f.npy"):
        picture = read_picture(folder / name)
        assert picture.frame is None
        assert not picture.light_is_cd_m2
        assert np.array_equal(picture.light, values)


@pytest.mark.parametrize("predictor", [2, 3])
def test_float_tiff_with_a_predictor_is_read_or_refused_in_one_line(tmp_path, predictor):
    values = np.random.default_rng(4).normal(10, 3, (16, 16)).astype(np.float32)
    # Written by libtiff, which tifffile leaves to a package of codecs.
    cv2.imwrite(
        str(tmp_path / "a.tif"), values, [cv2.IMWRITE_TIFF_COMPRESSION, 5, cv2.IMWRITE_TIFF_PREDICTOR, predictor]
    )
    assert np.array_equal(read_picture(tmp_path / "a.tif").light, values)


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8, np.uint16, np.int16, np.int64, ">u2"])
@settings(max_examples=30)
@given(data=st.data(), shape=SHAPES, fortran=st.booleans())
def test_npy_keeps_each_dn(folder, dtype, data, shape, fortran):
    top = {"b": 1, "u": 2 ** (8 * np.dtype(dtype).itemsize) - 1}.get(np.dtype(dtype).kind, 32767)
    dn = data.draw(arrays(np.int64, shape, elements=st.integers(0, top))).astype(dtype)
    np.save(folder / "a.npy", np.asfortranarray(dn) if fortran else dn)
    assert np.array_equal(read_picture(folder / "a.npy", PictureOptions(bit_depth=16)).frame.dn, dn)


@settings(max_examples=30)
@given(name=st.sampled_from(sorted(PIXEL_FORMATS)), data=st.data(), shape=SHAPES)
def test_raw_dumps_keep_each_dn(folder, name, data, shape):
    layout = PIXEL_FORMATS[name]
    kind = np.uint8 if layout.bit_depth == 8 else np.uint16
    dn = data.draw(arrays(kind, shape, elements=st.integers(0, 2**layout.bit_depth - 1)))
    path = written(folder / "a.raw", layout.pack(dn).tobytes())
    frame = read_picture(path, PictureOptions(pixel_format=name, size=shape[::-1])).frame
    assert np.array_equal(frame.dn, dn)
    assert (frame.bit_depth, frame.pixel_format, frame.colour_filter) == (layout.bit_depth, name, layout.colour_filter)


@settings(max_examples=30)
@given(arrays(np.float32, SHAPES, elements=st.floats(0, 1e5, width=32)))
def test_luminance_channel_of_exr_keeps_each_value(folder, values):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Y": values}) as file:
        file.write(str(folder / "a.exr"))
    assert np.array_equal(read_picture(folder / "a.exr").light, values)


# Colours, alpha and palettes


def test_colours_become_linear_luminance(tmp_path):
    # The full colours, half of full green's code value, and white; luminances by BT.709 and IEC 61966-2-1.
    rgb = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 128, 0], [255, 255, 255]]], dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), rgb[..., ::-1])
    tifffile.imwrite(tmp_path / "a.tif", rgb, photometric="rgb")
    expected = [0.2126, 0.7152, 0.0722, 0.7152 * ((128 / 255 + 0.055) / 1.055) ** 2.4, 1.0]
    for name in ("a.png", "a.tif"):
        picture = read_picture(tmp_path / name)
        np.testing.assert_allclose(picture.frame.dn[0] / 65535, expected, atol=1e-5)
        assert picture.findings == (info("srgb-colour-to-grey"),)
        assert (picture.coloured, picture.encoding, picture.frame.bit_depth) == (True, "srgb", 16)
        assert picture.frame.clipped.tolist() == [[True, True, True, False, True]]


def test_colours_agree_with_colour_science(tmp_path):
    from labcdp.core.photometry import source_names

    source_names()  # imports colour without its warnings
    import colour

    rgb = np.random.default_rng(5).integers(0, 256, (6, 7, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), rgb[..., ::-1])
    linear = colour.models.eotf_sRGB(rgb / 255)
    expected = linear @ colour.RGB_COLOURSPACES["ITU-R BT.709"].matrix_RGB_to_XYZ[1]
    np.testing.assert_allclose(read_picture(tmp_path / "a.png").frame.dn / 65535, expected, atol=2e-4)


def test_a_png_says_how_its_values_follow_light(tmp_path, grey):
    def encoding(*chunks):
        return read_picture(written(tmp_path / "a.png", png(grey, 8, 0, *chunks))).encoding

    assert encoding() == "linear"
    assert encoding((b"sRGB", b"\0")) == "srgb"
    assert encoding((b"gAMA", struct.pack(">I", 45455))) == "srgb"
    assert encoding((b"gAMA", struct.pack(">I", 100000))) == "linear"


def test_alpha_is_left_out_and_named(tmp_path, grey, deep):
    alpha = np.full_like(grey, 255)
    alpha[:3] = 0
    Image.fromarray(np.dstack([grey, alpha]), "LA").save(tmp_path / "la.png")
    picture = read_picture(tmp_path / "la.png")
    assert np.array_equal(picture.frame.dn, grey)
    assert picture.findings == (warning("alpha-not-opaque", share=0.25),)
    opaque = np.full_like(deep, 65535)
    how = {"photometric": "minisblack", "extrasamples": ["unassalpha"], "planarconfig": "contig"}
    tifffile.imwrite(tmp_path / "la.tif", np.dstack([deep, opaque]), **how)
    picture = read_picture(tmp_path / "la.tif")
    assert np.array_equal(picture.frame.dn, deep)
    assert picture.findings == (info("alpha-ignored"),)
    cv2.imwrite(str(tmp_path / "rgba.png"), np.dstack([grey, grey, grey, alpha]))
    # Colours that are all grey are a grey picture.
    assert np.array_equal(read_picture(tmp_path / "rgba.png").frame.dn, grey)


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_palettes_are_resolved(tmp_path, name):
    colours = np.array([[[255, 0, 0], [0, 255, 0]], [[9, 9, 9], [255, 255, 255]]], dtype=np.uint8)
    image = Image.fromarray(colours).quantize(4)
    image.save(tmp_path / name)
    Image.fromarray(colours).save(tmp_path / "full.png")
    picture, full = read_picture(tmp_path / name), read_picture(tmp_path / "full.png")
    assert info("palette-resolved") in picture.findings
    assert np.array_equal(picture.frame.dn, full.frame.dn)


def test_exr_colours_follow_their_chromaticities(tmp_path):
    values = np.ones((2, 3), np.float32)
    channels = {"R": 2 * values, "G": 3 * values, "B": 5 * values, "A": values}
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(tmp_path / "a.exr"))
    picture = read_picture(tmp_path / "a.exr")
    np.testing.assert_allclose(picture.light, 2 * 0.2126 + 3 * 0.7152 + 5 * 0.0722, rtol=1e-5)
    assert picture.findings == (info("channels-ignored", channels=["A"]), info("colour-to-grey"))
    # Primaries and white of ITU-R BT.2020, whose luminance has the weights 0.2627, 0.6780 and 0.0593.
    header["chromaticities"] = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
    with OpenEXR.File(header, channels) as file:
        file.write(str(tmp_path / "a.exr"))
    np.testing.assert_allclose(read_picture(tmp_path / "a.exr").light, 2 * 0.2627 + 3 * 0.678 + 5 * 0.0593, rtol=1e-3)


# Depth


@pytest.mark.parametrize(
    ("top", "shift", "bits", "saturation_dn", "finding"),
    [
        (4095, 0, 12, 4095, info("bit-depth-guessed", bits=12, saturation_dn=4095)),
        (1023, 0, 10, 1023, info("bit-depth-guessed", bits=10, saturation_dn=1023)),
        (4095, 4, 16, 65520, info("bit-depth-guessed-upper", bits=12, stored_bits=16, saturation_dn=65520)),
        (3000, 0, 16, 65535, warning("bit-depth-unknown", largest_dn=3000, top_dn=65535)),
    ],
)
def test_a_guess_of_saturation_is_named(tmp_path, top, shift, bits, saturation_dn, finding):
    dn = np.arange(top + 1, dtype=np.uint16)[:, None] << shift
    np.save(tmp_path / "a.npy", dn)
    picture = read_picture(tmp_path / "a.npy")
    assert (picture.frame.bit_depth, picture.frame.saturation_dn) == (bits, saturation_dn)
    assert picture.frame.saturated.sum() == (top != 3000)
    assert picture.findings == (finding,)


# What files say


def test_exif_of_a_jpeg_wins(tmp_path, grey):
    Image.fromarray(grey).save(tmp_path / "a.jpg", exif=exif(exposure=0.004, f_number=2.8, iso=400))
    picture = read_picture(tmp_path / "a.jpg", PictureOptions(exposure_s=1.0, gain_db=0.0, camera=MANTA))
    frame = picture.frame
    assert (frame.exposure_s, picture.f_number, picture.focal_length_m) == (0.004, 2.8, 0.05)
    assert frame.gain_db == pytest.approx(12.04, abs=0.01)
    assert (frame.camera.vendor, frame.camera.model, frame.camera.serial) == ("Acme", "Still 1", "1")
    assert picture.exposure_stated
    assert picture.camera_stated
    assert picture.encoding == "srgb"


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
def test_pictures_are_turned_upright_as_pillow_does(tmp_path, orientation, suffix):
    path, block = tmp_path / f"a.{suffix}", Image.Exif()
    block[274] = orientation
    values = np.kron(np.random.default_rng(4).integers(0, 256, (2, 3), dtype=np.uint8), np.ones((8, 8), np.uint8))
    Image.fromarray(values).save(path, exif=block)
    Image.fromarray(values).save(tmp_path / "truth.png", exif=block)
    picture = read_picture(path)
    with Image.open(tmp_path / "truth.png") as image:
        np.testing.assert_array_equal(picture.frame.dn, np.asarray(ImageOps.exif_transpose(image)))
    assert (info("turned", orientation=orientation) in picture.findings) == (orientation > 1)


def test_chromaticities_of_exr_with_primaries_that_are_no_colours():
    """XYZ: the second channel is the luminance; ACES AP0 by SMPTE ST 2065-1, table 2."""
    xyz = (1, 0, 0, 1, 0, 0, 1 / 3, 1 / 3)
    ap0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
    for xy, expected in ((xyz, (0, 1, 0)), (ap0, (0.3439664498, 0.7281660966, -0.0721325464))):
        weights, finding = luminance_weights({"chromaticities": xy})
        np.testing.assert_allclose(weights, expected, atol=1e-9)
        assert finding == info("colour-to-grey-by-file")


def test_what_files_lack_comes_from_the_options(tmp_path, grey):
    cv2.imwrite(str(tmp_path / "a.png"), grey)
    options = PictureOptions(exposure_s=0.02, gain_db=6.0, camera=MANTA, black_level_dn=4.0, saturation_dn=250.0)
    picture = read_picture(tmp_path / "a.png", options)
    frame = picture.frame
    assert (frame.exposure_s, frame.gain_db, frame.camera, frame.black_level_dn, frame.saturation_dn) == (
        0.02, 6.0, MANTA, 4.0, 250.0,
    )  # fmt: skip
    assert (picture.exposure_stated, picture.camera_stated, picture.exposure_known) == (False, False, True)
    assert not read_picture(tmp_path / "a.png").exposure_known


def test_frames_that_labcdp_recorded_keep_all(tmp_path, deep):
    from datetime import UTC, datetime

    options = PictureOptions(exposure_s=0.02, gain_db=6.0, camera=MANTA, pixel_format="Mono16")
    frame = frame_of_pixels(deep, options, datetime(2026, 1, 2, tzinfo=UTC), 7)
    (tmp_path / "0001.tif").write_bytes(frame_to_tiff(frame, compress=True))
    picture = read_picture(tmp_path / "0001.tif", PictureOptions(exposure_s=9.0))
    assert picture.frame.metadata() == frame.metadata()
    assert np.array_equal(picture.frame.dn, deep)
    assert picture.exposure_stated
    assert picture.camera_stated


def test_camera_raw(tmp_path, new_dng, dn):
    new_dng(tmp_path / "a.dng", dn)
    new_dng(tmp_path / "renamed.tif", dn)
    for name in ("a.dng", "renamed.tif"):
        picture = read_picture(tmp_path / name)
        assert np.array_equal(picture.frame.dn, dn)
        assert (picture.frame.colour_filter, picture.frame.black_level_dn) == ("RG", 64)
        assert (picture.frame.exposure_s, picture.f_number, picture.exposure_stated) == (0.008, 2.8, True)
    new_dng(tmp_path / "b.dng", dn, exposure=None)
    picture = read_picture(tmp_path / "b.dng")
    assert (picture.exposure_stated, picture.exposure_known) == (False, False)


# Lists of files


def test_folders_are_read_in_natural_order(tmp_path, grey):
    folder = tmp_path / "many"
    folder.mkdir()
    for name in ("img10.png", "img2.png", "IMG1.PNG", "notes.txt", ".hidden.png"):
        (folder / name).write_bytes(b"")
    (folder / "sub.png").mkdir()
    single = tmp_path / "z.txt"
    found = picture_paths([single, folder, folder / "img2.png"])
    assert [path.name for path in found] == ["z.txt", "IMG1.PNG", "img2.png", "img10.png"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"empty holds no image: give a folder with some, or files"):
        picture_paths([tmp_path / "empty"])
