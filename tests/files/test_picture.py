"""Pictures of other programs: what they wrote is what is read."""

import struct
import zlib
from dataclasses import fields

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image, ImageOps

from labcdp.cli.pictures.options import PictureLightOptions
from labcdp.core.dn import PIXEL_FORMATS, pixel_format
from labcdp.core.errors import InputError
from labcdp.core.frame import CameraIdentity
from labcdp.core.result import info, warning
from labcdp.files import PictureOptions, read_image, read_picture
from labcdp.files.exr import weights_of_header
from labcdp.session.frames import frame_to_tiff

from .conftest import write_dng
from .png_bytes import png

SHAPES = st.tuples(st.integers(1, 9), st.integers(1, 9))
MANTA = CameraIdentity("Allied Vision", "Manta", "1")
GREY = np.random.default_rng(2).integers(0, 256, (12, 16), dtype=np.uint8)
DEEP = np.random.default_rng(3).integers(0, 65536, (12, 16), dtype=np.uint16)


# Values


def packed_tiff(dn, bits):
    """A TIFF of pixels that lie within bytes, made by hand (TIFF 6.0)."""
    rows = [np.packbits((row[:, None] >> np.arange(bits)[::-1]).astype(np.uint8) & 1) for row in dn]
    data, (height, width) = b"".join(row.tobytes() for row in rows), dn.shape
    tags = {256: width, 257: height, 258: bits, 259: 1, 262: 1, 273: 8, 277: 1, 278: height, 279: len(data)}
    entries = b"".join(struct.pack("<HHII", code, 4, 1, value) for code, value in tags.items())
    data += bytes(len(data) % 2)
    return struct.pack("<2sHI", b"II", 42, 8 + len(data)) + data + struct.pack("<H", len(tags)) + entries + bytes(4)


def tiff(path, dn, **how):
    tifffile.imwrite(path, dn, **({"photometric": "minisblack"} | how))


#: Suffix, type, bits and how it is written.
KINDS = {
    **{f"PNG {bits}": ("png", np.uint16, bits, lambda path, dn, bits=bits: path.write_bytes(png(dn, bits)))
       for bits in (1, 2, 4, 8, 16)},
    **{f"TIFF {bits} {how}": ("tif", f"u{bits // 8}", bits, lambda path, dn, how=how: tiff(path, dn, **how))
       for bits, how in ((8, {"compression": "zlib", "predictor": 2}), (16, {"byteorder": ">"}),
                         (16, {"bigtiff": True}), (8, {"tile": (16, 16)}), (16, {"photometric": "miniswhite"}))},
    **{f"packed TIFF {bits}": ("tif", np.uint16, bits,
                               lambda path, dn, bits=bits: path.write_bytes(packed_tiff(dn, bits)))
       for bits in (2, 4, 10, 12, 14)},
    **{f"NPY {dtype}": ("npy", dtype, bits, lambda path, dn: np.save(path, np.asfortranarray(dn)))
       for dtype, bits in (("?", 1), ("u1", 8), (">u2", 16), ("i8", 16))},
    **{f"dump {name}": ("raw", np.uint16 if one.bit_depth > 8 else np.uint8, one.bit_depth,
                        lambda path, dn, one=one: path.write_bytes(one.pack(dn).tobytes()))
       for name, one in PIXEL_FORMATS.items()},
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=8)
@given(data=st.data(), shape=SHAPES)
def test_each_dn_is_kept(tmp_path_factory, kind, data, shape):
    folder, (suffix, dtype, bits, write) = tmp_path_factory.getbasetemp(), KINDS[kind]
    dn = data.draw(arrays(np.int64, shape, elements=st.integers(0, 2**bits - 1))).astype(dtype)
    write(folder / f"a.{suffix}", dn)
    dump = {"pixel_format": kind.removeprefix("dump "), "size": shape[::-1]} if suffix == "raw" else {"bit_depth": bits}
    picture = read_picture(folder / f"a.{suffix}", PictureOptions(**dump))
    white = "miniswhite" in kind
    assert np.array_equal(picture.frame.dn, 2**bits - 1 - dn if white else dn)
    assert (picture.frame.bit_depth, picture.frame.saturation_dn) == (bits, 2**bits - 1)
    assert (picture.encoding, bool(picture.findings)) == ("linear", white or kind == "NPY i8")
    # Values of up to 8 bits may be made for screens, unless they are those of a sensor or an array.
    assert (picture.doubts.other_encoding == "srgb") == (bits <= 8 and suffix in ("png", "tif"))


