"""Pictures to luminance: by a calibration, by guessed parameters against the simulated chain, and RELATIVE."""

import re
from dataclasses import replace
from datetime import UTC, datetime

import cv2
import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from labcdp.chain import Optics, Sensor, Windscreen
from labcdp.chain.signal import Context, scene_signal
from labcdp.core.errors import CalibrationError, ConfigurationError, InputError
from labcdp.core.frame import BlackPattern
from labcdp.core.luminance import CommonError, Invalid, LuminanceMap
from labcdp.core.result import info, warning
from labcdp.evaluate.picture.camera_specification import CameraSpecification
from labcdp.evaluate.picture.converter import make_converter
from labcdp.evaluate.picture.light_table import TableMap, make_light_table
from labcdp.files import PictureOptions, frame_of_pixels, read_picture
from labcdp.files.luminance_file import save_luminance
from labcdp.files.picture import Picture
from labcdp.files.statements import FileStatements

from ..sweep.chains import small

RELATIVE = make_converter()
NOW = datetime(2026, 1, 1, tzinfo=UTC)
#: A windscreen, a lens with vignetting and a warm sensor.
CHAIN = {
    "scene": {"width": 200, "height": 160, "square_px": 40, "luminance_cd_m2": 40.0, "contrast": 4.0},
    "windscreen": {"transmittance": 0.8, "glare_fraction": 0.25},
    "optics": {"transmittance": 0.85, "focal_length_m": 2e-3},
    "exposure": {"exposure_s": 0.004, "gain_db": 6.0, "temperature_c": 45.0},
    "sensor": {"pixel_pitch_m": 5e-6, "width": 200, "height": 160, "full_well_e": 30000.0, "k_dn_per_e": 0.12,
               "read_noise_e": 6.0, "dark_current_e_s": 10000.0, "black_level_dn": 100.0},
}  # fmt: skip
CAMERA = {
    "adc_bits": 12, "quantum_efficiency": [[379, 0.6], [781, 0.6]], "pixel_pitch_m": 5e-6, "f_number": 2.0,
    "k_dn_per_e": 0.12, "lens_transmittance": 0.85, "windscreen_transmittance": 0.8, "glare_fraction": 0.25,
    "focal_length_m": 2e-3, "black_dn": 100.0, "read_noise_e": 6.0, "dark_current_e_s": 10000.0, "temperature_c": 45.0,
    "exposure_s": 0.004, "gain_db": 6.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def truth():
    """DN of the simulated chain, and the luminance it saw."""
    run = small(**{f"{table}.{key}": value for table, one in CHAIN.items() for key, value in one.items()}).run(seed=3)
    return run["sensor"].values.astype(np.uint16), run["scene"].values


@pytest.fixture
def specified(tmp_path):
    """Make the conversion of a camera specification with some values replaced."""

    def make(encoding=None, **changes):
        lines = [f"{key} = {value}" for key, value in (CAMERA | changes).items() if value is not None]
        text = "\n".join(['name = "the same camera"\nspectrum = "monochromatic 555 nm"', *lines])
        path = tmp_path / "camera.toml"
        path.write_text(text, encoding="utf-8")
        return make_converter(None, path, encoding)

    return make


def written(path, dn):
    cv2.imwrite(str(path), dn)
    return path


# By guessed parameters


def test_the_scene_comes_back_from_the_simulated_chain(tmp_path, truth, specified):
    dn, scene = truth
    converter = specified()
    seen = converter.luminance(read_picture(written(tmp_path / "a.png", dn), converter.options))
    deviation = seen.luminance_cd_m2 / scene - 1
    for level in np.unique(scene):
        here = deviation[scene == level]
        # Noise of the mean, and glare and black level that are known to a rounding of the mean only.
        assert abs(here.mean()) < 5 * here.std() / np.sqrt(here.size) + 1e-4
    # Each pixel deviates as the noise says it may.
    assert np.std(deviation * scene / (seen.random_rel * seen.luminance_cd_m2)) == pytest.approx(1, abs=0.02)
    assert seen.valid.all()
    # Saturated and black pixels are flagged, and glare is warned of where it cannot be known.
    picture = read_picture(written(tmp_path / "b.png", np.array([[0, 50, 2000, 4095]], np.uint16)), converter.options)
    flags = specified(glare_fraction=0, dark_current_e_s=0).luminance(picture).invalid
    assert flags.tolist() == [[Invalid.BELOW_BLACK, Invalid.BELOW_BLACK, 0, Invalid.SATURATED]]
    assert warning("glare-underestimated") in converter.findings(picture)


@settings(max_examples=40)
@given(
    windscreen=st.builds(Windscreen, st.floats(0.3, 1.0), st.floats(0.0, 3.0)),
    focal_length_m=st.one_of(st.none(), st.floats(0.5e-3, 50e-3)),
    optics=st.builds(Optics, st.floats(1.0, 16.0), st.floats(0.3, 1.0), st.none(), st.floats(0.0, 0.5)),
    pitch_um=st.floats(1.0, 20.0),
    efficiency=st.floats(0.05, 1.0),
    setting=st.tuples(st.floats(-6.0, 24.0), st.floats(-20.0, 90.0)),
    black_dn=st.integers(0, 3000),
)
def test_any_camera_is_undone_but_for_rounding(
    windscreen, focal_length_m, optics, pitch_um, efficiency, setting, black_dn
):
    """The mean DN of the chain's own stages, rounded, and back."""
    optics, (gain_db, temperature_c) = replace(optics, focal_length_m=focal_length_m), setting
    sensor = Sensor(
        pixel_pitch_m=pitch_um * 1e-6, width=12, height=10, quantum_efficiency=efficiency, full_well_e=1e7,
        k_dn_per_e=1.0, read_noise_e=0.0, dark_current_e_s=50.0, bits=16, black_level_dn=float(black_dn),
    )  # fmt: skip
    scene = np.random.default_rng(1).uniform(1, 10, sensor.shape)
    context = Context("D65", pixel_pitch_m=sensor.pixel_pitch_m)
    lux = optics.process(windscreen.process(scene_signal(scene), context), context).values
    rate = sensor.electron_rate(lux, "D65")
    dark = sensor.dark_current_at(temperature_c)
    # So long that the brightest pixel comes near the end of the converter.
    k = sensor.system_gain_dn_per_e(gain_db)
    exposure_s = (60000 - black_dn) / (k * (rate.max() + dark))
    dn = np.rint(black_dn + k * (rate + dark) * exposure_s).astype(np.uint16)
    specification = CameraSpecification(
        name="any", adc_bits=16, quantum_efficiency=efficiency, pixel_pitch_m=sensor.pixel_pitch_m,
        f_number=optics.f_number, k_dn_per_e=1.0, lens_transmittance=optics.transmittance,
        windscreen_transmittance=windscreen.transmittance, glare_fraction=windscreen.glare_fraction, spectrum="D65",
        focal_length_m=optics.focal_length_m, magnification=optics.magnification, black_dn=float(black_dn),
        dark_current_e_s=50.0, temperature_c=temperature_c,
    )  # fmt: skip
    options = PictureOptions(exposure_s=exposure_s, gain_db=gain_db, bit_depth=16)
    frame = frame_of_pixels(dn, options, NOW)
    vignetting = optics.vignetting(sensor.pixel_pitch_m)
    seen = TableMap(frame, make_light_table(frame, "linear", specification, vignetting=vignetting), vignetting)
    glare = windscreen.glare_fraction
    per_dn = (scene + glare * scene.mean()) / np.maximum(dn - black_dn - k * dark * exposure_s, 1)
    np.testing.assert_array_less(np.abs(seen.luminance_cd_m2 - scene), 1.1 * per_dn + 1e-5 * (1 + glare) * scene.max())


def test_wrong_values_units_and_keys_of_a_specification_are_named(specified):
    for values, message in (
        ({"pixel_pitch_m": 3.45}, "pixel_pitch_m is 3.45 m: give a distance of pixel centres above 0 m, up to"),
        ({"quantum_efficiency": "[[900, 0.4], [950, 0.4]]"}, "quantum_efficiency is 0 wherever 'mono"),
        ({"pixel_pitch_um": 3.45}, "pixel_pitch_um is not a known key: did you mean pixel_pitch_m?"),
    ):
        with pytest.raises(ConfigurationError, match=re.escape(f"camera.toml: {message}")):
            specified(**values)


def test_what_a_file_says_counts_more_than_the_specification(tmp_path, specified):
    grey = np.full((16, 16), 100, np.uint8)
    block = Image.Exif()
    block.get_ifd(0x8769).update({0x829A: 0.008, 0x829D: 4.0, 0x8827: 200})
    Image.fromarray(grey).save(tmp_path / "stated.jpg", exif=block, quality=100)
    Image.fromarray(grey).save(tmp_path / "silent.jpg", quality=100)
    converter = specified(dark_current_e_s=0, focal_length_m=None)
    pictures = [read_picture(tmp_path / name, converter.options) for name in ("stated.jpg", "silent.jpg")]
    stated, silent = (converter.luminance(picture).luminance_cd_m2[0, 0] for picture in pictures)
    # Twice the exposure, f/4 for f/2, and the same gain: ISO 200 is 6 dB.
    assert stated / silent == pytest.approx(4 / 2, rel=0.003)


@pytest.mark.parametrize("colours", [False, True])
def test_srgb_is_undone(tmp_path, truth, specified, colours):
    dn, scene = truth
    linear = dn / 4095
    encoded = np.rint(255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055))
    encoded = encoded.astype(np.uint8)
    converter = specified(encoding="srgb")
    path = written(tmp_path / "a.png", np.dstack([encoded] * 3) if colours else encoded)
    picture = read_picture(path, converter.options)
    assert not picture.coloured
    assert converter.luminance(picture).luminance_cd_m2.mean() == pytest.approx(scene.mean(), rel=3e-3)
    assert warning("srgb-assumed") in converter.findings(picture)
    frame = frame_of_pixels(np.full((2, 2), 128, np.uint8), PictureOptions(), NOW)
    seen = make_converter(encoding="srgb").convert(frame).luminance_cd_m2
    assert seen[0, 0] == pytest.approx(((128 / 255 + 0.055) / 1.055) ** 2.4, rel=1e-6)


