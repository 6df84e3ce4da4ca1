"""Vignetting without a calibration: contrasts of one scene at several places, against the truth of the scene."""

import json
from itertools import combinations
from math import hypot

import numpy as np
import pytest
import tifffile
from PIL import Image

import labcdp
from labcdp.core.errors import InputError
from labcdp.core.luminance import LuminanceMap
from labcdp.core.result import warning
from labcdp.core.roi import Roi
from labcdp.core.table import Z_95
from labcdp.core.vignetting import Cos4Vignetting
from labcdp.evaluate.picture.edges.map import contrast_map
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.files.luminance_file import save_luminance
from labcdp.regions import RectangleShape, save_regions

#: A lens of 77 degrees from corner to corner.
FOCAL_M, PITCH_M, SHAPE = 6e-3, 12e-6, (480, 640)
#: Places x, y and luminances of patches of 50 pixels: at the middle, half way, and in corners.
PATCHES = {
    "middle": (295, 215, 0.55), "beside": (225, 215, 0.4), "above": (300, 60, 0.5), "corner": (565, 20, 0.55),
    "near corner": (485, 20, 0.4), "other corner": (30, 400, 0.45),
}  # fmt: skip
ROIS = {name: Roi.rectangle(name, x, y, 50, 50) for name, (x, y, _) in PATCHES.items()}


def scene(seed=1, focal_m=FOCAL_M):
    """Light on the sensor, 1 at the end of the scale."""
    light = np.full(SHAPE, 0.3)
    for x, y, luminance in PATCHES.values():
        light[y : y + 50, x : x + 50] = luminance
    v = Cos4Vignetting(focal_m, PITCH_M).relative_illuminance(SHAPE)
    return light * v * (1 + 0.01 * np.random.default_rng(seed).normal(size=SHAPE))


def srgb(light):
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def exif_of(tags):
    exif = Image.Exif()
    exif[271] = "a camera"
    exif.get_ifd(0x8769).update(tags)
    return exif


@pytest.fixture(scope="module")
def tiff(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "a.tif"
    tifffile.imwrite(path, np.rint(65535 * scene()).astype(np.uint16))
    return path


def deviations(image):
    """Of each pair of patches, contrast less its truth over U, and that over the truth."""
    found = {}
    for a, b in combinations(PATCHES, 2):
        luminances = PATCHES[a][2], PATCHES[b][2]
        bright, dark = (a, b) if luminances[0] >= luminances[1] else (b, a)
        one = image.regions([ROIS[bright], ROIS[dark]], [(bright, dark)]).cdp()
        measured = float(one.measured_contrast[0])
        truth = max(luminances) / min(luminances) - 1
        if str(one.pair.values[0]) != f"{bright} / {dark}":
            # By the vignetting, the darker one is brighter.
            truth = 1 / (1 + truth) - 1
        found[a, b] = measured - truth, Z_95 * float(one.u_measured_contrast[0])
    return found


def test_contrasts_by_an_unknown_lens_are_within_their_uncertainty(tiff):
    found = deviations(labcdp.read_image(tiff))
    for pair, (deviation, expanded) in found.items():
        assert abs(deviation) <= expanded, pair
    # Without its part by the vignetting they would be far outside: by more than the contrast itself.
    assert max(abs(deviation) for deviation, _ in found.values()) > 0.9


@pytest.mark.parametrize("focal_m", [4.8e-3 / np.tan(np.radians(40)), 12e-3, 1.0])
def test_of_any_lens_up_to_80_degrees(tmp_path, focal_m):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.rint(65535 * scene(focal_m=focal_m)).astype(np.uint16))
    for pair, (deviation, expanded) in deviations(labcdp.read_image(path)).items():
        assert abs(deviation) <= expanded, pair


def test_focal_length_and_pixel_pitch_give_the_contrast_of_the_scene(tiff):
    found = deviations(labcdp.read_image(tiff, focal_length_m=FOCAL_M, pixel_pitch_m=PITCH_M))
    for pair, (deviation, expanded) in found.items():
        assert abs(deviation) < 0.005, pair
        assert expanded < 0.2, pair
    # Two patches of the corner are closer to each other than to the middle.
    assert found["corner", "near corner"][1] < found["middle", "corner"][1]


def test_what_exif_says_counts_and_what_is_given_before_it(tmp_path):
    exif = exif_of({37386: 6.0, 41486: 10 / 12e-3, 41488: 3})
    path = tmp_path / "a.png"
    Image.fromarray(np.rint(255 * scene()).astype(np.uint8)).save(path, exif=exif)
    by_file = labcdp.read_image(path, encoding="linear")
    by_hand = labcdp.read_image(path, encoding="linear", focal_length_m=FOCAL_M, pixel_pitch_m=PITCH_M)
    np.testing.assert_allclose(by_file.luminance.luminance_cd_m2, by_hand.luminance.luminance_cd_m2, rtol=1e-5)
    assert {one.code for one in by_file.findings} >= {"relative-luminance-cos4"}
    other = labcdp.read_image(path, encoding="linear", focal_length_m=12e-3)
    assert other.luminance.luminance_cd_m2[0, 0] < by_hand.luminance.luminance_cd_m2[0, 0]
    # By the field of 35 mm film the pixels are as large.
    exif = exif_of({37386: 6.0, 41989: 27})
    Image.fromarray(np.rint(255 * scene()).astype(np.uint8)).save(path, exif=exif)
    (facts,) = (one for one in labcdp.read_image(path).findings if one.code == "relative-luminance-cos4")
    assert facts.values["pixel_pitch_m"] == pytest.approx(6 / 27 * hypot(36e-3, 24e-3) / 800)


