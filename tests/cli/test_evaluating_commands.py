"""Commands that simulate and evaluate: options reach what they are about; terminal, JSON and files say the same."""

import json
import shutil
from hashlib import sha256
from importlib.resources import files

import cv2
import numpy as np
import pytest
import tifffile
import xarray

from labcdp import compare
from labcdp.chain import Chain, preset_names
from labcdp.evaluate.sweep.run import JOURNAL
from labcdp.regions import RectangleShape, save_regions
from labcdp.session import Session, example_session

from .conftest import only_line, results_of, rows_of


def written(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} - {"labcdp-files.json"}


def test_a_preset_is_listed_and_the_same_as_a_file(labcdp, tmp_path):
    rows = rows_of(labcdp("presets", "--json"), "presets")
    assert tuple(row["name"] for row in rows) == preset_names()
    assert labcdp("init", "chain", "my.toml", "--preset", "manta-g505").returncode == 0
    # With its comments.
    assert "of the dark squares" in (tmp_path / "my.toml").read_text()
    assert Chain.load(tmp_path / "my.toml") == Chain.load("manta-g505")
    rows = rows_of(labcdp("init", "bench", "bench.toml", "--json"), "template")
    assert rows == [{"template": "bench", "next_command": "labcdp acquire bench.toml my-session --simulated"}]


def test_simulate_and_sweep_write_what_they_print(labcdp, inputs, tmp_path):
    shutil.copy(inputs / "small.toml", tmp_path)
    options = ("--seed", "3", "--contrast", "50%", "--epsilon", "40%", "--set", "exposure.exposure_s=0.001")
    done = labcdp("simulate", "small.toml", *options, "--set", "scene.contrast=20%", "--json")
    rows, folder = rows_of(done, "detection"), tmp_path / "small-simulate"
    assert (folder / "results.json").read_text() == done.stdout
    assert [row["stage"] for row in rows] == ["scene", "optics", "sensor"]
    assert [rows[2]["lowest_contrast"], rows[2]["highest_contrast"]] == [0.3, 0.7]
    assert rows[0]["scene_contrast"] == 0.2
    changed = Chain.load(tmp_path / "small.toml").with_(exposure__exposure_s=0.001, scene__contrast=0.2)
    assert Chain.load(folder / "chain.toml") == changed
    assert results_of(done)["configuration"]["chain"]["exposure"]["exposure_s"] == 0.001
    assert written(folder) == {
        *("results.json", "report.html", "results.xlsx", "chain.toml"),
        *("figures/chain-1.png", "figures/contrasts-1.png"),
        *(f"{kind}{name}.png" for name in ("scene", "optics", "sensor") for kind in ("figures/stage-", "images/")),
    }
    over = ("--over", "scene.luminance_cd_m2=1:100:4:log", "--over", "scene.contrast=20%,100%")
    values = results_of(labcdp("sweep", "small.toml", *over, "--json"))
    assert values["configuration"]["method"] == "simulated"
    assert list(values["configuration"]["axes"]) == ["scene.luminance_cd_m2", "scene.contrast"]
    folder = tmp_path / "small-sweep"
    assert written(folder) == {"map.nc", "map.png", "report.html", "results.xlsx", "results.json", JOURNAL}
    with xarray.open_dataset(folder / "map.nc") as cells:
        assert [row["cdp"] for row in values["tables"]["map"]["rows"]] == cells["cdp"].values.ravel().tolist()


