"""Commands that simulate and evaluate: options reach what they are about; terminal, JSON and files say the same."""

import json
import shutil
from hashlib import sha256
from importlib.resources import files

import cv2
import numpy as np
import pytest
import tifffile
from openpyxl import load_workbook

from labcdp import compare
from labcdp.chain import Chain
from labcdp.regions import RectangleShape, save_regions
from labcdp.session import Session, example_session

from ..chain.test_lamp_scene import DOCUMENT
from ..evaluate.video.videos import driving, write
from .conftest import results_of, rows_of


def test_simulate_writes_the_chain_that_it_has_changed(labcdp, inputs, tmp_path):
    shutil.copy(inputs / "small.toml", tmp_path)
    options = ("--seed", "3", "--contrast", "50%,100%", "--epsilon", "40%", "--set", "exposure.exposure_s=0.001")
    done = labcdp("simulate", "small.toml", *options, "--set", "scene.contrast=20%", "--json")
    rows, folder = rows_of(done, "detection"), tmp_path / "small-simulate"
    assert [(row["lowest_contrast"], row["highest_contrast"]) for row in rows[-2:]] == [(0.3, 0.7), (0.6, 1.4)]
    assert rows[0]["scene_contrast"] == 0.2
    changed = Chain.load(tmp_path / "small.toml").with_(exposure__exposure_s=0.001, scene__contrast=0.2)
    assert Chain.load(folder / "chain.toml") == changed