def exr(path, header=None, **channels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | (header or {})
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


# What libtiff writes with predictors is left to a package of codecs.
LZW = [cv2.IMWRITE_TIFF_COMPRESSION, 5, cv2.IMWRITE_TIFF_PREDICTOR]
FLOATS = {
    "tif": tiff,
    "npy": np.save,
    "exr": lambda path, values: exr(path, Y=values.astype(np.float32)),
    "2.tif": lambda path, values: cv2.imwrite(str(path), values.astype(np.float32), [*LZW, 2]),
    "3.tif": lambda path, values: cv2.imwrite(str(path), values.astype(np.float32), [*LZW, 3]),
}


@pytest.mark.parametrize("suffix", FLOATS)
@settings(max_examples=8)
@given(data=st.data(), dtype=st.sampled_from([np.float16, np.float32, np.float64]), shape=SHAPES)
def test_floats_keep_each_value(tmp_path_factory, suffix, data, dtype, shape):
    folder = tmp_path_factory.getbasetemp()
    values = data.draw(arrays(dtype, shape, elements=st.floats(-60000, 60000, width=16)))
    FLOATS[suffix](folder / f"f.{suffix}", values)
    picture = read_picture(folder / f"f.{suffix}")
    assert (picture.frame, picture.light_is_cd_m2) == (None, False)
    assert np.array_equal(picture.light, values)


@pytest.mark.parametrize(
    ("suffix", "how", "name"),
    [
        ("tif", {"compression": "jpeg"}, "JPEG"), ("tif", {"compression": "webp", "photometric": "rgb"}, "WebP"),
        ("tif", {"compression": "jpeg2000"}, "JPEG 2000"), ("tif", {"compression": "lzw"}, None),
        ("exr", {"compression": OpenEXR.DWAA_COMPRESSION}, "DWAA"),
        ("exr", {"compression": OpenEXR.PIZ_COMPRESSION}, None),
    ],
)  # fmt: skip
def test_compression_that_may_change_values_is_named(tmp_path, suffix, how, name):
    values = np.random.default_rng(0).integers(0, 256, (64, 64, *([3] if "photometric" in how else [])), dtype=np.uint8)
    path = tmp_path / f"a.{suffix}"
    if suffix == "exr":
        exr(path, how, Y=values.astype(np.float32))
    else:
        tiff(path, values, **how)
    named = [one.values for one in read_picture(path).findings if one.code == "lossy-compression"]
    assert named == ([{"name": name}] if name else [])


# Colours, alpha and palettes


def test_a_picture_below_its_small_copy_is_read(tmp_path):
    """As in DNG, SubIFDs (TIFF Technical Note 1) hold the picture; in pyramids they hold small copies."""
    dn = np.random.default_rng(4).integers(0, 256, (40, 60), dtype=np.uint8)
    for first, second in ((dn[::4, ::4], dn), (dn, dn[::4, ::4])):
        with tifffile.TiffWriter(path := tmp_path / "a.tif") as file:
            for values in (first, second):
                file.write(values, subfiletype=int(values is not dn), subifds=int(values is first))
        np.testing.assert_array_equal(read_picture(path).frame.dn, dn)
    tiff(path, dn, subfiletype=1)
    np.testing.assert_array_equal(read_picture(path).frame.dn, dn)
    # A description copied with one picture of a stack.
    tiff(path, dn, description="ImageJ=1.54f\nimages=3\nslices=3\n", metadata=None)
    np.testing.assert_array_equal(read_picture(path).frame.dn, dn)


def test_colours_become_linear_luminance(tmp_path):
    # The full colours, half of full green's code value, and white; luminances by BT.709 and IEC 61966-2-1.
    rgb = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 128, 0], [255, 255, 255]]], dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), rgb[..., ::-1])
    tiff(tmp_path / "a.tif", rgb, photometric="rgb")
    expected = [0.2126, 0.7152, 0.0722, 0.7152 * ((128 / 255 + 0.055) / 1.055) ** 2.4, 1.0]
    for name in ("a.png", "a.tif"):
        picture = read_picture(tmp_path / name)
        np.testing.assert_allclose(picture.frame.dn[0] / 65535, expected, atol=1e-5)
        assert picture.findings == (info("srgb-colour-to-grey"),)
        assert (picture.coloured, picture.encoding, picture.frame.bit_depth) == (True, "srgb", 16)
        assert picture.frame.clipped.tolist() == [[True, True, True, False, True]]