def test_a_developed_picture_may_be_corrected_already(tmp_path):
    """Contrasts of a camera that corrects its vignetting, and of one that does not, are both within U."""
    exif = exif_of({37386: 6.0, 41486: 10 / 12e-3, 41488: 3})
    for focal_m in (FOCAL_M, 1.0):
        path = tmp_path / "a.jpg"
        Image.fromarray(np.rint(255 * srgb(scene(focal_m=focal_m))).astype(np.uint8)).save(path, exif=exif, quality=98)
        image = labcdp.read_image(path)
        assert warning("vignetting-of-developed") in image.findings
        for pair, (deviation, expanded) in deviations(image).items():
            assert abs(deviation) <= expanded, (focal_m, pair)
    given = labcdp.read_image(path, focal_length_m=FOCAL_M)
    assert warning("vignetting-of-developed") not in given.findings


def test_without_vignetting_as_given_the_pixels_alone_decide(tiff):
    both = [labcdp.read_image(tiff, no_vignetting=True), labcdp.read_image(tiff)]
    one, other = (image.regions(list(ROIS.values())[:2]).cdp([0.375]) for image in both)
    np.testing.assert_array_equal(one.measured_contrast, other.measured_contrast)
    assert float(one.u_measured_contrast[0]) < 0.001 < float(other.u_measured_contrast[0])
    assert float((one.cdp_high - one.cdp_low)[0, 0]) < float((other.cdp_high - other.cdp_low)[0, 0])
    # Of the measured contrast itself, the vignetting changes nothing.
    one, other = (image.regions(list(ROIS.values())[:2]).cdp() for image in both)
    np.testing.assert_allclose(other.cdp_low, one.cdp_low)


def test_pictures_and_videos_have_one_uncertainty(tmp_path):
    folder, pair = tmp_path / "frames", (ROIS["middle"], ROIS["corner"])
    folder.mkdir()
    Image.fromarray(np.rint(255 * scene()).astype(np.uint8)).save(folder / "0.png")
    for stated in ({}, {"focal_length_m": FOCAL_M, "pixel_pitch_m": PITCH_M}):
        image = labcdp.read_image(folder / "0.png", encoding="linear", **stated)
        picture = image.regions(list(pair)).cdp([0.375])
        settings = VideoSettings((0.375,), pair, "fixed", encoding="linear", **stated)
        video = evaluate_video(folder, settings).isel(frame=0)
        for name in ("measured_contrast", "u_measured_contrast", "cdp_low", "cdp_high"):
            np.testing.assert_allclose(video[name].squeeze(), picture[name].squeeze(), rtol=1e-5, err_msg=name)


def test_the_contrast_of_the_first_frame_has_the_vignetting_of_the_others(tmp_path):
    folder, pair = tmp_path / "frames", (ROIS["middle"], ROIS["corner"])
    folder.mkdir()
    for number in range(2):
        Image.fromarray(np.rint(255 * scene(number)).astype(np.uint8)).save(folder / f"{number}.png")
    measured, plain = (
        evaluate_video(folder, VideoSettings(None, pair, "fixed", reference="first", no_vignetting=given))
        for given in (None, True)
    )
    for name in ("cdp_low", "cdp_high", "reference_cdp_low", "reference_cdp_high"):
        np.testing.assert_allclose(measured[name], plain[name], err_msg=name)
    given = evaluate_video(folder, VideoSettings((float(measured.contrast[0]),), pair, "fixed"))
    assert float((given.cdp_high - given.cdp_low).min()) > 10 * float((plain.cdp_high - plain.cdp_low).max())


def test_the_command_takes_lens_and_levels(tmp_path, labcdp):
    dn = 64 + np.rint(1000 * scene())
    tifffile.imwrite(tmp_path / "a.tif", dn.astype(np.uint16))
    shapes = [RectangleShape(name, x, y, 50, 50) for name, (x, y, _) in PATCHES.items()]
    save_regions(tmp_path / "rois.json", shapes)
    plain = ("image", "a.tif", "--roi", "rois.json", "--bit-depth", 12, "--json", "--force", "--no-pages")
    found = json.loads(labcdp(*plain).stdout)
    codes = {one["code"] for one in found["findings"]}
    assert {"contrasts-with-vignetting", "black-level-doubtful-pair", "relative-luminance"} <= codes
    stated = ("--focal-length", "6mm", "--pixel-pitch", "12um", "--black-level", 64)
    found = json.loads(labcdp(*plain, *stated).stdout)
    assert "relative-luminance-cos4" in {one["code"] for one in found["findings"]}
    for row in found["tables"]["cdp"]["rows"]:
        truth = PATCHES[row["bright"]][2] / PATCHES[row["dark"]][2] - 1
        assert abs(row["measured_contrast"] - truth) <= row["expanded_measured_contrast"]
    assert found["configuration"]["focal_length_m"] == pytest.approx(6e-3)
    for wrong, message in (
        (("--focal-length", "6"), "give a number above 0 with mm or um"),
        (("--pixel-pitch", "3.45mm"), r"the pixel pitch is 0.00345 m: give 1e-07 to 0.001 m"),
    ):
        assert message in labcdp(*plain, *wrong).stderr