def test_the_map_of_a_picture_asks_for_the_contrast_of_a_reference(labcdp, tmp_path):
    """Steps of 100 % and 30 % before the fog, of 20 % and 10 % in it."""
    image = np.repeat([50.0, 100.0, 130.0], 100) + np.random.default_rng(0).normal(0, 2, (240, 300))
    night = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "night.png"), night)
    cv2.imwrite(str(tmp_path / "fog.png"), (night // 2 + 100).astype(np.uint8))
    command = ("image-map", "fog.png", "--region-size", 30, "--encoding", "linear", "--minimum-contrast", "5%")
    for reference, detected, contrast in (((), 1, (0.1, 0.2)), (("--reference", "night.png"), 0, (0.3, 1.0))):
        done = labcdp(*command, *reference, "--json", "--force")
        found = {row["quantity"]: row["value"] for row in rows_of(done, "summary")}
        assert found["detected edges"] == pytest.approx(detected, abs=0.4)
        for row in rows_of(done, "weakest"):
            assert min(abs(row["asked_contrast"] / np.array(contrast) - 1)) < 0.2


def test_luminance_of_a_session_and_of_frames_that_labcdp_did_not_record(labcdp, inputs, tmp_path):
    def luminance(*arguments):
        return labcdp("luminance", inputs / "c/calibration.json", *arguments)

    example = example_session()
    result = results_of(luminance(example, "-o", "map.tif", "--json"))
    assert sorted(set(result["configuration"]["exposures_s"])) == [0.002, 0.008, 0.032]
    # The brightest patch reads 414 cd/m^2 in the thesis.
    with tifffile.TiffFile(tmp_path / "map.tif") as tiff:
        values, page = tiff.pages.first.asarray(), json.loads(tiff.pages.first.description)
    assert 380 < np.quantile(values, 0.99) < 450
    assert (page["unit"], page["calibration"]["camera"][:13]) == ("cd/m^2", "Allied Vision")
    one = results_of(luminance(example, "-o", "one.npz", "--frame", 3, "--json"))
    assert one["configuration"]["frames"] == ["frames/0003_light_8ms.tif"]
    with Session.open(example) as session:
        dn = session.load(session.frames("light")[2]).dn
    # As another program would write it: the exposure, tag 33434, as a rational, type 5.
    tifffile.imwrite(tmp_path / "a.tif", dn, photometric="minisblack", extratags=[(33434, 5, 1, (1, 125), True)])
    result = results_of(luminance("a.tif", "-o", "a.npz", "--json"))
    assert result["configuration"]["exposures_s"] == [0.008]
    assert result["tables"]["luminance"]["rows"][0]["value"] == one["tables"]["luminance"]["rows"][0]["value"]
    warm = results_of(luminance("a.tif", "-o", "b.npz", "--temperature", "60", "--json"))
    new = {one["code"] for one in warm["findings"]} - {one["code"] for one in result["findings"]}
    assert new == {"temperature-not-covered"}
    assert luminance(example, "-o", "c.npz", "--temperature", "9").returncode == 1
    rows = {row["quantity"]: row for row in result["tables"]["luminance"]["rows"]}
    parts = [rows[f"U of a pixel, {part}"]["value"] for part in ("independent", "common")]
    expanded = next(value for name, value in rows["a pixel"].items() if name.startswith("expanded"))
    assert expanded / rows["a pixel"]["value"] == pytest.approx(np.hypot(*parts), rel=1e-3)


def test_pictures_are_compared_as_their_results_are(labcdp, inputs, tmp_path):
    shutil.copy(inputs / "a.png", tmp_path / "b.png")
    command = (inputs / "a.png", "b.png", "--roi", inputs / "rois.json", "--contrast", "100%")
    assert labcdp("image", *command, "--output", "both").returncode == 0
    done = labcdp("compare", "both", "--json")
    assert {row["differs"] for row in rows_of(done, "differences")} == {"no"}
    assert rows_of(labcdp("compare", *command, "--json"), "differences") == rows_of(done, "differences")
    found = compare(inputs / "a.png", tmp_path / "b.png", regions=inputs / "rois.json", contrast=1.0)
    assert found.to_dict()["tables"]["differences"]["rows"] == rows_of(done, "differences")


def test_a_twin_with_a_calibration_from_a_file_whose_chain_simulates(labcdp, inputs, tmp_path):
    # Fewer patches than the session has, which are quicker.
    few = [text for i in range(1, 13) if i not in (1, 5) for text in ("--without", f"P{i:02}")]
    asked = ("--contrast", "100%,200%", "--epsilon", "30%", "--calibration", inputs / "c/calibration.json")
    done = labcdp("twin", example_session(), "-o", "out", *asked, *few)
    assert done.returncode == 0, done.stderr
    values = json.loads((tmp_path / "out/results.json").read_text())
    assert {row["target_contrast"] for row in values["tables"]["pairs"]["rows"]} >= {1.0, 2.0}
    facts = {row["item"]: row["value"] for row in values["tables"]["provenance"]["rows"]}
    assert facts["SHA-256 of those of the calibration"] == "0" * 64 != facts["SHA-256 of frames and readings"]
    rows = rows_of(labcdp("simulate", "out/chain.toml", "-o", "simulated", "--json"), "signal")
    assert {row["stage"] for row in rows} >= {"scene", "optics", "sensor"}


def test_a_single_reading_is_left_out_by_its_number(labcdp):
    session = Session.open(example_session())
    n = sum(one.patch == "P01" for one in session.readings())
    done = labcdp("calibrate", session.path, "--without", "P01:1", "-o", "fewer", "--json")
    (row,) = [one for one in rows_of(done, "calibration_patches") if one["patch"] == "P01"]
    assert row["n_readings"] == n - 1
    for asked, why in ((f"P01:{n + 1}", f"patch 'P01' has {n}"), ("P99:1", "no patch 'P99'"), ("P01:x", "no reading")):
        done = labcdp("calibrate", session.path, "--without", asked, "-o", "none")
        assert done.returncode == 1
        assert why in done.stderr


@pytest.fixture
def drive(tmp_path):
    shapes = [RectangleShape("sign", 22, 42, 26, 26), RectangleShape("ground", 22, 82, 26, 26)]
    save_regions(tmp_path / "rois.json", shapes, (160, 120))
    return write(tmp_path / "drive.avi", driving(6, 2, 2.0), "MJPG")


def test_a_video_with_all_that_can_be_asked_for(labcdp, drive):
    command = ("video", drive, "--roi", "rois.json", "--contrast", "50%:200%:4", "--reference", "1000%", "--every", 2)
    done = labcdp(*command, "--annotated", "--frames", "--json")
    values, folder = results_of(done), drive.parent / "drive-video"
    assert values["tables"]["summary"]["rows"][0]["value"] == 3
    assert [one["contrast"] for one in values["tables"]["contrasts"]["rows"]] == [10.0, 0.5, 1.0, 1.5, 2.0]
    assert len(list((folder / "drive").glob("frame-*.png"))) == 3
    assert (folder / "annotated.mp4").exists()
    assert results_of(labcdp(*command, "--json", "--force")) == values
    command = ("video", drive, "--roi", "rois.json", "--stop")
    camera = files("labcdp").joinpath("data/cameras/thesis-2018.toml")
    values = results_of(labcdp(*command, 2, "--camera-spec", camera, "--exposure", "5ms", "-o", "spec", "--json"))
    assert values["configuration"]["unit"] == "cd/m^2"
    (recorded,) = (one["sha256"] for one in values["inputs"] if one["role"] == "camera")
    assert recorded == sha256(camera.read_bytes()).hexdigest()


def test_several_videos_one_of_them_broken(labcdp, tmp_path, drive):
    write(tmp_path / "second.avi", driving(3, 2, 2.0), "MJPG")
    (tmp_path / "third.avi").write_bytes(b"no video")
    command = ("video", tmp_path, "drive.avi", "--roi", "rois.json", "--stop", 2, "-o", "out", "--contrast")
    done = labcdp(*command, "100%", "--workers", 1, "--json")
    values = results_of(done, status=1)
    assert [one["n_frames"] for one in values["tables"]["videos"]["rows"]] == [2, 2, None]
    assert f"drive.avi is the same video as {drive} and is evaluated once" in " ".join(done.stderr.split())


def test_true_and_false_are_set(labcdp):
    """A veil of 20 cd/m2 over dark squares of 20 cd/m2 halves the contrast, unless it is subtracted."""
    command = ("simulate", "split-pixel", "--exact", "--force", "--set", "windscreen.glare_cd_m2=20", "--json")
    for subtracted, contrast in (("false", 0.5), ("true", 1.0)):
        rows = rows_of(labcdp(*command, "--set", f"windscreen.glare_subtracted={subtracted}"), "detection")
        assert rows[-1]["mean_contrast"] == pytest.approx(contrast, rel=0.01)


def test_a_session_is_evaluated_with_the_calibration_beside_it(labcdp, inputs, tmp_path):
    shutil.copytree(inputs / "s", tmp_path / "bench" / "day")
    shutil.copytree(inputs / "c", tmp_path / "bench" / "day-calibrate")
    done = labcdp("evaluate", "bench/day", "--json")
    calibrations = [one["path"] for one in results_of(done)["inputs"] if one["role"] == "calibration"]
    assert calibrations == [str(tmp_path / "bench" / "day-calibrate" / "calibration.json")]


@pytest.mark.parametrize(("contrast", "status"), [("95%", 0), ("2%", 3)])
def test_chains_are_judged_by_a_requirement(labcdp, inputs, tmp_path, contrast, status):
    for name in ("a.toml", "b.toml"):
        shutil.copy(inputs / "small.toml", tmp_path / name)
    text = f'contrast = "{contrast}"\nluminance_cd_m2 = [10.0, 20.0]\ncdp_limit = "60%"\n'
    (tmp_path / "requirement.toml").write_text(text)
    done = labcdp("compare", "a.toml", "b.toml", "--require", "requirement.toml", "--json")
    rows = results_of(done, status)["tables"]["requirement"]["rows"]
    assert [row["verdict"] for row in rows] == ["not met" if status else "met"] * 2
    assert [row["margin"] for row in rows] == [row["cdp"] - 0.6 for row in rows]
    assert done.stderr.count("Requirement not met: a.toml, b.toml") == (status > 0)
    assert "verdict" in (tmp_path / "a-compare" / "report.html").read_text()


#: Regions of 60 and 160 DN have a contrast of 167 %; the CDP of the patches, of 78 %, is between 70 and 90 %.
SEEN = {
    "image": ("a.png", "b.png", "--roi", "rois.json", "--encoding", "linear"),
    "video": ("a.avi", "--roi", "rois.json", "--encoding", "linear"),
    "evaluate": ("s", "--calibration", "c/calibration.json", "--pair", "P02:P01"),
}
ASKED = {
    "image": [("167%", "60%"), ("20%", "60%")],
    "video": [("167%", "60%"), ("20%", "60%")],
    "evaluate": [("80%", "60%"), ("80%", "95%")],
}


@pytest.fixture
def seen(inputs, tmp_path):
    """Inputs in the working folder, and a function that writes a requirement."""
    for name in ("a.png", "a.avi", "rois.json"):
        shutil.copy(inputs / name, tmp_path)
    # Another file, of nearly the same contrast.
    cv2.imwrite(str(tmp_path / "b.png"), cv2.imread(str(tmp_path / "a.png"))[:, :, 0] + 1)
    for name in ("s", "c"):
        shutil.copytree(inputs / name, tmp_path / name)

    def write_requirement(contrast, **more):
        values = {"contrast": contrast, "luminance_cd_m2": [0.1, 1000.0], "cdp_limit": "60%", **more}
        (tmp_path / "requirement.toml").write_text(
            "\n".join(f"{key} = {json.dumps(one)}" for key, one in values.items())
        )

    return write_requirement


@pytest.mark.parametrize("command", SEEN)
@pytest.mark.parametrize("status", [0, 3])
def test_pictures_videos_and_sessions_are_judged_by_the_same_file(labcdp, seen, tmp_path, command, status):
    contrast, limit = ASKED[command][status > 0]
    seen(contrast, cdp_limit=limit, temperature_c=60.0)
    done = labcdp(command, *SEEN[command], "--require", "requirement.toml", "-o", "out", "--json")
    values = results_of(done, status)
    (row,) = values["tables"]["requirement"]["rows"]
    assert row["verdict"] == ("not met" if status else "met")
    assert row["limit"] == ("measured contrast" if contrast == "20%" else "scatter of the pixels")
    assert row["margin"] == pytest.approx(row["cdp"] - float(limit[:-1]) / 100)
    assert "requirement-temperature" in [one["code"] for one in values["findings"]]
    assert ("Requirement not met" in done.stderr) == (status > 0)
    # The limit of the requirement is that of every other verdict.
    name = {"image": "cdp", "video": "contrasts", "evaluate": "contrasts"}[command]
    assert {one["cdp_limit"] for one in values["tables"][name]["rows"]} == {float(limit[:-1]) / 100}
    assert "limited by" in (tmp_path / "out" / "report.html").read_text()
    assert "requirement" in load_workbook(tmp_path / "out" / "results.xlsx").sheetnames


@pytest.mark.parametrize("option", [("--contrast", "50%"), ("--epsilon", "30%"), ("--cdp-limit", "0.8")])
@pytest.mark.parametrize("command", ["image", "video"])
def test_a_requirement_and_what_it_sets_exclude_each_other(labcdp, seen, command, option):
    seen("160%")
    done = labcdp(command, *SEEN[command], "--require", "requirement.toml", *option)
    assert done.returncode == 1
    assert option[0] in done.stderr


def test_several_videos_are_judged_together(labcdp, seen, tmp_path):
    seen("20%")
    shutil.copy(tmp_path / "a.avi", tmp_path / "b.avi")
    with (tmp_path / "b.avi").open("ab") as file:
        file.write(b"\0\0")
    command = ("video", "a.avi", "b.avi", "--roi", "rois.json", "-o", "out", "--workers", 1, "--json")
    values = results_of(labcdp(*command, "--require", "requirement.toml"), 3)
    rows = values["tables"]["requirement"]["rows"]
    assert [(row["video"], row["verdict"]) for row in rows] == [("a", "not met"), ("b", "not met")]


def test_the_flicker_of_a_video(labcdp, drive):
    command = ("video", drive, "--roi", "rois.json", "--flicker", "--method", "fixed")
    done = labcdp(*command, "--off-frames", "0:2", "--flicker-tolerance", "5%", "--json")
    rows = rows_of(done, "flicker")
    assert [row["region"] for row in rows] == ["sign", "ground"]
    assert rows[0]["n_evaluated"] == 4
    assert (drive.parent / "drive-video" / "report.html").exists()
    for more, why in (
        (("--flicker", "--pair", "sign:ground"), "--flicker compares no regions: leave --pair out"),
        (("--off-frames", "0:2"), "need --flicker"),
        (("--flicker", "--off-frames", "x"), "--off-frames is 'x': give first frame and the one after the last"),
    ):
        done = labcdp("video", drive, "--roi", "rois.json", *more, "-o", "none")
        assert done.returncode == 1
        assert why in " ".join(done.stderr.split())


def test_the_flicker_of_several_videos(labcdp, drive, tmp_path):
    shutil.copy(drive, tmp_path / "b.avi")
    with (tmp_path / "b.avi").open("ab") as file:
        file.write(b"\0\0")
    command = ("video", drive, "b.avi", "--roi", "rois.json", "--flicker", "--method", "fixed", "-o", "out")
    values = results_of(labcdp(*command, "--workers", 1, "--json"))
    videos = values["tables"]["videos"]["rows"]
    expected = [("drive", 2, False), ("b", 2, False)]
    assert [(row["video"], row["n_regions"], row["resumed"]) for row in videos] == expected
    regions = values["tables"]["flicker"]["rows"]
    assert [(row["video"], row["region"]) for row in regions] == [
        (video, region) for video in ("drive", "b") for region in ("sign", "ground")
    ]
    assert videos[0]["fmi"] == max(row["fmi"] for row in regions[:2])
    assert (tmp_path / "out" / "archive.html").exists()
    assert (tmp_path / "out" / "b" / "report.html").exists()
    # What is finished is not done again.
    again = results_of(labcdp(*command, "--workers", 1, "--json"))
    assert [row["resumed"] for row in again["tables"]["videos"]["rows"]] == [True, True]


def test_the_flicker_of_a_session(labcdp, inputs, tmp_path):
    command = ("evaluate", inputs / "s", "--calibration", inputs / "c" / "calibration.json")
    done = labcdp(*command, "--flicker", "--flicker-tolerance", "5%", "-o", "out", "--json")
    rows = rows_of(done, "flicker")
    # Two frames of each exposure say little.
    assert {(row["n_evaluated"], row["few_phases"]) for row in rows} == {(2, 1)}
    assert len({row["exposure_s"] for row in rows}) == 3
    assert (tmp_path / "out" / "figures" / "over-time.png").exists()
    assert "Flicker of the patches" in (tmp_path / "out" / "report.html").read_text()
    done = labcdp(*command, "--lamp-frequency", "90Hz", "-o", "none")
    assert (done.returncode, (tmp_path / "none").exists()) == (1, False)
    assert "need --flicker: give it" in done.stderr


def test_a_map_of_flicker(labcdp, tmp_path):
    Chain.from_document(DOCUMENT, "lamp").save(tmp_path / "lamp.toml")
    done = labcdp("sweep", "lamp.toml", "--flicker", "--over", "exposure.exposure_s=0.001,0.011", "--json")
    assert [row["mmp"] < 0.5 for row in rows_of(done, "flicker")] == [True, False]
    assert (tmp_path / "lamp-sweep" / "figures" / "map.png").exists()
