"""What files state of the curve, the colours and the scale of their values is used, in every format, or named."""

import struct
import zlib

import av
import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms

from labcdp.core.result import info, warning
from labcdp.evaluate.picture.conversion import picture_conversion
from labcdp.files import PictureOptions, read_picture
from labcdp.files.icc import read_profile
from labcdp.files.transfer import PRIMARIES_OF_CODE, decoded, encoding_name, known_encoding, luminance_weights
from labcdp.files.video.open import open_video

from .png_bytes import chunk, png

#: Two patches side by side, bright and dark.
HEIGHT, WIDTH = 40, 60


def patches(bright, dark, dtype=np.uint16):
    values = np.full((HEIGHT, WIDTH), dark, dtype)
    values[:, WIDTH // 2 :] = bright
    return values


def contrast(picture, **given):
    """Weber contrast of the two patches as relative luminance has it."""
    light = picture_conversion(None, None, None).luminance(picture).luminance_cd_m2
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


def test_a_curve_of_its_own_is_used_as_a_table(tmp_path):
    tag = b"curv" + bytes(4) + struct.pack(">I5H", 5, 0, 3000, 9000, 40000, 65535)
    with_profile(path := tmp_path / "a.png", patches(192, 64, np.uint8), profile(tag, False))
    picture = read_picture(path)
    light = np.interp([192 / 255, 64 / 255], np.linspace(0, 1, 5), [0, 3000, 9000, 40000, 65535])
    assert contrast(picture) == pytest.approx(light[0] / light[1] - 1, rel=1e-3)
    assert picture.frame.saturation_dn == 65535


@pytest.mark.parametrize(
    ("data", "coloured"),
    [(bytes(400), True), (profile(curve_tag(1), True), False), (profile(curve_tag(1), True)[:150], True)],
)
def test_a_profile_that_cannot_be_used_is_named(tmp_path, data, coloured):
    values = patches(40000, 10000)
    values = np.dstack([values, values, values // 2]) if coloured else values
    with_profile(path := tmp_path / "a.tif", values, data)
    assert "icc-profile-not-used" in codes(read_picture(path))


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


def test_limited_range_and_unknown_codes_of_a_png(tmp_path):
    (tmp_path / "a.png").write_bytes(png(patches(235, 60, np.uint8), 8, (b"cICP", bytes((1, 8, 0, 0)))))
    assert contrast(read_picture(tmp_path / "a.png")) == pytest.approx(219 / 44 - 1, rel=0.01)
    (tmp_path / "b.png").write_bytes(png(patches(40, 10, np.uint8), 8, (b"cICP", bytes((77, 99, 0, 1)))))
    assert {"transfer-code-unknown", "primaries-code-unknown"} <= set(codes(read_picture(tmp_path / "b.png")))


def test_colours_of_a_png_have_the_weights_of_their_primaries(tmp_path):
    values = np.zeros((4, 4, 3), np.uint8)
    values[..., 1], values[0, 0] = 255, 255
    cv2.imwrite(str(tmp_path / "a.png"), values)
    content = (tmp_path / "a.png").read_bytes()
    (tmp_path / "a.png").write_bytes(content[:33] + chunk(b"cICP", bytes((9, 8, 0, 1))) + content[33:])
    picture = read_picture(tmp_path / "a.png")
    assert picture.frame.dn[1, 1] / 65535 == pytest.approx(0.6780, abs=1e-4)
    assert "colour-to-grey-by-file" in codes(picture)


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


def test_tables_of_a_tiff_and_its_primaries(tmp_path):
    table = np.rint(65535 * (np.arange(256) / 255) ** 3).astype(int).tolist()
    tags = [(301, "H", 256, table, True)]
    tifffile.imwrite(tmp_path / "a.tif", patches(200, 50, np.uint8), photometric="minisblack", extratags=tags)
    picture = read_picture(tmp_path / "a.tif")
    assert contrast(picture) == pytest.approx(4**3 - 1, rel=0.01)
    assert info("encoding-stated", encoding="gamma 3", by="its tag TransferFunction") in picture.findings


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


def deep_video(path, values, pixel_format="gray16le"):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixel_format
        for number in range(4):
            frame = av.VideoFrame.from_ndarray(values, format="gray16le").reformat(format=pixel_format)
            frame.pts = number
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


@pytest.mark.parametrize(
    ("top", "bit_depth"), [(4095, None), (1023, None), (65520, None), (3000, None), (3000, 12), (4095, 12), (4095, 14)]
)
def test_bits_and_saturation_of_a_video_are_those_of_the_same_pictures(tmp_path, top, bit_depth):
    values = patches(top, top // 16 * 4)
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack")
    options = PictureOptions().given(bit_depth=bit_depth)
    picture = read_picture(tmp_path / "a.tif", options)
    (folder := tmp_path / "images").mkdir()
    for number in range(3):
        tifffile.imwrite(folder / f"{number}.tif", values, photometric="minisblack")
    for source in (open_video(deep_video(tmp_path / "a.mkv", values), options), open_video(folder, options)):
        frame = next(iter(source.entries())).load().frame
        for name in ("bit_depth", "saturation_dn"):
            assert getattr(frame, name) == getattr(picture.frame, name)
        assert np.array_equal(frame.saturated, picture.frame.saturated)
        of_bits = [code for code in codes(source) if code.startswith("bit-depth")]
        assert of_bits == [code for code in codes(picture) if code.startswith("bit-depth")]


def test_bits_of_colours_of_a_video(tmp_path):
    source = open_video(
        deep_video(tmp_path / "a.mkv", patches(4095, 1000), "rgb48le"), PictureOptions().given(bit_depth=12)
    )
    frame = next(iter(source.entries())).load().frame
    assert "bit-depth-ignored" not in codes(source)
    assert frame.saturated[:, 40:].all()


def test_names_of_encodings():
    assert [encoding_name(one) for one in ("srgb", "pq", "gamma 2.2")] == ["sRGB", "PQ", "gamma 2.2"]
