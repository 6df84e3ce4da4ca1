"""What files state of the curve, the colours and the scale of their values is used, in every format, or named."""

import struct
import zlib
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms

from labcdp.core.dn import pixel_format
from labcdp.core.errors import InputError
from labcdp.core.result import info, warning
from labcdp.evaluate.picture.converter import make_converter
from labcdp.files import PictureOptions, read_image, read_picture
from labcdp.files.icc import read_profile
from labcdp.files.transfer import PRIMARIES_OF_CODE, decoded, encoding_name, known_encoding, luminance_weights
from labcdp.files.video.open import open_video

from .png_bytes import chunk, png
from .video_files import write

#: Two patches side by side, bright and dark.
HEIGHT, WIDTH = 40, 60


def patches(bright, dark, dtype=np.uint16):
    values = np.full((HEIGHT, WIDTH), dark, dtype)
    values[:, WIDTH // 2 :] = bright
    return values


def contrast(picture, **given):
    """Weber contrast of the two patches as relative luminance has it."""
    light = make_converter().luminance(picture).luminance_cd_m2
    return light[:, 40:].mean() / light[:, :20].mean() - 1


def codes(source):
    return [one.code for one in source.findings]


# Curves: published values


@pytest.mark.parametrize(
    ("encoding", "value", "light"),
    [
        ("srgb", 0.5, 0.21404114048223255),  # IEC 61966-2-1
        ("bt709", 0.5, 0.25958940050628754),
        ("pq", 0.5080784, 100 / 10_000),  # SMPTE ST 2084: 100 cd/m2 is at 0.508
        ("pq", 0.7518271, 1000 / 10_000),
        ("hlg", 0.5, 1 / 12),  # ITU-R BT.2100-2, table 5: both branches
        ("hlg", 0.75, 0.26496256),  # ITU-R BT.2408: reference white at 75 %
        ("gamma 2.2", 0.5, 0.5**2.2),
        ("log100", 0.5, 0.1),
        ("log316", 0.6, 0.1),
    ],
)
def test_curves_have_published_values(encoding, value, light):
    assert decoded(value, encoding) == pytest.approx(light, rel=2e-5)
    assert decoded(1.0, encoding) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("encoding", ["linear", "srgb", "bt709", "gamma 1.8", "gamma 2.2", "gamma 2.6"])
def test_a_table_of_a_known_curve_is_known(encoding):
    rounded = np.rint(65535 * decoded(np.linspace(0, 1, 1024), encoding)) / 65535
    assert known_encoding(rounded) == encoding


def test_weights_of_primaries_are_those_of_the_standards():
    for code, weights in ((1, (0.2126, 0.7152, 0.0722)), (9, (0.2627, 0.6780, 0.0593)), (12, (0.2290, 0.6917, 0.0793))):
        np.testing.assert_allclose(luminance_weights(PRIMARIES_OF_CODE[code]), weights, atol=1e-4)


# ICC profiles


def curve_tag(gamma):
    return b"curv" + bytes(4) + struct.pack(">IH", 1, round(256 * gamma)) + bytes(2)


#: Colorants of sRGB, adapted to D50 (its profile by the ICC).
COLORANTS = (0.4360657, 0.2224884, 0.0139160), (0.3851471, 0.7168732, 0.0970764), (0.1430664, 0.0606079, 0.7140961)


def profile(curve, coloured=True):
    """A matrix or grey profile made by hand (ICC.1:2022)."""
    tags = dict.fromkeys((b"rTRC", b"gTRC", b"bTRC") if coloured else (b"kTRC",), curve)
    if coloured:
        for name, xyz in zip((b"rXYZ", b"gXYZ", b"bXYZ"), COLORANTS, strict=True):
            tags[name] = b"XYZ " + bytes(4) + struct.pack(">3i", *(round(65536 * one) for one in xyz))
    head, body, at = struct.pack(">I", len(tags)), b"", 132 + 12 * len(tags)
    for name, tag in tags.items():
        head += struct.pack(">4sII", name, at + len(body), len(tag))
        body += tag + bytes(-len(tag) % 4)
    size = 128 + len(head) + len(body)
    start = struct.pack(">I4sI4s4s4s", size, b"none", 0x02400000, b"mntr", b"RGB " if coloured else b"GRAY", b"XYZ ")
    return start + bytes(12) + b"acsp" + bytes(128 - len(start) - 16) + head + body


def parametric(kind, *parameters):
    numbers = struct.pack(f">{len(parameters)}i", *(round(65536 * one) for one in parameters))
    return b"para" + bytes(4) + struct.pack(">HH", kind, 0) + numbers


TABLE = b"curv" + bytes(4) + struct.pack(">I3H", 3, 0, 32768, 65535)
CURVES = {
    "identity": (b"curv" + bytes(8), "linear"),
    "gamma 1": (curve_tag(1.0), "linear"),
    "gamma 2.2": (curve_tag(2.19921875), "gamma 2.199"),
    "power": (parametric(0, 1.8), "gamma 1.8"),
    "sRGB": (parametric(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045), "srgb"),
    "table": (TABLE, "linear"),
    "table of few values": (b"curv" + bytes(4) + struct.pack(">I3H", 3, 0, 16384, 65535), None),
}


@pytest.mark.parametrize("curve", CURVES)
def test_curves_of_profiles_are_read(curve):
    tag, encoding = CURVES[curve]
    for coloured in (True, False):
        assert read_profile(profile(tag, coloured), coloured).encoding == encoding


def test_the_profile_of_another_program_is_srgb():
    made = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    found = read_profile(made, True)
    assert (found.encoding, found.weights) == ("srgb", (0.2126, 0.7152, 0.0722))


def with_profile(path, values, data):
    """A grey or coloured file of a kind with an ICC profile."""
    if path.suffix == ".tif":
        photometric = "rgb" if values.ndim == 3 else "minisblack"
        tifffile.imwrite(path, values, photometric=photometric, iccprofile=data)
    elif path.suffix == ".jpg":
        Image.fromarray(values).save(path, quality=100, subsampling=0, icc_profile=data)
    else:
        cv2.imwrite(str(path), values[..., ::-1] if values.ndim == 3 else values)
        content, at = path.read_bytes(), 33
        path.write_bytes(content[:at] + chunk(b"iCCP", b"p\0\0" + zlib.compress(data)) + content[at:])


@pytest.mark.parametrize(
    ("suffix", "dtype", "coloured"),
    [(".png", np.uint8, False), (".png", np.uint16, True), (".tif", np.uint16, True), (".tif", np.uint8, False),
     (".jpg", np.uint8, True), (".jpg", np.uint8, False)],
)  # fmt: skip
@pytest.mark.parametrize("gamma", [1.0, 2.0])
def test_a_profile_counts_in_every_format(tmp_path, suffix, dtype, coloured, gamma):
    full = np.iinfo(dtype).max
    values = patches(full // 5 * 4, full // 5, dtype)
    if coloured:
        # A little colour, so that it stays a picture of three values a pixel.
        values = np.dstack([values] * 3)
        values[0, 30, 0] = full
    with_profile(path := tmp_path / f"a{suffix}", values, profile(curve_tag(gamma), coloured))
    picture = read_picture(path)
    assert contrast(picture) == pytest.approx(4**gamma - 1, rel=1e-3)
    assert "encoding-stated" in codes(picture)
    given = read_picture(path, PictureOptions().given(encoding="srgb"))
    bright, dark = decoded([0.8, 0.2], "srgb")
    assert contrast(given) == pytest.approx(bright / dark - 1, rel=1e-3)
    assert "encoding-replaced" in codes(given)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_curve_of_its_own_is_used_as_a_table(tmp_path, suffix, channels):
    tag = b"curv" + bytes(4) + struct.pack(">I5H", 5, 0, 3000, 9000, 40000, 65535)
    values = patches(192, 64, np.uint8)
    values = np.dstack([values] * 3) if channels == 3 else values
    with_profile(path := tmp_path / f"a{suffix}", values, profile(tag, channels == 3))
    picture = read_picture(path)
    light = np.interp([192 / 255, 64 / 255], np.linspace(0, 1, 5), [0, 3000, 9000, 40000, 65535])
    assert contrast(picture) == pytest.approx(light[0] / light[1] - 1, rel=1e-3)
    assert picture.frame.saturation_dn == 65535


@pytest.mark.parametrize(
    ("data", "coloured"),
    [
        (bytes(400), True),
        (profile(curve_tag(1), False).replace(b"kTRC", b"A2B0"), False),
        (profile(curve_tag(0), False), False),
        (profile(curve_tag(1), True)[:150], True),
    ],
)
def test_a_profile_that_cannot_be_used_is_named(tmp_path, data, coloured):
    values = patches(40000, 10000)
    values = np.dstack([values, values, values // 2]) if coloured else values
    with_profile(path := tmp_path / "a.tif", values, data)
    assert "icc-profile-not-used" in codes(read_picture(path))


@pytest.mark.parametrize("coloured", [True, False])
@pytest.mark.parametrize("suffix", [".tif", ".jpg"])
def test_the_curve_of_a_profile_for_other_colours_counts(tmp_path, suffix, coloured):
    values = patches(200, 50, np.uint8)
    if coloured:
        values = np.dstack([values] * 3)
        values[0, 30, 0] = 255
    with_profile(path := tmp_path / f"a{suffix}", values, profile(curve_tag(2.0), not coloured))
    picture = read_picture(path)
    assert contrast(picture) == pytest.approx(15, rel=5e-3)
    by = f"its ICC profile ({'GRAY' if coloured else 'RGB'})"
    assert info("encoding-stated", encoding="gamma 2", by=by) in picture.findings


def test_grey_in_three_channels_has_the_luminance_of_their_curves(tmp_path):
    """Each with its own curve, of which none is that of grey."""
    data = profile(b"curv" + bytes(4) + struct.pack(">I3H", 3, 0, 8192, 65535), True)
    first = data.index(b"rTRC") + 4
    other = curve_tag(1.0)
    data = data[:first] + struct.pack(">II", len(data), len(other)) + data[first + 8 :] + other
    with_profile(path := tmp_path / "a.tif", np.dstack([patches(49151, 16384)] * 3), data)
    bright, dark = (0.2126 * value + 0.7874 * light for value, light in ((0.75, 0.5625), (0.25, 0.0625)))
    assert contrast(read_picture(path)) == pytest.approx(bright / dark - 1, rel=1e-3)
    with_profile(path, patches(49151, 16384), data)
    assert "icc-profile-not-used" in codes(read_picture(path))


def test_curves_count_beside_a_table_of_colours(tmp_path):
    data = profile(curve_tag(2.0), True).replace(b"bXYZ", b"A2B0")
    values = np.dstack([patches(40000, 10000)] * 3)
    values[0, 30, 0] = 65535
    with_profile(path := tmp_path / "a.tif", values, data)
    picture = read_picture(path)
    assert contrast(picture) == pytest.approx(15, rel=1e-3)
    assert warning("icc-table-not-used") in picture.findings


def test_dark_values_of_a_curve_that_is_nearly_a_power(tmp_path):
    """ROMM RGB (ISO 22028-2): a power of 1.8 above a straight line up to 1/32."""
    with_profile(
        path := tmp_path / "a.tif", patches(1310, 655), profile(parametric(3, 1.8, 1, 0, 1 / 16, 1 / 32), False)
    )
    assert contrast(read_picture(path)) == pytest.approx(1, rel=0.01)


def test_a_grey_curve_of_lightness(tmp_path):
    """The connection space of a grey profile may be CIELAB: the curve gives L* (ICC.1:2022, annex F.2)."""
    data = bytearray(profile(curve_tag(1.0), False))
    data[20:24] = b"Lab "
    with_profile(path := tmp_path / "a.tif", patches(52428, 26214), bytes(data))
    bright, dark = (((100 * value + 16) / 116) ** 3 for value in (0.8, 0.4))
    assert contrast(read_picture(path)) == pytest.approx(bright / dark - 1, rel=2e-3)


def test_a_profile_with_missing_parts_is_named(tmp_path):
    """ICC.1:2022, B.4: parts of at most 65 519 bytes, each with its number and that of all."""
    Image.fromarray(patches(192, 64, np.uint8)).save(path := tmp_path / "a.jpg", icc_profile=bytes(150_000))
    data = path.read_bytes()
    second = data.index(b"ICC_PROFILE\0\2\3") - 4
    path.write_bytes(data[:second] + data[second + 2 + int.from_bytes(data[second + 2 : second + 4], "big") :])
    assert warning("icc-profile-not-used", reason="parts of it are missing") in read_picture(path).findings


# PNG


@pytest.mark.parametrize(
    ("chunks", "encoding"),
    [
        ([(b"cICP", bytes((1, 8, 0, 1)))], "linear"),
        ([(b"cICP", bytes((1, 13, 0, 1)))], "srgb"),
        ([(b"cICP", bytes((9, 16, 0, 1)))], "pq"),
        ([(b"cICP", bytes((9, 18, 0, 1)))], "hlg"),
        # PNG, third edition, 4.3: cICP before iCCP, sRGB and gAMA; sRGB before gAMA.
        ([(b"sRGB", b"\0"), (b"gAMA", struct.pack(">I", 100_000)), (b"cICP", bytes((1, 8, 0, 1)))], "linear"),
        ([(b"gAMA", struct.pack(">I", 100_000)), (b"sRGB", b"\0")], "srgb"),
        ([(b"gAMA", struct.pack(">I", 100_000))], "linear"),
        ([(b"gAMA", struct.pack(">I", 45_455))], "gamma 2.2"),
        ([(b"gAMA", struct.pack(">I", 50_000))], "gamma 2"),
    ],
)
def test_png_states_its_curve(tmp_path, chunks, encoding):
    (tmp_path / "a.png").write_bytes(png(patches(40000, 10000), 16, *chunks))
    picture = read_picture(tmp_path / "a.png")
    bright, dark = decoded(np.array([40000, 10000]) / 65535, encoding)
    assert picture.encoding == encoding
    assert contrast(picture) == pytest.approx(bright / dark - 1, rel=1e-4)


@pytest.mark.parametrize(
    ("name", "body", "in_front", "code"),
    [("gAMA", bytes(4), True, "gamma-not-used"), ("gAMA", bytes((0, 0, 0, 1)), True, "gamma-not-used"),
     ("cICP", bytes((1, 8, 0)), True, "chunk-not-used"), ("cICP", bytes((1, 8, 1, 1)), True, "chunk-not-used"),
     ("cICP", bytes((1, 13, 0, 1)), False, "chunk-not-used"),
     ("gAMA", bytes((0, 0, 177, 143)), False, "chunk-not-used"),
     ("iCCP", b"p\0\0no profile", True, "icc-profile-not-used")],
)  # fmt: skip
def test_chunks_that_cannot_count_are_named(tmp_path, name, body, in_front, code):
    """Of those behind the pixels, decoders may know nothing (PNG third edition, 5.6)."""
    content = png(patches(40000, 10000), 16)
    at = 33 if in_front else len(content) - 12
    (tmp_path / "a.png").write_bytes(content[:at] + chunk(name.encode(), body) + content[at:])
    picture = read_picture(tmp_path / "a.png")
    assert contrast(picture) == pytest.approx(3, rel=1e-4)
    assert code in codes(picture)


@pytest.mark.parametrize("lower", [0, 1])
def test_significant_bits_of_a_png_are_its_upper_ones(tmp_path, lower):
    """Saturated where all of them are set, whatever is in the lower ones (PNG third edition, 11.3.2.7)."""
    values = patches(4095 << 4, 1000 << 4) + lower * np.uint16(3)
    (tmp_path / "a.png").write_bytes(png(values, 16, (b"sBIT", bytes([12]))))
    picture = read_picture(tmp_path / "a.png")
    assert picture.frame.saturated[:, 40:].all()
    assert not picture.frame.saturated[:, :20].any()


@pytest.mark.parametrize("transfer", [2, 8])
def test_colours_of_a_png_have_the_weights_of_their_primaries(tmp_path, transfer):
    values = np.zeros((4, 4, 3), np.uint8)
    values[..., 1], values[0, 0] = 255, 255
    cv2.imwrite(str(tmp_path / "a.png"), values)
    content = (tmp_path / "a.png").read_bytes()
    (tmp_path / "a.png").write_bytes(content[:33] + chunk(b"cICP", bytes((9, transfer, 0, 1))) + content[33:])
    picture = read_picture(tmp_path / "a.png")
    assert picture.frame.dn[1, 1] / 65535 == pytest.approx(0.6780, abs=1e-4)
    assert "colour-to-grey-by-file" in codes(picture)


def test_limited_range_and_unknown_codes_of_a_png(tmp_path):
    (tmp_path / "a.png").write_bytes(png(patches(235, 60, np.uint8), 8, (b"cICP", bytes((1, 8, 0, 0)))))
    assert contrast(read_picture(tmp_path / "a.png")) == pytest.approx(219 / 44 - 1, rel=0.01)
    (tmp_path / "b.png").write_bytes(png(patches(40, 10, np.uint8), 8, (b"cICP", bytes((77, 99, 0, 1)))))
    assert {"transfer-code-unknown", "primaries-code-unknown"} <= set(codes(read_picture(tmp_path / "b.png")))


@pytest.mark.parametrize(("dark", "is_coarse"), [(0.3, True), (50, False)])
def test_dark_colours_are_named_where_their_light_is_rounded(tmp_path, dark, is_coarse):
    """PQ of two luminances in cd/m2, which are kept in steps of 10 000 / 65535."""
    codes_of_light = np.arange(65536) / 65535
    light = 10_000 * decoded(codes_of_light, "pq")
    bright, dim = (int(np.argmin(np.abs(light - one))) for one in (100, dark))
    values = np.dstack([patches(bright, dim)] * 3)
    values[0, 30, 0] = 0
    cv2.imwrite(str(tmp_path / "a.png"), values)
    content = (tmp_path / "a.png").read_bytes()
    (tmp_path / "a.png").write_bytes(content[:33] + chunk(b"cICP", bytes((9, 16, 0, 1))) + content[33:])
    picture = read_picture(tmp_path / "a.png")
    assert ("light-in-steps" in codes(picture)) == is_coarse
    assert (contrast(picture) == pytest.approx(100 / dark - 1, rel=0.01)) == (not is_coarse)


# TIFF


def described(path, values, text, **tags):
    tifffile.imwrite(path, values, photometric="minisblack", description=text, metadata=None, **tags)


@pytest.mark.parametrize(
    ("function", "parameters", "unit", "value"),
    [
        (0, (-100, 0.5), "gray value", lambda x: 0.5 * x - 100),
        (0, (20, 0.5), "", lambda x: 0.5 * x + 20),
        (0, (1000, -1), "", lambda x: 1000 - x),
        (0, (0, 0.5), "cd/m^2", lambda x: 0.5 * x),
        (1, (3, 0.5, 0.001), "", lambda x: 3 + 0.5 * x + 0.001 * x**2),
        (4, (2, 0.004), "", lambda x: 2 * np.exp(0.004 * x)),
        (5, (0.1, 1.7), "nits", lambda x: 0.1 * x**1.7),
        (6, (5, 0.1), "", lambda x: 5 * np.log(0.1 * x)),
        (8, (10, 2, 1.5, 300), "", lambda x: 2 * (x - 10) ** 1.5 * np.exp(-(x - 10) / 300)),
    ],
)
def test_functions_of_imagej_are_applied(tmp_path, function, parameters, unit, value):
    lines = ["ImageJ=1.54f", f"cf={function}", *(f"c{n}={one}" for n, one in enumerate(parameters)), f"vunit={unit}"]
    described(path := tmp_path / "a.tif", patches(800, 400), "\n".join(lines) + "\n")
    picture = read_picture(path)
    assert contrast(picture) == pytest.approx(value(800) / value(400) - 1, rel=1e-5)
    assert picture.light_is_cd_m2 == (unit in ("cd/m^2", "nits"))
    if picture.light_is_cd_m2:
        assert picture.light[0, 50] == pytest.approx(value(800))


def test_signed_values_of_imagej_keep_their_saturation(tmp_path):
    text = "ImageJ=1.54f\ncf=0\nc0=-32768.0\nc1=1.0\nvunit=gray value\n"
    described(path := tmp_path / "a.tif", patches(65535, 32868), text)
    picture = read_picture(path)
    assert picture.frame.saturated[:, 40:].all()
    assert not picture.frame.saturated[:, :20].any()


def test_a_stack_has_the_function_of_its_first_page(tmp_path):
    def stack(function, *parameters):
        text = "\n".join(
            ["ImageJ=1.54f", "images=3", f"cf={function}", *(f"c{n}={one}" for n, one in enumerate(parameters)), ""]
        )
        with tifffile.TiffWriter(path := tmp_path / "a.tif") as file:
            for number in range(3):
                file.write(patches(33068, 32868), photometric="minisblack", metadata=None,
                           description=None if number else text)  # fmt: skip
        return open_video(path)

    for offset in (-32768, 20):
        frames = [entry.load().frame for entry in stack(0, offset, 1).entries()]
        assert [frame.dn[0, 50] - frame.black_level_dn for frame in frames] == [33068 + offset] * 3
    with pytest.raises(InputError, match="scale"):
        stack(1, 20, 1, 0.5)


def test_calibrated_values_are_not_inverted_with_what_is_shown(tmp_path):
    """An inverting look-up table of ImageJ is stored as WhiteIsZero."""
    text = "ImageJ=1.54f\ncf=0\nc0=255.0\nc1=-1.0\n"
    tifffile.imwrite(path := tmp_path / "a.tif", patches(60, 200, np.uint8), photometric="miniswhite",
                     description=text, metadata=None)  # fmt: skip
    assert contrast(read_picture(path)) == pytest.approx(195 / 55 - 1)


def test_a_function_that_is_not_read_is_named(tmp_path):
    described(path := tmp_path / "a.tif", patches(800, 400), "ImageJ=1.54f\ncf=21\nc0=1\nc1=2\n")
    assert "value-scale-not-used" in codes(read_picture(path))


def test_gdal_and_ome_and_nodata(tmp_path):
    xml = ('<GDALMetadata><Item name="OFFSET" sample="0" role="offset">-100</Item>'
           '<Item name="SCALE" sample="0" role="scale">0.5</Item></GDALMetadata>')  # fmt: skip
    tags = [(42112, "s", 0, xml, True), (42113, "s", 0, "400", True)]
    tifffile.imwrite(tmp_path / "a.tif", patches(800, 400), photometric="minisblack", extratags=tags)
    picture = read_picture(tmp_path / "a.tif")
    assert contrast(picture) == pytest.approx(300 / 100 - 1)
    assert warning("nodata-values", value=400.0, share=0.5) in picture.findings
    tifffile.imwrite(tmp_path / "b.ome.tif", patches(4095, 1000), ome=True, photometric="minisblack",
                     metadata={"axes": "YX", "SignificantBits": 12})  # fmt: skip
    picture = read_picture(tmp_path / "b.ome.tif")
    assert (picture.frame.bit_depth, picture.frame.saturation_dn) == (12, 4095)
    assert "bit-depth-guessed" not in codes(picture)


@pytest.mark.parametrize(("scale", "values"), [("0.5", (400, 200)), ("0", None), ("nan", None)])
def test_other_spellings_of_gdal(tmp_path, scale, values):
    xml = (
        f"<GDALMetadata><Item role='scale' name='SCALE'>{scale}</Item><Item role='unittype'>cd/m2</Item></GDALMetadata>"
    )
    tifffile.imwrite(path := tmp_path / "a.tif", patches(800, 400), photometric="minisblack",
                     extratags=[(42112, "s", 0, xml, True)])  # fmt: skip
    picture = read_picture(path)
    assert ("value-scale-not-used" in codes(picture)) == (values is None)
    if values is not None:
        assert (picture.light_is_cd_m2, picture.light[0, 50], picture.light[0, 5]) == (True, *values)


def test_tables_of_a_tiff_and_its_primaries(tmp_path):
    table = np.rint(65535 * (np.arange(256) / 255) ** 3).astype(int).tolist()
    tags = [(301, "H", 256, table, True)]
    tifffile.imwrite(tmp_path / "a.tif", patches(200, 50, np.uint8), photometric="minisblack", extratags=tags)
    picture = read_picture(tmp_path / "a.tif")
    assert contrast(picture) == pytest.approx(4**3 - 1, rel=0.01)
    assert info("encoding-stated", encoding="gamma 3", by="its tag TransferFunction") in picture.findings


#: Chromaticities of Adobe RGB (1998) and D65 as numerators and denominators, and the weight of green by them.
PRIMARIES = (64, 100, 33, 100, 21, 100, 71, 100, 15, 100, 6, 100), (3127, 10_000, 3290, 10_000)
GREEN = 0.6274


def green(dtype=np.uint8):
    """A picture of green beside a white pixel."""
    values = np.zeros((HEIGHT, WIDTH, 3), dtype)
    values[..., 1], values[0, 0] = np.iinfo(dtype).max, np.iinfo(dtype).max
    return values


def test_primaries_of_a_tiff_count_without_a_table(tmp_path):
    tags = [(319, "2I", 6, PRIMARIES[0], True), (318, "2I", 2, PRIMARIES[1], True)]
    for used, values in ((2, green(np.uint16)), (2, green() / np.float32(255)), (1, green(np.uint16))):
        tifffile.imwrite(path := tmp_path / "a.tif", values, photometric="rgb", extratags=tags[:used])
        picture = read_picture(path)
        found = picture.light[5, 5] if picture.frame is None else picture.frame.dn[5, 5] / 65535
        assert found == pytest.approx(GREEN if used == 2 else 0.7152, abs=2e-4)
        assert ("primaries-not-used" in codes(picture)) == (used == 1)


@pytest.mark.parametrize(
    ("least", "largest", "bits"), [(None, 4095, 12), (0, 4095, 12), (100, 4095, 16), (0, 3000, 16)]
)
def test_a_range_of_sample_values_gives_the_bits(tmp_path, least, largest, bits):
    tags = [(281, "H", 1, largest, True)] + ([] if least is None else [(280, "H", 1, least, True)])
    tifffile.imwrite(path := tmp_path / "a.tif", patches(3000, 1000), photometric="minisblack", extratags=tags)
    picture = read_picture(path)
    assert picture.frame.bit_depth == bits
    assert ("sample-range-not-used" in codes(picture)) == (bits == 16)


def test_levels_of_a_sensor_that_are_not_used_are_named(tmp_path):
    tags = [(50714, "H", 1, 64, True)]
    tifffile.imwrite(path := tmp_path / "a.tif", green(np.uint16), photometric="rgb", extratags=tags)
    assert "sensor-levels-not-used" in codes(read_picture(path))
    tags = [(291, "H", 256, tuple(range(256)), True)]
    tifffile.imwrite(path, patches(200, 50, np.uint8), photometric="minisblack", extratags=tags)
    assert "value-scale-not-used" in codes(read_picture(path))


def test_masked_pixels_of_a_raw_tiff_give_its_black_level(tmp_path):
    values = patches(2064, 564)
    values[:, :8] = 64
    tifffile.imwrite(path := tmp_path / "a.tif", values, photometric="minisblack",
                     extratags=[(50830, "I", 4, (0, 0, 40, 8), True)])  # fmt: skip
    picture = read_picture(path)
    assert info("black-level-measured", black_dn=64.0) in picture.findings
    assert picture.frame.black_level_dn == 64


def exif_tiff(path, values, gamma=None, space=None, index=None, more=()):
    """A TIFF with directories of EXIF and interoperability (CIPA DC-008), which tifffile does not write."""
    photometric = "rgb" if values.ndim == 3 else "minisblack"
    tifffile.imwrite(path, values, photometric=photometric, metadata=None, extratags=[(34664, "I", 1, 0, True), *more])
    data = bytearray(path.read_bytes())
    data += bytes(len(data) % 2)
    with tifffile.TiffFile(path) as file:
        tag = file.pages.first.tags[34664]
        struct.pack_into("<H", data, tag.offset, 34665)
        struct.pack_into("<I", data, tag.valueoffset, len(data))
    count = sum(one is not None for one in (gamma, space, index))
    entries, rest, end = b"", b"", len(data) + 6 + 12 * count
    if space is not None:
        entries += struct.pack("<HHIHH", 0xA001, 3, 1, space, 0)
    if index is not None:
        entries += struct.pack("<HHII", 0xA005, 4, 1, end + len(rest))
        rest += struct.pack("<HHHI4sI", 1, 1, 2, 4, index, 0)
    if gamma is not None:
        entries += struct.pack("<HHII", 0xA500, 5, 1, end + len(rest))
        rest += struct.pack("<II", round(1000 * gamma), 1000)
    path.write_bytes(data + struct.pack("<H", count) + entries + bytes(4) + rest)
    return path


def test_exif_of_a_tiff_states_its_curve(tmp_path):
    grey, path = patches(40000, 10000), tmp_path / "a.tif"
    assert contrast(read_picture(exif_tiff(path, grey, gamma=2.2))) == pytest.approx(4**2.2 - 1, rel=1e-3)
    bright, dark = decoded(np.array([40000, 10000]) / 65535, "srgb")
    assert contrast(read_picture(exif_tiff(path, grey, space=1))) == pytest.approx(bright / dark - 1, rel=1e-3)
    adobe = read_picture(exif_tiff(path, green(), space=65535, index=b"R03"))
    assert adobe.frame.dn[5, 5] / 65535 == pytest.approx(GREEN, abs=2e-4)
    # Raw files of cameras have the colour space of others.
    raw = read_picture(exif_tiff(path, patches(2064, 564), space=1, more=[(50714, "H", 1, 64, True)]))
    assert contrast(raw) == pytest.approx(3)
    assert "curve-not-used" in codes(raw)
    floats = read_picture(exif_tiff(path, grey.astype(np.float32), gamma=2.2))
    assert contrast(floats) == pytest.approx(3)
    assert "curve-not-used" in codes(floats)


def test_luminance_of_the_value_1_in_floats(tmp_path):
    tags = [(37439, "d", 1, 179.0, True)]
    values = patches(2, 1, np.float32)
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack", extratags=tags)
    picture = read_picture(tmp_path / "a.tif")
    assert (picture.light_is_cd_m2, picture.light[0, 50]) == (True, 358.0)


# JPEG


def test_exif_of_a_jpeg_states_a_gamma_or_adobe_rgb(tmp_path):
    for name, tags, encoding in (("g", {0xA500: 1.0}, "linear"), ("u", {0xA001: 65535}, "srgb")):
        block = Image.Exif()
        block[271] = "Acme"
        block.get_ifd(0x8769).update(tags)
        Image.fromarray(patches(200, 60, np.uint8)).save(tmp_path / f"{name}.jpg", exif=block, quality=100)
        assert read_picture(tmp_path / f"{name}.jpg").encoding == encoding


@pytest.mark.parametrize(
    ("tags", "index"), [({0xA001: 65535, 0xA500: 2.2}, "R03"), ({0xA001: 65535}, "R03"), ({0xA001: 2}, None)]
)
def test_adobe_rgb_of_a_jpeg_has_its_primaries(tmp_path, tags, index):
    """Cameras write a gamma too."""
    block = Image.Exif()
    block.get_ifd(0x8769).update(tags | ({0xA005: {1: index}} if index else {}))
    Image.fromarray(green()).save(tmp_path / "a.jpg", exif=block, quality=100, subsampling=0)
    picture = read_picture(tmp_path / "a.jpg")
    assert picture.encoding in ("gamma 2.2", "gamma 2.199")
    assert picture.frame.dn[20, 30] / 65535 == pytest.approx(GREEN, abs=1e-3)


# OpenEXR


@pytest.mark.parametrize(
    ("attributes", "code"),
    [({"chromaticities": (0.0,) * 8}, "primaries-not-used"), ({"whiteLuminance": 0.0}, "value-scale-not-used"),
     ({"oiio:ColorSpace": "sRGB"}, "curve-not-used"), ({"oiio:ColorSpace": "lin_rec709"}, None),
     ({"oiio:Gamma": 2.2}, "curve-not-used"), ({"oiio:Gamma": 1.0}, None)],
)  # fmt: skip
def test_attributes_of_an_exr_that_are_not_used_are_named(tmp_path, attributes, code):
    import OpenEXR

    values = patches(2, 0.5, np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    with OpenEXR.File(header, {"R": values, "G": values, "B": values}) as file:
        file.write(str(tmp_path / "a.exr"))
    picture = read_picture(tmp_path / "a.exr")
    assert contrast(picture) == pytest.approx(3)
    assert set(codes(picture)) == {"colour-to-grey", *filter(None, [code])}


# Frames of a session


def test_a_curve_of_what_is_imported_is_named(tmp_path):
    (tmp_path / "a.png").write_bytes(png(patches(4000, 1000), 16, (b"sRGB", b"\0")))
    read = read_image(tmp_path / "a.png", pixel_format("Mono12"), PictureOptions(exposure_s=1))
    assert (read.frame.dn[0, 50], codes(read)) == (4000, ["curve-not-used"])


# The same values in every container


def video(path, codec, pixel_format, **stated):
    """A video of grey patches without loss."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixel_format
        for name, value in stated.items():
            setattr(stream.codec_context, name, value)
        for number in range(3):
            frame = av.VideoFrame.from_ndarray(patches(200, 60, np.uint8), format="gray")
            frame = frame.reformat(format=pixel_format, dst_color_range=2)
            frame.pts = number
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


@pytest.mark.parametrize(
    ("name", "codec", "pixel_format"),
    [("a.mkv", "ffv1", "gray"), ("b.mkv", "ffv1", "bgr0"), ("c.avi", "rawvideo", "bgr24"),
     ("d.avi", "huffyuv", "rgb24"), ("e.mov", "png", "rgb24"), ("f.mov", "png", "gray"), ("g.mkv", "ffv1", "gbrp10le")],
)  # fmt: skip
def test_grey_without_loss_is_linear_whatever_the_pixel_format(tmp_path, name, codec, pixel_format):
    source = open_video(video(tmp_path / name, codec, pixel_format))
    frame = next(iter(source.entries())).load().frame
    assert source.encoding == "linear"
    assert frame.dn[0, 50] / frame.dn[0, 10] - 1 == pytest.approx(200 / 60 - 1, rel=0.005)


@pytest.mark.parametrize(("quantiser", "encoding"), [("0", "linear"), ("4", "srgb")])
@pytest.mark.parametrize("pixel_format", ["gray", "gray10le"])
def test_grey_in_h264_without_loss_is_linear(tmp_path, quantiser, encoding, pixel_format):
    values = np.random.default_rng(1).integers(0, 1024 if "10" in pixel_format else 256, (HEIGHT, WIDTH))
    path = write(tmp_path / "a.mp4", "libx264", pixel_format, [values] * 4, {"qp": quantiser}, color_range=2)
    source = open_video(path)
    assert source.encoding == encoding
    assert np.array_equal(next(iter(source.entries())).load().frame.dn, values) == (encoding == "linear")


def palette_avi(path):
    """An uncompressed AVI of one grey frame behind a grey palette, as ImageJ's AVI writer makes it."""
    header = struct.pack("<IiiHHIIiiII", 40, WIDTH, HEIGHT, 1, 8, 0, WIDTH * HEIGHT, 0, 0, 256, 0)
    palette = b"".join(bytes((n, n, n, 0)) for n in range(256))
    frame = patches(200, 60, np.uint8)[::-1].tobytes()

    def part(name, body):
        return name + struct.pack("<I", len(body)) + body + bytes(len(body) % 2)

    main = struct.pack("<10I4I", 40_000, 0, 0, 0x10, 1, 0, 1, 0, WIDTH, HEIGHT, 0, 0, 0, 0)
    stream = b"vidsDIB " + struct.pack("<IHHIIIIIIIIhhhh", 0, 0, 0, 0, 1, 25, 0, 1, 0, 0, 0, 0, 0, WIDTH, HEIGHT)
    lists = part(b"LIST", b"strl" + part(b"strh", stream) + part(b"strf", header + palette))
    body = part(b"LIST", b"hdrl" + part(b"avih", main) + lists) + part(b"LIST", b"movi" + part(b"00db", frame))
    path.write_bytes(part(b"RIFF", b"AVI " + body))
    return path


def test_a_grey_palette_is_grey(tmp_path):
    source = open_video(palette_avi(tmp_path / "a.avi"))
    frame = next(iter(source.entries())).load().frame
    assert (source.encoding, frame.dn[0, 50], frame.dn[0, 10]) == ("linear", 200, 60)


# Bits and saturation: a picture is a video of one frame


def deep_video(path, *pictures, codec="ffv1", pixel_format="gray16le"):
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixel_format
        for number, values in enumerate(pictures):
            source = "gray16le" if values.ndim == 2 else "rgb48le"
            frame = av.VideoFrame.from_ndarray(values, format=source).reformat(format=pixel_format)
            frame.pts = number
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def said_of_bits(open_it, path, options):
    """What is said of bits and saturation: a frame's, findings on them, or the refusal."""
    try:
        source = open_it(path, options)
        frame = source.frame if open_it is read_picture else next(iter(source.entries())).load().frame
    except InputError as error:
        return str(error).partition(" ")[2]
    found = [one for one in source.findings if "bit-depth" in one.code]
    return frame.bit_depth, frame.saturation_dn, frame.saturated.sum(), frame.dn[0, [10, 50]].tolist(), found


@pytest.mark.parametrize("bit_depth", [None, 8, 10, 12, 14, 16])
@pytest.mark.parametrize("top", [255, 1023, 3000, 4095, 65520, 65535])
def test_the_same_values_mean_the_same_in_all_that_keeps_them(tmp_path, top, bit_depth):
    values, options = patches(top, top // 4), PictureOptions().given(bit_depth=bit_depth, encoding="linear")
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack")
    (tmp_path / "a.png").write_bytes(png(values, 16))
    np.save(tmp_path / "a.npy", values)
    found = [said_of_bits(read_picture, tmp_path / f"a.{suffix}", options) for suffix in ("tif", "png", "npy")]
    (folder := tmp_path / "images").mkdir()
    for number in range(3):
        tifffile.imwrite(folder / f"{number}.tif", values, photometric="minisblack")
    if "above" not in found[0]:
        # Of pictures that are refused, the refusal names one.
        found.append(said_of_bits(open_video, folder, options))
    for name, codec, kind in (
        ("a.mkv", "ffv1", "gray16le"), ("b.mkv", "ffv1", "gbrp16le"), ("c.mov", "png", "gray16be"),
        ("d.mov", "png", "rgb48be"), ("e.nut", "rawvideo", "gray16le"), ("f.avi", "ffv1", "gray16le"),
    ):  # fmt: skip
        path = deep_video(tmp_path / name, values, values, codec=codec, pixel_format=kind)
        found.append(said_of_bits(open_video, path, options))
    assert all(one == found[0] for one in found[1:])


@pytest.mark.parametrize("top", [4095, 5000])
def test_bits_of_a_video_are_those_of_frames_of_all_parts(tmp_path, top):
    """As of a folder of pictures: of a video that begins in the dark, or in a brighter light later."""
    pictures = [patches(4095 if top > 4095 else 3000, 750)] * 20 + [patches(top, 1000)] * 10
    (folder := tmp_path / "images").mkdir()
    for number, values in enumerate(pictures):
        tifffile.imwrite(folder / f"{number}.tif", values, photometric="minisblack")
    video, images = open_video(deep_video(tmp_path / "a.mkv", *pictures)), open_video(folder)
    last = [[*source.entries()][-1].load().frame for source in (video, images)]
    assert np.array_equal(last[0].saturated, last[1].saturated)
    assert (last[0].bit_depth, last[0].saturated[0, 50]) == (last[1].bit_depth, top == 4095)
    of_bits = [[one for one in source.findings if one.code.startswith("bit-depth")] for source in (video, images)]
    assert of_bits[0] == of_bits[1]


def still_video(path, codec, pixel_format, data):
    """A video whose frames are files of pictures."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixel_format
        for number in range(3):
            packet = av.Packet(data)
            packet.stream, packet.pts, packet.dts, packet.time_base = stream, number, number, Fraction(1, 25)
            packet.is_keyframe = True
            container.mux(packet)
    return open_video(path)


def test_frames_that_are_pictures_state_their_curve(tmp_path):
    values = np.dstack([patches(200, 50, np.uint8)] * 3)
    with_profile(tmp_path / "a.jpg", values, profile(curve_tag(1.0), True))
    source = still_video(tmp_path / "a.mov", "mjpeg", "yuvj444p", (tmp_path / "a.jpg").read_bytes())
    assert source.encoding == "linear"
    for gamma, encoding in ((50_000, "gamma 2"), (45_455, "gamma 2.2")):
        data = png(patches(200, 50, np.uint8), 8, (b"gAMA", struct.pack(">I", gamma)))
        assert still_video(tmp_path / "b.mov", "png", "gray", data).encoding == encoding
    with_profile(tmp_path / "c.jpg", values, profile(TABLE.replace(bytes((128, 0)), bytes((9, 0))), True))
    source = still_video(tmp_path / "c.mov", "mjpeg", "yuvj444p", (tmp_path / "c.jpg").read_bytes())
    assert "icc-profile-not-used" in codes(source)


def rgb_video(path, codec, pixel_format, pictures):
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixel_format
        for number, values in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(values, format="rgb24").reformat(format=pixel_format)
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return open_video(path)


@pytest.mark.parametrize(("codec", "pixel_format"), [("ffv1", "bgr0"), ("libx264", "yuv444p")])
def test_colours_behind_black_frames_are_colours(tmp_path, codec, pixel_format):
    """As in a video that begins with colours, where the red channel was taken for grey."""
    black, colours = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    colours[:, 30:], colours[:, :30] = (200, 150, 100), (60, 45, 30)
    found = [
        [*rgb_video(tmp_path / "a.mkv", codec, pixel_format, pictures).entries()][-1].load().frame
        for pictures in ([colours] * 6, [black] * 40 + [colours] * 40)
    ]
    assert found[0].bit_depth == found[1].bit_depth == 16
    np.testing.assert_allclose(found[1].dn[20, [10, 50]], found[0].dn[20, [10, 50]], rtol=0.02)


def test_a_coloured_frame_is_never_taken_for_grey(tmp_path):
    grey, colours = (np.full((HEIGHT, WIDTH, 3), value, np.uint8) for value in ((90, 90, 90), (90, 80, 30)))
    source = rgb_video(tmp_path / "a.mkv", "ffv1", "bgr0", [grey] * 55 + [colours] + [grey] * 4)
    entries = list(source.entries())
    assert entries[54].load().frame.dn[0, 0] == 90
    with pytest.raises(InputError, match="coloured"):
        list(source.entries())[55].load()


@pytest.mark.parametrize(("upper", "saturation"), [(0, 4095), (4, 65520)])
def test_bits_of_colours_are_one_for_all_pictures_of_a_video(tmp_path, upper, saturation):
    """In a folder, each picture had its own: the light changed 16-fold where one was clipped."""
    tops = (3000, 3000, 4095, 3000)
    pictures = [np.dstack([patches(top << upper, 1000 << upper)] + [patches(2000 << upper, 500 << upper)] * 2)
                for top in tops]  # fmt: skip
    (folder := tmp_path / "images").mkdir()
    for number, values in enumerate(pictures):
        tifffile.imwrite(folder / f"{number}.tif", values, photometric="rgb")
    path = deep_video(tmp_path / "a.mkv", *pictures, pixel_format="gbrp16le")
    for source in (open_video(folder), open_video(path, PictureOptions().given(encoding="linear"))):
        frames = [entry.load().frame for entry in source.entries()]
        assert len({int(frame.dn[0, 10]) for frame in frames}) == 1
        assert [bool(frame.saturated[0, 50]) for frame in frames] == [top == 4095 for top in tops]
        assert next(one for one in source.findings if "guessed" in one.code).values["saturation_dn"] == saturation


def test_bits_of_colours_of_a_video(tmp_path):
    source = open_video(
        deep_video(tmp_path / "a.mkv", patches(4095, 1000), pixel_format="rgb48le"),
        PictureOptions().given(bit_depth=12),
    )
    frame = next(iter(source.entries())).load().frame
    assert "bit-depth-ignored" not in codes(source)
    assert frame.saturated[:, 40:].all()


def test_names_of_encodings():
    assert [encoding_name(one) for one in ("srgb", "pq", "gamma 2.2")] == ["sRGB", "PQ", "gamma 2.2"]