def test_alpha_is_left_out_and_named(tmp_path):
    alpha = np.where(np.arange(12) < 3, 0, 255).astype(np.uint8)[:, None] * np.ones_like(GREY)
    Image.fromarray(np.dstack([GREY, alpha]), "LA").save(tmp_path / "la.png")
    how = {"extrasamples": ["unassalpha"], "planarconfig": "contig"}
    tiff(tmp_path / "la.tif", np.dstack([DEEP, np.full_like(DEEP, 65535)]), **how)
    # Colours that are all grey are a grey picture.
    cv2.imwrite(str(tmp_path / "rgba.png"), np.dstack([GREY, GREY, GREY, alpha]))
    transparent = warning("alpha-not-opaque", share=0.25)
    for name, dn, finding in (("la.png", GREY, transparent), ("la.tif", DEEP, info("alpha-ignored")),
                              ("rgba.png", GREY, transparent)):  # fmt: skip
        picture = read_picture(tmp_path / name)
        assert np.array_equal(picture.frame.dn, dn)
        assert finding in picture.findings


def test_exr_colours_follow_their_chromaticities(tmp_path):
    ones = np.ones((2, 3), np.float32)
    # Primaries and white of ITU-R BT.709 and BT.2020.
    bt2020 = {"chromaticities": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)}
    for header, weights in (({}, (0.2126, 0.7152, 0.0722)), (bt2020, (0.2627, 0.6780, 0.0593))):
        exr(tmp_path / "a.exr", header=header, R=2 * ones, G=3 * ones, B=5 * ones, A=ones)
        picture = read_picture(tmp_path / "a.exr")
        np.testing.assert_allclose(picture.light, np.dot(weights, (2, 3, 5)), rtol=1e-3)
        assert info("channels-ignored", channels=["A"]) in picture.findings
    # Primaries that are no colours. XYZ: the second channel is the luminance; ACES AP0 by SMPTE ST 2065-1, table 2.
    xyz = (1, 0, 0, 1, 0, 0, 1 / 3, 1 / 3)
    ap0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
    for xy, expected in ((xyz, (0, 1, 0)), (ap0, (0.3439664498, 0.7281660966, -0.0721325464))):
        weights, finding = weights_of_header({"chromaticities": xy})
        np.testing.assert_allclose(weights, expected, atol=1e-9)
        assert finding == info("colour-to-grey-by-file")


# What files say


GAMMA = {value: (b"gAMA", struct.pack(">I", value)) for value in (45_454, 55_556)}