def test_half_of_a_lens_and_one_for_luminance_are_named(tmp_path, tiff):
    half = labcdp.read_image(tiff, focal_length_m=FOCAL_M)
    assert warning("lens-incomplete", given="focal length", missing="pixel pitch") in half.findings
    five = np.full((20, 20), 5.0, np.float32)
    saved = LuminanceMap(five, np.zeros_like(five), (), np.zeros((20, 20), np.uint8))
    save_luminance(saved, tmp_path / "a.npz", {})
    image = labcdp.read_image(tmp_path / "a.npz", focal_length_m=FOCAL_M, pixel_pitch_m=PITCH_M)
    assert (np.asarray(image) == 5).all()
    assert warning("lens-ignored", given="focal length") in image.findings


def test_what_a_calibration_has_measured_is_refused(calibration, tiff):
    for stated in ({"focal_length_m": FOCAL_M}, {"no_vignetting": True}, {"black_level_dn": 3.0}):
        with pytest.raises(InputError, match="a calibration includes it"):
            labcdp.read_image(tiff, calibration=calibration, **stated)


def test_the_vignetting_of_one_camera_cancels_between_pictures(tmp_path, tiff):
    save_regions(tmp_path / "rois.json", [RectangleShape(name, x, y, 50, 50) for name, (x, y, _) in PATCHES.items()])
    path = tmp_path / "b.tif"
    tifffile.imwrite(path, np.rint(65535 * scene(2)).astype(np.uint16))
    tables = labcdp.compare(tiff, path, regions=tmp_path / "rois.json").to_dict()["tables"]
    for row in next(one for one in tables.values() if "difference" in one["rows"][0])["rows"]:
        if row["quantity"] == "contrast of middle / corner":
            # One camera loses the same light in both.
            assert abs(row["difference"]) < row["expanded_difference"] < 0.05
            break
    else:
        pytest.fail("the contrast is not compared")


def test_a_comparison_names_what_pictures_do_not_state_and_has_no_bounds(tmp_path):
    paths = []
    for seed in (1, 2):
        light = scene(seed)
        light[215:265, 295:345] = 2
        paths.append(tmp_path / f"{seed}.png")
        Image.fromarray(np.rint(255 * np.clip(light, 0, 1)).astype(np.uint8)).save(paths[-1])
    shapes = [RectangleShape(name, *PATCHES[name][:2], 50, 50) for name in ("middle", "beside", "corner")]
    save_regions(tmp_path / "rois.json", shapes)
    found = labcdp.compare(*paths, regions=tmp_path / "rois.json").to_dict()
    assert {"encoding-assumed-pair"} <= {one["code"] for one in found["findings"]}
    rows = next(one for one in found["tables"].values() if "difference" in one["rows"][0])["rows"]
    contrasts = {row["quantity"]: row["difference"] for row in rows if row["quantity"].startswith("contrast")}
    assert [value is None for name, value in contrasts.items() if "middle" in name] == [True, True]
    assert [value is None for name, value in contrasts.items() if "middle" not in name] == [False]


def test_the_edges_of_a_map_have_the_vignetting_between_their_regions(tiff):
    """As pairs of regions there have; significance and CDP are by the pixels."""
    unknown, none = (contrast_map(labcdp.read_image(tiff, no_vignetting=given).luminance) for given in (None, True))
    edges = unknown.edges
    np.testing.assert_array_equal(edges.kind, none.edges.kind)
    np.testing.assert_array_equal(edges.cdp, none.edges.cdp)
    x, y = edges.middle_px.T
    apart = np.sqrt(
        np.square(edges.contrast_standard_uncertainty) - np.square(none.edges.contrast_standard_uncertainty)
    )
    ratio_u = apart / (1 + edges.contrast)
    # Two regions of 40 pixels side by side: the slope of the logarithm of cos^4 times their distance, at the most.
    r = np.hypot(x - 320, y - 240) / 400
    t2 = np.tan(np.radians(40)) ** 2
    most = (4 * t2 * r / (1 + t2 * r**2) + 0.4) / np.sqrt(3) * 80 / 400
    known = np.isfinite(ratio_u)
    assert (ratio_u[known] <= most[known]).all()
    assert np.median(ratio_u[known & (r > 0.5)]) > 0.03