# Relative


def test_contrasts_hold_without_any_parameter(tmp_path):
    dn = np.array([[1000, 2000, 500]], dtype=np.uint16)
    picture = read_picture(written(tmp_path / "a.png", dn), PictureOptions(bit_depth=12))
    seen = RELATIVE.luminance(picture)
    assert (seen.luminance_cd_m2 == dn / 4096).all()
    np.testing.assert_allclose(seen.random_rel, 1 / np.sqrt(12) / dn, rtol=1e-5)
    assert RELATIVE.unit_of(picture) == "relative"
    assert {error.source for error in seen.common} == {"assumed vignetting"}
    assert RELATIVE.given(no_vignetting=True).luminance(picture).common == ()


def test_green_pixels_stand_for_a_bayer_pattern(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.arange(30, dtype=np.uint16).reshape(5, 6), photometric="minisblack")
    for pattern, green in {"RG": (1, 6), "BG": (1, 6), "GR": (0, 7), "GB": (0, 7)}.items():
        picture = read_picture(tmp_path / "a.tif", PictureOptions(pixel_format=f"Bayer{pattern}12"))
        seen = RELATIVE.luminance(picture)
        assert (seen.step, seen.shape) == (2, (2, 3))
        assert seen.luminance_cd_m2[0, 0] == sum(green) / 2 / 4096
        assert seen.luminance_cd_m2[1, 2] == (sum(green) / 2 + 16) / 4096
        # Two pixels have less noise than one.
        assert seen.random_rel[1, 2] * seen.luminance_cd_m2[1, 2] * 4096 == pytest.approx(np.sqrt(1 / 24), rel=1e-4)