@pytest.mark.parametrize(
    ("chunks", "encoding", "findings"),
    [
        ((), "linear", ()),
        (((b"sRGB", b"\0"),), "srgb", ()),
        ((GAMMA[45_454],), "gamma 2.2", (info("encoding-stated", encoding="gamma 2.2", by="its chunk gAMA"),)),
        ((GAMMA[55_556],), "gamma 1.8", (info("encoding-stated", encoding="gamma 1.8", by="its chunk gAMA"),)),
        (((b"iCCP", b"grey\0\0" + zlib.compress(bytes(400))),), "linear",
         (warning("icc-profile-not-used", reason="it is not an ICC profile"),)),
    ],
)  # fmt: skip
def test_a_png_says_how_its_values_follow_light(tmp_path, chunks, encoding, findings):
    (tmp_path / "a.png").write_bytes(png(GREY, 8, *chunks))
    picture, told = (read_picture(tmp_path / "a.png", PictureOptions().given(encoding=one)) for one in (None, "srgb"))
    assert (picture.encoding, picture.findings, told.doubts.other_encoding) == (encoding, findings, None)
    assert picture.doubts.other_encoding == ("srgb" if encoding == "linear" else None)


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
@pytest.mark.parametrize(("order", "orientation"), [("<", 1), (">", 6)])
def test_palettes_of_any_depth_are_resolved(tmp_path, bits, order, orientation):
    index = np.random.default_rng(bits).integers(0, 2**bits, (6, 16), dtype=np.uint8)
    grey = np.random.default_rng(9).permutation(256)[: 2**bits].astype(f"{order}u2")
    entries = np.unpackbits(index[..., None], axis=2)[..., 8 - bits :]
    data, palette = np.packbits(entries).tobytes(), np.tile(257 * grey, 3).tobytes()
    tags = {
        256: 16,
        257: 6,
        258: bits,
        259: 1,
        262: 3,
        273: 0,
        274: orientation,
        277: 1,
        278: 6,
        279: len(data),
        320: 0,
    }
    behind = 8 + 2 + 12 * len(tags) + 4
    tags |= {273: behind + len(palette), 320: behind}
    kinds = {320: (3, 3 * 2**bits)}
    counted = [struct.pack(f"{order}HHII", code, *kinds.get(code, (4, 1)), tags[code]) for code in sorted(tags)]
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}IH", 8, len(tags))
    (tmp_path / "a.tif").write_bytes(head + b"".join(counted) + bytes(4) + palette + data)
    picture = read_picture(tmp_path / "a.tif")
    expected = grey[index] if orientation == 1 else np.rot90(grey[index], -1)
    assert np.array_equal(picture.frame.dn, expected)
    assert "palette-resolved" in [one.code for one in picture.findings]


@pytest.mark.parametrize(
    ("top", "shift", "bits", "saturation_dn", "finding"),
    [
        (1023, 0, 10, 1023, info("bit-depth-guessed", bits=10, saturation_dn=1023)),
        (4095, 4, 16, 65520, info("bit-depth-guessed-upper", bits=12, stored_bits=16, saturation_dn=65520)),
        (3000, 0, 16, 65535, warning("bit-depth-unknown", largest_dn=3000, top_dn=65535)),
    ],
)
def test_a_guess_of_saturation_is_named(tmp_path, top, shift, bits, saturation_dn, finding):
    values = np.arange(top + 1, dtype=np.uint16)[:, None] << shift
    if shift:
        # One odd value, and the four lowest bits are used.
        np.save(tmp_path / "odd.npy", np.append(values, [[33]], axis=0))
        assert read_picture(tmp_path / "odd.npy").frame.saturation_dn == 65535
    np.save(tmp_path / "a.npy", values)
    picture = read_picture(tmp_path / "a.npy")
    assert (picture.frame.bit_depth, picture.frame.saturation_dn) == (bits, saturation_dn)
    assert picture.frame.saturated.sum() == (top != 3000)
    assert picture.findings == (finding,)


def test_what_files_lack_comes_from_the_options(tmp_path):
    block = Image.Exif()
    block[271], block[272] = "Acme", "Still 1"
    # With the CFAPattern of Exif, which pictures for screens have too.
    block.get_ifd(0x8769).update({0x829A: 0.004, 0x829D: 2.8, 0x8827: 400, 0x920A: 50.0, 0xA302: bytes(8)})
    Image.fromarray(GREY).save(tmp_path / "a.jpg", exif=block)
    cv2.imwrite(str(tmp_path / "a.png"), GREY)
    options = PictureOptions(exposure_s=0.02, gain_db=6.0, camera=MANTA, black_level_dn=4.0, saturation_dn=250.0)
    stated, given = (read_picture(tmp_path / name, options) for name in ("a.jpg", "a.png"))
    assert (stated.f_number, stated.focal_length_m, stated.exposure_stated) == (2.8, 0.05, True)
    assert (stated.frame.exposure_s, stated.frame.gain_db) == (0.004, pytest.approx(12.04, abs=0.01))
    assert (given.frame.exposure_s, given.frame.gain_db, given.exposure_stated) == (0.02, 6.0, False)
    assert (stated.frame.camera, given.frame.camera) == (CameraIdentity("Acme", "Still 1", "1"), MANTA)
    assert (given.frame.black_level_dn, given.frame.saturation_dn, stated.statements.has_cfa_pattern) == (
        4.0,
        250.0,
        False,
    )


