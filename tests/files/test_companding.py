"""Companded data: each code of each curve, files as cameras write them, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import tifffile

import labcdp
from labcdp.core.errors import ConfigurationError, InputError
from labcdp.core.luminance import Invalid
from labcdp.evaluate.picture.converter import make_converter
from labcdp.files import Companding, PictureOptions, load_curve, shipped_curve, shipped_curves
from labcdp.files.video.open import open_video
from labcdp.files.video.selection import Selection
from labcdp.files.video.source import frames_of
from labcdp.regions import RectangleShape, save_regions

from .video_files import write as write_video

AR0231 = shipped_curve("AR0231")
BRIGHT, DARK = labcdp.Roi.rectangle("bright", 70, 10, 50, 40), labcdp.Roi.rectangle("dark", 10, 10, 50, 40)


def expanded(code):
    """AR0231 in whole numbers: slope 1 up to 2048, 64 up to 3040, 1024 above."""
    if code <= 2048:
        return code
    return 2048 + 64 * (code - 2048) if code <= 3040 else 65536 + 1024 * (code - 3040)


def scene(bright=180_000.0, dark=1500.0, seed=1):
    """Linear values of two regions with the noise of photons, 20 bits."""
    linear = np.full((60, 130), dark)
    linear[:, 65:] = bright
    return linear + np.sqrt(linear) * np.random.default_rng(seed).standard_normal(linear.shape)


def file_of(folder, codes, name="codes.tif"):
    tifffile.imwrite(folder / name, codes)
    return folder / name


@pytest.mark.parametrize("name", shipped_curves())
def test_each_code_comes_back(name):
    curve = shipped_curve(name)
    codes = np.arange(int(curve.codes[-1]) + 1)
    assert np.array_equal(curve.code(curve.linear(codes)), codes)
    assert (np.diff(curve.linear(codes)) > 0).all()


def test_all_codes_are_whole_numbers_and_stay_exact_through_a_file(tmp_path):
    codes = np.arange(4000, dtype=np.uint16).reshape(40, 100)
    luminance = labcdp.read_image(file_of(tmp_path, codes), encoding="ar0231").luminance
    truth = np.array([expanded(code) for code in codes.ravel().tolist()]).reshape(codes.shape)
    assert np.array_equal(np.asarray(luminance, dtype=float) * AR0231.scale, truth)


def test_knees_of_the_published_curve_of_13_are_powers_of_two():
    curve = shipped_curve("AR0820")
    assert curve.linear([0x200, 0x800, 0x820, 0xBE0, 0xFA0]).tolist() == [2**9, 2**11, 2**12, 2**16, 2**20]


def test_codes_from_the_last_knee_on_are_saturated_and_rounding_is_that_of_the_code(tmp_path):
    codes = np.full((20, 40), 3999, np.uint16)
    codes[:, 20:] = 4000
    luminance = labcdp.read_image(file_of(tmp_path, codes), encoding="AR0231").luminance
    assert not luminance.invalid[:, :20].any()
    assert (luminance.invalid[:, 20:] == Invalid.SATURATED).all()
    whole = slice(None), slice(0, 20)
    assert np.asarray(luminance.dn_step_in(whole)) == pytest.approx(1024 / AR0231.scale)
    dark = labcdp.read_image(file_of(tmp_path, codes // 4), encoding="AR0231").luminance
    assert np.asarray(dark.dn_step_in(whole)) == pytest.approx(1 / AR0231.scale)


@pytest.mark.parametrize("black", [{}, {"black_value": 168.0}, {"black_code": 42.0}])
@pytest.mark.parametrize("shift", [0, 4])
@pytest.mark.parametrize("rows", [(0, 0), (2, 3)])
def test_black_level_alignment_and_embedded_rows_make_no_difference(tmp_path, black, shift, rows):
    curve = replace(AR0231, codes=(0, 2048, 3040, 3900), values=(0, 2048, 65536, 946_176), **black)
    linear = np.rint(scene())
    stored = np.full((60 + sum(rows), 130), 7, np.uint16)
    stored[rows[0] : rows[0] + 60] = curve.code(linear) << shift
    image = labcdp.read_image(
        file_of(tmp_path, stored), encoding=replace(curve, shift=shift, embedded_rows=rows), no_vignetting=True
    )
    assert image.luminance.shape == (60, 130)
    found = np.asarray(image.luminance, dtype=float) * curve.scale
    # Rounding of the code, and of a float32.
    step = np.interp(linear, (2048, 2049, 65536, 65537), (1, 64, 64, 1024))
    assert (np.abs(found - linear) <= 0.5 * step + 1e-6 * linear).all()


def test_the_contrast_is_that_of_the_linear_values(tmp_path):
    linear = scene(bright=40_000.0)
    pair = [BRIGHT, DARK]
    as_codes = labcdp.read_image(file_of(tmp_path, AR0231.code(linear)), encoding="AR0231", no_vignetting=True)
    as_linear = labcdp.read_image(
        file_of(tmp_path, np.rint(linear).astype(np.uint16), "linear.tif"), encoding="linear", bit_depth=16,
        no_vignetting=True,
    )  # fmt: skip
    codes, values = (image.regions(pair).cdp([25.0, 40.0]) for image in (as_codes, as_linear))
    u = codes["u_measured_contrast"].item()
    assert codes["measured_contrast"].item() == pytest.approx(values["measured_contrast"].item(), abs=3 * u)
    assert codes["cdp"].values.ravel() == pytest.approx(values["cdp"].values.ravel(), abs=0.01)
    # Taken as proportional, the codes have another contrast by far.
    raw = labcdp.read_image(tmp_path / "codes.tif", encoding="linear", bit_depth=12, no_vignetting=True)
    assert raw.regions(pair).cdp(25.0)["measured_contrast"].item() < 1


def test_command_line_folder_of_frames_and_camera_specification(tmp_path, labcdp_in):
    frames = tmp_path / "frames"
    frames.mkdir()
    for number in range(3):
        file_of(frames, AR0231.code(scene(seed=number)), f"{number}.tif")
    save_regions(
        tmp_path / "rois.json", [RectangleShape("bright", 70, 10, 50, 40), RectangleShape("dark", 10, 10, 50, 40)]
    )
    (tmp_path / "curve.toml").write_text(
        'name = "mine"\nbits = 12\ncodes = [0, 2048, 3040, 4000]\nvalues = [0, 2048, 65536, 1048576]\n'
    )
    (tmp_path / "camera.toml").write_text(
        'name = "series"\nadc_bits = 12\nexposure_s = 0.01\nquantum_efficiency = 0.5\npixel_pitch_m = 3e-6\n'
        "f_number = 1.8\nk_dn_per_e = 1.0\nlens_transmittance = 0.9\nspectrum = \"D65\"\nencoding = \"AR0231\"\n"
    )  # fmt: skip
    asked = ("--roi", "rois.json", "--contrast", "11900%")
    for command, *options in (
        ("image", "frames/0.tif", *asked, "--encoding", "AR0231", "-o", "a"),
        ("image", "frames/0.tif", *asked, "--encoding", "curve.toml", "-o", "b"),
        ("image", "frames/0.tif", *asked, "--camera-spec", "camera.toml", "-o", "c"),
        ("video", "frames", *asked, "--encoding", "AR0231", "--method", "fixed", "-o", "d"),
    ):
        done = labcdp_in(tmp_path, command, *options)
        assert done.returncode == 0, done.stderr
        assert "standard curve" not in done.stdout + done.stderr
    contrasts = [
        labcdp.read_dataset(tmp_path / "d" / "results.nc")["measured_contrast"].values[0].item(),
        *(_contrast(tmp_path / name) for name in "abc"),
    ]
    assert contrasts == pytest.approx([119.0] * 4, rel=0.02)
    assert contrasts[1] == contrasts[2]


def test_a_video_without_loss_holds_codes_as_a_folder_of_pictures_does(tmp_path):
    curve = replace(AR0231, embedded_rows=(2, 1))
    frames = []
    (tmp_path / "frames").mkdir()
    for number in range(3):
        stored = np.full((63, 130), 4095, np.uint16)
        stored[2:62] = AR0231.code(scene(seed=number))
        frames.append(stored)
        file_of(tmp_path / "frames", stored, f"{number}.tif")
    write_video(tmp_path / "codes.mkv", "ffv1", "gray16le", frames)
    options = PictureOptions().given(encoding=curve)
    of_file, of_folder = (
        frames_of(open_video(tmp_path / name, options), Selection()) for name in ("codes.mkv", "frames")
    )
    light = make_converter(encoding=curve)
    for one, other in zip(of_file, of_folder, strict=True):
        assert np.array_equal(one.frame.linear_dn(), other.frame.linear_dn())
        assert np.array_equal(*(light.convert(each.frame).luminance_cd_m2 for each in (one, other)))
    write_video(tmp_path / "lossy.mp4", "libx264", "gray", [(frame[:60] >> 4).astype(np.uint8) for frame in frames])
    with pytest.raises(InputError, match="holds numbers that its codec changed, but codes of the curve AR0231"):
        open_video(tmp_path / "lossy.mp4", options)


def _contrast(folder):
    import json

    return json.loads((folder / "results.json").read_text())["tables"]["cdp"]["rows"][0]["measured_contrast"]


@pytest.mark.parametrize(
    ("knees", "message"),
    [
        ({"codes": (0,), "values": (0,)}, "two knees or more"),
        ({"codes": (0, 10, 5)}, "rising order"),
        ({"values": (0, 10, 10)}, "rising order"),
        ({"codes": (0, 10, 5000)}, "in 12 bits"),
        ({"codes": (1, 10, 50)}, "first knee at code 0"),
        ({"codes": (0, 10)}, "both of two knees"),
        ({"shift": 5}, "give 0 to 4 bits"),
        ({"values": (0, float("nan"), 20)}, "rising order"),
        ({"values": (0, "10", 20)}, "has '10': give numbers"),
        ({"bits": 12.5}, "1 to 16 bits"),
        ({"bits": 17}, "1 to 16 bits"),
        ({"bits": True}, "has True: give numbers"),
        ({"shift": 0.5}, "whole numbers"),
        ({"embedded_rows": (-1, 2)}, "embedded_rows"),
        ({"embedded_rows": (1, 2, 3)}, "embedded_rows"),
        ({"embedded_rows": 2}, "embedded_rows"),
        # A black level beside the curve would not be subtracted, as no code stands for it.
        ({"black_value": -100.0}, "from that of the first knee, 0"),
        ({"values": (64, 100, 200)}, "from that of the first knee, 64"),
        ({"black_value": 100}, "to below that of the last, 100"),
        ({"black_value": float("inf")}, "black_value"),
        ({"black_value": float("nan")}, "black_value"),
        ({"black_code": -1}, "black_code"),
    ],
)
def test_a_curve_that_is_none_is_refused_in_a_line(tmp_path, knees, message):
    with pytest.raises(InputError, match=message) as raised:
        Companding(**{"name": "bad", "codes": (0, 10, 20), "values": (0, 10, 100), "bits": 12, **knees})
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name = 'x'\nbits = 12\ncodes = [0]\nvalues = [0]", "codes"),
        ("name = 'x'\nbits = 12\ncodes = [0, 1]\nvalues = [0, 1]\nknees = 3", "knees is not a known key"),
        ("name = 'x'\nbits = 17\ncodes = [0, 1]\nvalues = [0, 1]", "bits is 17"),
        ("name = 'x'\nbits = 12\ncodes = [0, 'a']\nvalues = [0, 1]", "codes"),
    ],
)
def test_a_file_of_a_curve_names_the_key(tmp_path, text, message):
    (tmp_path / "curve.toml").write_text(text)
    with pytest.raises(ConfigurationError, match=message) as raised:
        load_curve(tmp_path / "curve.toml")
    assert "curve.toml" in str(raised.value)


@pytest.mark.parametrize("kind", [list, np.array])
def test_knees_may_be_lists_or_arrays(tmp_path, kind):
    curve = Companding("mine", kind([0, 2048, 3040, 4000]), kind([0, 2048, 65536, 1048576]), bits=np.uint8(12))
    codes = file_of(tmp_path, np.full((20, 30), 3000, np.uint16))
    expected = np.asarray(labcdp.read_image(codes, encoding="AR0231").luminance)
    assert np.array_equal(np.asarray(labcdp.read_image(codes, encoding=curve).luminance), expected)


def test_files_without_codes_are_refused(tmp_path):
    colours, floats, bytes_ = (
        file_of(tmp_path, values, name)
        for values, name in (
            (np.arange(1800, dtype=np.uint16).reshape(20, 30, 3), "colours.tif"),
            (np.zeros((20, 30), np.float32), "floats.tif"),
            (np.zeros((20, 30), np.uint8), "bytes.tif"),
        )
    )
    for path, message in ((colours, "colours"), (floats, "floats"), (bytes_, "8 bits")):
        with pytest.raises(InputError, match=message):
            labcdp.read_image(path, encoding="AR0231")
    codes = file_of(tmp_path, np.full((20, 30), 100, np.uint16))
    for options, message in (
        ({"encoding": "AR9999"}, "AR0231"),
        ({"encoding": "AR0231", "bit_depth": 16}, "the curve AR0231 is for values of 12 bits"),
        ({"encoding": replace(AR0231, embedded_rows=(10, 10))}, "embedded"),
        ({"encoding": "missing.toml"}, "missing.toml"),
    ):
        with pytest.raises(InputError, match=message):
            labcdp.read_image(codes, **options)
    above = file_of(tmp_path, np.full((20, 30), 5000, np.uint16), "above.tif")
    with pytest.raises(InputError, match="above 12 bits"):
        labcdp.read_image(above, encoding="AR0231")


@pytest.mark.parametrize("suffix", ["tif", "npy"])
@pytest.mark.parametrize("bits", [20, 24])
def test_linear_values_of_many_bits_are_exact(tmp_path, suffix, bits):
    top = 2**bits - 1
    values = np.linspace(65, top, 60 * 130).round().astype(np.uint32).reshape(60, 130)
    path = tmp_path / f"linear.{suffix}"
    np.save(path, values) if suffix == "npy" else tifffile.imwrite(path, values)
    for options, code in (({}, "many-bits-guessed"), ({"bit_depth": bits}, "many-bits")):
        image = labcdp.read_image(path, no_vignetting=True, **options)
        assert [finding.code for finding in image.picture.findings] == [code]
        assert np.array_equal(np.asarray(image.luminance, dtype=float) * 2**bits, values)
        assert np.array_equal(image.luminance.invalid > 0, values == top)
    black = labcdp.read_image(path, no_vignetting=True, bit_depth=bits, black_level_dn=65.0)
    assert np.array_equal(np.asarray(black.luminance, dtype=float) * 2**bits, values - 65.0)


def test_many_bits_and_their_codes_have_one_contrast(tmp_path):
    linear = np.rint(scene()).astype(np.uint32)
    np.save(tmp_path / "linear.npy", linear)
    many = labcdp.read_image(tmp_path / "linear.npy", bit_depth=20, no_vignetting=True)
    codes = labcdp.read_image(file_of(tmp_path, AR0231.code(linear)), encoding="AR0231", no_vignetting=True)
    found = [image.regions([BRIGHT, DARK]).cdp([100.0])["measured_contrast"].item() for image in (many, codes)]
    assert found[0] == pytest.approx(found[1], rel=1e-3)


def test_values_that_no_bits_hold_are_refused(tmp_path):
    for values, options, message in (
        (np.full((20, 30), 2**24, np.uint32), {}, "from 0 to 16777215"),
        (np.full((20, 30), -1, np.int32), {}, "from 0 to 16777215"),
        (np.full((20, 30), 2**20, np.uint32), {"bit_depth": 20}, "above 20 bits"),
        (np.full((20, 30), 70_000, np.uint32), {"encoding": "srgb"}, "linear grey only"),
        (np.full((20, 30), 1000, np.uint16), {"bit_depth": 20}, "give 1 to 16"),
    ):
        np.save(tmp_path / "values.npy", values)
        with pytest.raises(InputError, match=message):
            labcdp.read_image(tmp_path / "values.npy", **options)


def behind_filter(linear):
    """Light behind RGGB, of a reddish grey."""
    linear = linear.astype(float)
    linear[::2, ::2] *= 0.5
    linear[1::2, 1::2] *= 0.3
    return linear


def test_a_mosaic_and_a_black_level_that_the_curve_lacks_are_warned_of(tmp_path):
    pair = [BRIGHT, DARK]
    mosaic = AR0231.code(behind_filter(np.rint(scene(bright=9000.0, dark=3000.0))))
    image = labcdp.read_image(file_of(tmp_path, mosaic), encoding="AR0231")
    assert "mosaic-doubtful" in [finding.code for finding in image.findings]
    green = labcdp.read_image(tmp_path / "codes.tif", encoding="AR0231", bayer="RGGB")
    assert "mosaic-doubtful" not in [finding.code for finding in green.findings]
    mixed, alone = (each.regions(pair).cdp(2.0)["cdp"].item() for each in (image, green))
    assert (mixed, alone) == (pytest.approx(0.375, abs=0.01), 1.0)
    raised = AR0231.code(scene(bright=900.0, dark=30.0) + 168)
    for encoding, warned in (("AR0231", True), (replace(AR0231, black_value=168), False)):
        findings = labcdp.read_image(file_of(tmp_path, raised), encoding=encoding).findings
        assert ("black-level-doubtful" in [finding.code for finding in findings]) is warned


def test_a_dark_picture_of_many_bits_has_the_scale_of_the_others(tmp_path):
    means = []
    for top in (3000.0, 300_000.0):
        path = file_of(tmp_path, np.full((20, 30), top, np.uint32))
        image = labcdp.read_image(path, encoding="linear", bit_depth=20)
        assert next(finding.code for finding in image.findings) == "many-bits"
        means.append(float(np.asarray(image.luminance).mean()))
    assert means == pytest.approx([3000 / 2**20, 300_000 / 2**20])


def test_green_pixels_of_many_bits_are_selected_and_a_mosaic_is_warned_of(tmp_path):
    values = behind_filter(scene(bright=900_000.0, dark=300_000.0)).astype(np.uint32)
    path = file_of(tmp_path, values)
    assert "many-bits-mosaic" in [finding.code for finding in labcdp.read_image(path, bit_depth=20).findings]
    image = labcdp.read_image(path, bit_depth=20, bayer="RGGB", no_vignetting=True)
    assert not {"many-bits-mosaic", "option-needs-dn"} & {finding.code for finding in image.findings}
    green = (values[0::2, 1::2].astype(float) + values[1::2, 0::2]) / 2
    assert np.array_equal(np.asarray(image.luminance, dtype=float) * 2**20, green)


def test_cd_m2_of_many_bits_by_a_camera_specification_are_those_of_their_codes(tmp_path):
    linear = np.rint(scene()).astype(np.uint32)
    (tmp_path / "codes.toml").write_text(SPECIFICATION)
    (tmp_path / "linear.toml").write_text(
        SPECIFICATION.replace("adc_bits = 12", "adc_bits = 20").replace('encoding = "AR0231"', 'encoding = "linear"')
    )
    np.save(tmp_path / "linear.npy", linear)
    codes = file_of(tmp_path, AR0231.code(linear))
    many, expanded_codes = (
        labcdp.read_image(path, camera_spec=tmp_path / name, no_vignetting=True).luminance
        for path, name in ((tmp_path / "linear.npy", "linear.toml"), (codes, "codes.toml"))
    )
    step = np.where(linear > 65536, 1024, np.where(linear > 2048, 64, 1))
    per_dn = float(np.asarray(many)[0, 0]) / linear[0, 0]
    assert np.asarray(many) == pytest.approx(linear * per_dn, rel=1e-6)
    assert (np.abs(np.asarray(expanded_codes, dtype=float) / per_dn - linear) <= 0.5 * step + 1e-5 * linear).all()
    # Photons and read noise; of the codes with their rounding.
    noise = [np.asarray(map_.random_rel) * linear for map_ in (many, expanded_codes)]
    assert noise[1] == pytest.approx(np.sqrt(noise[0] ** 2 + (step**2 - 1) / 12), rel=0.05)


SPECIFICATION = (
    'name = "series"\nadc_bits = 12\nexposure_s = 0.01\nquantum_efficiency = 0.5\npixel_pitch_m = 3e-6\n'
    'f_number = 1.8\nk_dn_per_e = 1.0\nlens_transmittance = 0.9\nspectrum = "D65"\nencoding = "AR0231"\n'
)


def test_a_camera_specification_has_no_second_black_level_and_saturates_with_that_of_the_curve(tmp_path):
    path, camera = file_of(tmp_path, np.full((20, 30), 900, np.uint16)), tmp_path / "camera.toml"
    camera.write_text(SPECIFICATION + "black_dn = 168\n")
    with pytest.raises(InputError, match="black_value of the curve"):
        labcdp.read_image(path, camera_spec=camera)
    camera.write_text(SPECIFICATION + "saturation_dn = 901\n")
    for linear, is_saturated in ((900, False), (901, True)):
        path = file_of(tmp_path, np.full((20, 30), linear, np.uint16))
        curve = replace(AR0231, black_value=168)
        invalid = labcdp.read_image(path, camera_spec=camera, encoding=curve).luminance.invalid
        assert (invalid == Invalid.SATURATED).all() == is_saturated