def test_the_map_of_a_picture_asks_for_the_contrast_of_a_reference(labcdp, tmp_path):
    image = np.repeat([50.0, 100.0, 130.0], 100) + np.random.default_rng(0).normal(0, 2, (240, 300))
    night = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "night.png"), night)
    cv2.imwrite(str(tmp_path / "fog.png"), (night // 2 + 100).astype(np.uint8))
    command = ("image-map", "fog.png", "--region-size", 30, "--encoding", "linear", "--minimum-contrast", "5%")
    detected = []
    for more, codes in (((), {"map-of-own-contrast"}), (("--reference", "night.png"), set())):
        values = results_of(labcdp(*command, *more, "--json", "--force"))
        assert {one["code"] for one in values["findings"]} & {"map-of-own-contrast"} == codes
        found = {row["quantity"]: row["value"] for row in values["tables"]["summary"]["rows"]}
        counts = found["edges: detected"], found["edges: lost"]
        assert found["detected edges"] == counts[0] / sum(counts)
        detected.append(found["detected edges"])
    assert (values["configuration"]["region_size_px"], values["configuration"]["minimum_contrast"]) == (30, 0.05)
    # Steps of 100 % and 30 % before the fog, of 20 % and 10 % in it.
    assert values["tables"]["weakest"]["rows"][0]["asked_contrast"] > 0.25
    assert detected[0] > 0.6 > 0.1 > detected[1]
    done = labcdp(*command, "-o", "other")
    assert "The weakest edges" in done.stdout
    assert "contrast map of an image" in labcdp("info", "other/results.nc").stdout
    assert "info: no calibration or camera specification: using relative luminance" in done.stderr


def test_luminance_of_a_session_and_of_frames_that_labcdp_did_not_record(labcdp, inputs, tmp_path):
    def luminance(*arguments):
        return labcdp("luminance", inputs / "c/calibration.json", *arguments)

    example = example_session()
    result = results_of(luminance(example, "-o", "map.tif", "--preview", "map.png", "--json"))
    assert sorted(set(result["configuration"]["exposures_s"])) == [0.002, 0.008, 0.032]
    quantities = {row["quantity"]: row["value"] for row in result["tables"]["luminance"]["rows"]}
    assert quantities["valid pixels"] > 0.999
    # The brightest patch reads 414 cd/m^2 in the thesis.
    with tifffile.TiffFile(tmp_path / "map.tif") as tiff:
        values, page = tiff.pages.first.asarray(), json.loads(tiff.pages.first.description)
    assert 380 < np.quantile(values, 0.99) < 450
    assert (page["unit"], page["calibration"]["camera"][:13]) == ("cd/m^2", "Allied Vision")
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    done = luminance(example, "-o", "b.exr", "--only-exposure", "8ms")
    assert "Luminance of 2 frames at 8 ms" in done.stdout
    assert "add a shorter exposure" in done.stderr
    one = results_of(luminance(example, "-o", "one.npz", "--frame", 3, "--json"))
    assert one["configuration"]["frames"] == ["frames/0003_light_8ms.tif"]
    with Session.open(example) as session:
        dn = session.load(session.frames("light")[2]).dn
    # As another program would write it: the exposure, tag 33434, as a rational, type 5.
    tifffile.imwrite(tmp_path / "a.tif", dn, photometric="minisblack", extratags=[(33434, 5, 1, (1, 125), True)])
    result = results_of(luminance("a.tif", "-o", "a.npz", "--json"))
    assert result["configuration"]["exposures_s"] == [0.008]
    assert "does not state its camera: it is assumed" in " ".join(finding["text"] for finding in result["findings"])
    assert result["tables"]["luminance"]["rows"][0]["value"] == one["tables"]["luminance"]["rows"][0]["value"]
    assert "a.npz holds no DN, but floats" in only_line(luminance("a.npz", "-o", "c.npz"))


def test_pictures_are_compared_as_their_results_are(labcdp, inputs, tmp_path):
    shutil.copy(inputs / "a.png", tmp_path / "b.png")
    command = (inputs / "a.png", "b.png", "--roi", inputs / "rois.json", "--contrast", "100%")
    assert labcdp("image", *command, "--output", "both").returncode == 0
    done = labcdp("compare", "both", "--json")
    assert {row["differs"] for row in rows_of(done, "differences")} == {"no"}
    assert (tmp_path / "both-compare/results.json").read_text() == done.stdout
    made = {"results.json", "report.html", "results.xlsx", "figures/comparison.png"}
    assert written(tmp_path / "both-compare") == made
    assert rows_of(labcdp("compare", *command, "--json"), "differences") == rows_of(done, "differences")
    found = compare(inputs / "a.png", tmp_path / "b.png", regions=inputs / "rois.json", contrast=1.0)
    assert found.to_dict()["tables"]["differences"]["rows"] == rows_of(done, "differences")


def test_a_twin_with_a_calibration_from_a_file_whose_chain_simulates(labcdp, inputs, tmp_path):
    # Fewer patches than the session has, which are quicker.
    few = [text for i in range(1, 13) if i not in (1, 5) for text in ("--without", f"P{i:02}")]
    asked = ("--contrast", "200%", "--epsilon", "30%", "--calibration", inputs / "c/calibration.json")
    done = labcdp("twin", example_session(), "-o", "out", *asked, *few)
    assert done.returncode == 0, done.stderr
    assert "Next: labcdp simulate out/chain.toml" in done.stderr
    values = json.loads((tmp_path / "out/results.json").read_text())
    assert [one["role"] for one in values["inputs"]] == ["session", "calibration"]
    facts = {row["item"]: row["value"] for row in values["tables"]["provenance"]["rows"]}
    assert facts["SHA-256 of those of the calibration"] == "0" * 64 != facts["SHA-256 of frames and readings"]
    assert written(tmp_path / "out") == {
        *("chain.toml", "report.html", "results.xlsx", "results.json", "figures/twin.png")
    }
    rows = rows_of(labcdp("simulate", "out/chain.toml", "-o", "simulated", "--json"), "signal")
    assert {row["stage"] for row in rows} >= {"scene", "optics", "sensor"}


def write_video(path, n=6, size=(160, 120)):
    rng = np.random.default_rng(5)
    ground = cv2.GaussianBlur(rng.normal(90, 60, (size[1], size[0])), (0, 0), 2)
    flags = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25, size, flags)
    for number in range(n):
        image = ground + rng.normal(0, 2, ground.shape)
        image[40:70, 20 + 2 * number : 50 + 2 * number] = 200 + rng.normal(0, 4, (30, 30))
        image[80:110, 20:50] = 60 + rng.normal(0, 4, (30, 30))
        writer.write(np.clip(image, 0, 255).astype(np.uint8))
    writer.release()
    return path


@pytest.fixture
def drive(tmp_path):
    shapes = [RectangleShape("sign", 22, 42, 26, 26), RectangleShape("ground", 22, 82, 26, 26)]
    save_regions(tmp_path / "rois.json", shapes, (160, 120))
    return write_video(tmp_path / "drive.avi")


def test_a_video_with_all_that_can_be_asked_for(labcdp, drive):
    command = ("video", drive, "--roi", "rois.json", "--contrast", "50%:200%:4", "--reference", "1000%", "--every", 2)
    done = labcdp(*command, "--annotated", "--frames", "--json")
    values, folder = results_of(done), drive.parent / "drive-video"
    assert (values["configuration"]["mode"], values["configuration"]["method"]) == ("regions", "follow")
    assert values["tables"]["summary"]["rows"][0]["value"] == 3
    assert [one["contrast"] for one in values["tables"]["contrasts"]["rows"]] == [10.0, 0.5, 1.0, 1.5, 2.0]
    assert {region["region"] for region in values["tables"]["regions"]["rows"]} == {"sign", "ground"}
    assert (folder / "results.json").read_text() == done.stdout
    assert len(list((folder / "drive").glob("frame-*.png"))) == 3
    made = {"results.nc", "results.json", "results.xlsx", "report.html", "annotated.mp4", "video.jsonl"}
    assert made <= written(folder)
    assert f"--reference {folder / 'results.nc'}" in labcdp("info", folder / "results.nc").stderr
    assert results_of(labcdp(*command, "--json", "--force")) == values
    command = ("video", drive, "--roi", "rois.json", "--stop")
    done = labcdp(*command, "80ms", "--method", "fixed", "-o", "here")
    assert "CDP over all frames" in done.stdout
    assert "info: no contrast was given: the one measured in frame 0" in done.stderr
    camera = files("labcdp").joinpath("data/cameras/thesis-2018.toml")
    values = results_of(labcdp(*command, 2, "--camera-spec", camera, "--exposure", "5ms", "-o", "spec", "--json"))
    assert values["configuration"]["unit"] == "cd/m^2"
    (recorded,) = (one["sha256"] for one in values["inputs"] if one["role"] == "camera")
    assert recorded == sha256(camera.read_bytes()).hexdigest()


def test_several_videos_one_of_them_broken(labcdp, tmp_path, drive):
    write_video(tmp_path / "second.avi", 3)
    (tmp_path / "third.avi").write_bytes(b"no video")
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0.png"), np.zeros((4, 4), np.uint8))
    command = ("video", tmp_path, "drive.avi", "--roi", "rois.json", "--stop", 2, "-o", "out", "--contrast")
    done = labcdp(*command, "100%", "--workers", 1, "--json")
    values = results_of(done, status=1)
    assert [one["n_frames"] for one in values["tables"]["videos"]["rows"]] == [2, 2, None]
    assert "third.avi is no video that FFmpeg reads" in values["findings"][0]["text"]
    # What is left out is reported.
    said = " ".join(done.stderr.split())
    assert "1 of 3 videos failed" in said
    assert f"{tmp_path / 'images'} contains images and is left out, as {tmp_path} contains videos" in said
    assert f"drive.avi is the same video as {drive} and is evaluated once" in said
    # Other settings leave what is there as it is.
    before = {path: path.read_bytes() for path in (tmp_path / "out").glob("archive.*")}
    done = labcdp(*command, "50%")
    assert done.returncode == 1
    assert "drive holds the results of another evaluation: give another folder" in done.stderr
    assert len(before) == 3
    assert {path: path.read_bytes() for path in (tmp_path / "out").glob("archive.*")} == before