# Floats


def test_floats_are_relative_unless_the_file_says_more(tmp_path, specified):
    values = np.array([[1.0, 2.5, np.nan, np.inf]], dtype=np.float32)
    np.save(tmp_path / "a.npy", values)
    picture = read_picture(tmp_path / "a.npy")
    seen = RELATIVE.luminance(picture)
    np.testing.assert_array_equal(seen.luminance_cd_m2, values)
    assert seen.invalid.tolist() == [[0, 0, Invalid.DEFECT, Invalid.DEFECT]]
    with pytest.raises(InputError, match=r"a\.npy holds floats, "):
        specified().luminance(picture)


def test_luminance_that_was_saved_needs_no_conversion(tmp_path, specified):
    values = np.full((4, 5), 7.0, np.float32)
    saved = LuminanceMap(values, values / 100, (CommonError("fit", 0.02),), np.ones((4, 5), np.uint8))
    save_luminance(saved, tmp_path / "a.npz", {})
    picture = read_picture(tmp_path / "a.npz")
    for converter, codes in ((RELATIVE, ["luminance-file"]), (specified(), ["luminance-file", "conversion-ignored"])):
        seen = converter.luminance(picture)
        assert np.array_equal(seen.luminance_cd_m2, values)
        assert (seen.common[0].relative, seen.invalid.all()) == (0.02, True)
        assert converter.unit_of(picture) == "cd/m^2"
        assert [one.code for one in converter.findings(picture)] == codes