@pytest.mark.parametrize(("orientation", "suffix"), [*zip(range(1, 9), ["jpg", "png", "tif"] * 3, strict=False)])
def test_pictures_are_turned_upright_as_pillow_does(tmp_path, orientation, suffix):
    block = Image.Exif()
    block[274] = orientation
    values = np.kron(np.random.default_rng(4).integers(0, 256, (2, 3), dtype=np.uint8), np.ones((8, 8), np.uint8))
    for name in (f"a.{suffix}", "truth.png"):
        Image.fromarray(values).save(tmp_path / name, exif=block)
    picture = read_picture(tmp_path / f"a.{suffix}")
    with Image.open(tmp_path / "truth.png") as image:
        np.testing.assert_array_equal(picture.frame.dn, np.asarray(ImageOps.exif_transpose(image)))
    assert (info("turned", orientation=orientation) in picture.findings) == (orientation > 1)


# What a person gave counts before what a file says; what cannot count is named


def codes(source):
    """Codes of the warnings about a picture or a video."""
    return [one.code for one in source.findings if one.severity == "warning"]


def given(options=None, **changes):
    """Options as the commands make them of what was typed."""
    nothing = dict.fromkeys(one.name for one in fields(PictureLightOptions))
    return (options or PictureOptions()).given(**PictureLightOptions(**nothing | changes).stated())


def test_a_typed_exposure_and_gain_count_before_those_of_the_file(tmp_path):
    """Files of all kinds say 8 ms and 6.02 dB."""
    block = Image.Exif()
    # Pillow leaves out a block of which only the directory of EXIF has values.
    block[271] = "Acme"
    block.get_ifd(0x8769).update({0x829A: 0.008, 0x8827: 200})
    for name in ("a.jpg", "a.png"):
        Image.fromarray(GREY).save(tmp_path / name, exif=block)
    tags = [(33434, "2I", 1, (1, 125), True), (34855, "H", 1, 200, True)]
    tifffile.imwrite(tmp_path / "a.tif", GREY, photometric="minisblack", extratags=tags)
    write_dng(tmp_path / "a.dng", np.tile(GREY.astype(np.uint16), (4, 4)), exposure=(1, 125), iso=200)
    (tmp_path / "a.tiff").write_bytes(frame_to_tiff(read_picture(tmp_path / "a.tif").frame, compress=False))
    for path in tmp_path.iterdir():
        # What a calibration knows does not overrule the file.
        known = read_picture(path, PictureOptions(exposure_s=0.005, gain_db=12.0))
        assert (known.frame.exposure_s, codes(known)) == (pytest.approx(0.008), [])
        picture = read_picture(path, given(exposure=0.005, gain_db=12.0))
        assert (picture.frame.exposure_s, picture.frame.gain_db) == (0.005, 12.0)
        assert codes(picture) == ["exposure-replaced", "gain-replaced"]


def test_other_images_are_refused_for_a_session(tmp_path):
    coloured = np.eye(4, dtype=np.uint8)[..., None] * np.uint8([1, 2, 3])
    for pixels in (coloured, np.zeros((4, 4), dtype=np.float32), np.full((4, 4), 4096, dtype=np.uint16)):
        tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="rgb" if pixels.ndim == 3 else "minisblack")
        with pytest.raises(InputError):
            read_image(tmp_path / "a.tif", pixel_format("BayerGB12"), PictureOptions(exposure_s=0.01))


@pytest.mark.parametrize("name", ["Pr\udcfcf", "a\n\x1bb", "10:15 %03d *", "-", "x" * 250])
def test_a_picture_may_have_any_name(tmp_path, name):
    dn = np.arange(1200, dtype=np.uint16).reshape(30, 40)
    kinds = {
        "png": lambda path: path.write_bytes(cv2.imencode(".png", dn)[1].tobytes()),
        "tif": lambda path: tifffile.imwrite(path, dn),
        "npy": lambda path: np.save(path, dn),
        "dng": lambda path: write_dng(path, dn),
        "exr": lambda path: path.write_bytes(exr_file(tmp_path / "plain.exr", dn.astype(np.float32))),
    }
    for suffix, write in kinds.items():
        path = tmp_path / f"{name}.{suffix}"
        write(path)
        picture = read_picture(path, PictureOptions(bit_depth=16))
        assert np.array_equal(picture.light if picture.frame is None else picture.frame.dn, dn)


def exr_file(path, values):
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Y": values}) as file:
        file.write(str(path))
    return path.read_bytes()