# By a calibration


@pytest.fixture(scope="module")
def calibrated(calibration):
    return make_converter(calibration)


def test_a_calibrated_camera_measures_in_any_grey_file_as_in_its_frames(tmp_path, recorded, calibrated):
    frame = recorded.load(recorded.frames("light")[0])
    written(tmp_path / "a.png", frame.dn)
    tifffile.imwrite(tmp_path / "a.tif", frame.dn, photometric="minisblack")
    (tmp_path / "a.raw").write_bytes(frame.dn.astype("<u2").tobytes())
    assert calibrated.source(Picture(tmp_path, "", FileStatements(), frame)).findings[0] == info("camera-simulated")
    options = replace(calibrated.options, exposure_s=frame.exposure_s, size=frame.shape[::-1])
    expected = calibrated.calibration.to_luminance(frame)
    for name in ("a.png", "a.tif", "a.raw"):
        picture = read_picture(tmp_path / name, options)
        seen = calibrated.luminance(picture)
        np.testing.assert_array_equal(seen.luminance_cd_m2, expected.luminance_cd_m2)
        np.testing.assert_array_equal(seen.invalid, expected.invalid)
        assert {one.code for one in calibrated.findings(picture)} == {"camera-assumed", "exposure-assumed"}


def test_pictures_the_calibration_is_not_for_are_refused(tmp_path, recorded, calibrated):
    dn = recorded.load(recorded.frames("light")[0]).dn
    colours = np.dstack([dn // 16] * 3).astype(np.uint8) // np.uint8([1, 2, 3])
    for values, message in (
        (dn[:40, :60], r"image size of the calibration is 480 x 400 pixels, but frame 0 has 60 x 40"),
        ((dn // 16).astype(np.uint8), r"pixel format of the calibration is Mono12, but frame 0 has Mono8"),
        (colours, r".*the calibration is for sensor DN"),
    ):
        picture = read_picture(written(tmp_path / "a.png", values), calibrated.given(exposure_s=0.008).options)
        with pytest.raises(CalibrationError, match=rf"a\.png: {message}"):
            calibrated.luminance(picture)
    with pytest.raises(CalibrationError, match=r"taken with f/1\.2, the calibration is for f/"):
        calibrated.luminance(replace(picture, coloured=False, statements=replace(picture.statements, f_number=1.2)))


@pytest.mark.parametrize("colour_filter", [None, "GR"])
@pytest.mark.parametrize("with_camera", [False, True])
def test_a_pixels_own_black_level_is_taken_off_and_saturation_is_of_what_is_stored(
    specified, with_camera, colour_filter
):
    """As of the frame whose pixels all have one black level."""
    rng = np.random.default_rng(5)
    dn = rng.integers(400, 3000, (40, 60)).astype(np.uint16)
    _, pattern = BlackPattern.split(4 * rng.integers(0, 60, (3, 4)), rng.integers(-9, 9, 60), rng.integers(-9, 9, 40))
    offsets = pattern.offsets_dn(dn.shape)
    whole = replace(pattern, group=tuple(tuple(map(round, row)) for row in pattern.group), columns=(), rows=())
    plain = replace(frame_of_pixels(dn, PictureOptions(bit_depth=12), NOW), colour_filter=colour_filter)
    plain = replace(plain, black_level_dn=100.0)
    stored = replace(plain, dn=(dn + whole.offsets_dn(dn.shape)).astype(np.uint16), black_pattern=whole)
    converter = specified() if with_camera else RELATIVE
    one, other = converter.convert(plain), converter.convert(stored)
    np.testing.assert_allclose(other.luminance_cd_m2, one.luminance_cd_m2, rtol=2e-5)
    np.testing.assert_allclose(other.random_rel, one.random_rel, rtol=1e-3)
    part = converter.convert(stored, (slice(4, 9), slice(2, 7)))
    np.testing.assert_array_equal(part.luminance_cd_m2, other.luminance_cd_m2[4:9, 2:7])
    # Of fractions the light is between that of two DN.
    light = converter.convert(replace(plain, black_pattern=pattern)).luminance_cd_m2
    if colour_filter is None and not with_camera:
        np.testing.assert_allclose(light, (dn - offsets - 100.0) / 4096, rtol=1e-4)
    full = replace(stored, dn=np.full_like(dn, 4094), saturation_dn=4095.0)
    assert not (converter.convert(full).invalid & Invalid.SATURATED).any()
