import json
from hashlib import sha256
from importlib.resources import files

import cv2
import numpy as np
import pytest
from jsonschema import Draft202012Validator

from labcdp.calibration import load_any
from labcdp.regions import RectangleShape, save_regions
from labcdp.report.envelope import schema
from labcdp.session import Session, example_session


def write(path, n=6, size=(160, 120)):
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


def rows(values, table):
    return values["tables"][table]["rows"]


@pytest.fixture
def drive(tmp_path):
    return write(tmp_path / "drive.avi")


@pytest.fixture
def rois(tmp_path):
    shapes = [RectangleShape("sign", 22, 42, 26, 26), RectangleShape("ground", 22, 82, 26, 26)]
    save_regions(tmp_path / "rois.json", shapes, (160, 120))
    save_regions(tmp_path / "three.json", [*shapes, RectangleShape("third", 100, 10, 20, 20)])
    save_regions(tmp_path / "one.json", shapes[:1])
    save_regions(tmp_path / "other.json", shapes, (640, 480))
    save_regions(tmp_path / "together.json", [shapes[0], RectangleShape("ground", 22, 55, 26, 26)])
    return tmp_path / "rois.json"


def test_a_video_with_all_that_can_be_asked_for(labcdp, drive, rois):
    command = ("video", drive, "--roi", rois, "--contrast", "50%:200%:4", "--reference", "1000%")
    done = labcdp(*command, "--every", 2, "--annotated", "--frames", "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(values)
    assert (values["configuration"]["mode"], values["configuration"]["method"]) == ("regions", "follow")
    assert rows(values, "summary")[0]["value"] == 3
    assert [one["contrast"] for one in rows(values, "contrasts")] == [10.0, 0.5, 1.0, 1.5, 2.0]
    assert {region["region"] for region in rows(values, "regions")} == {"sign", "ground"}
    folder = drive.parent / "drive-video"
    assert (folder / "results.json").read_text() == done.stdout
    names = {"results.nc", "results.json", "results.xlsx", "report.html", "annotated.mp4", "video.jsonl"}
    assert names <= {path.name for path in folder.iterdir()}
    assert len(list((folder / "drive").glob("frame-*.png"))) == 3
    again = labcdp(*command, "--every", 2, "--json", "--force")
    assert json.loads(again.stdout) == values


def test_a_video_for_a_person(labcdp, drive, rois):
    done = labcdp("video", drive, "--roi", rois, "--method", "fixed", "--stop", "80ms", "-o", "here")
    assert done.returncode == 0, done.stderr
    assert "CDP over all frames" in done.stdout
    assert "Report: here/report.html" in done.stderr
    assert "info: no contrast was given: the one measured in frame 0" in done.stderr
    assert "the encoding is correct" in done.stderr


def test_a_video_with_a_camera_specification(labcdp, drive, rois):
    camera = files("labcdp").joinpath("data/cameras/thesis-2018.toml")
    done = labcdp("video", drive, "--roi", rois, "--camera-spec", camera, "--exposure", "5ms", "--stop", 2, "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert values["configuration"]["unit"] == "cd/m^2"
    (recorded,) = (one["sha256"] for one in values["inputs"] if one["role"] == "camera")
    assert recorded == sha256(camera.read_bytes()).hexdigest()


def test_several_videos_one_of_them_broken(labcdp, tmp_path, drive):
    write(tmp_path / "second.avi", 3)
    (tmp_path / "third.avi").write_bytes(b"no video")
    done = labcdp("video", tmp_path, "--neighbours", "--contrast", "100%", "-o", "out", "--workers", 1, "--json")
    assert done.returncode == 1
    values = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(values)
    assert [one["n_frames"] for one in rows(values, "videos")] == [6, 3, None]
    assert "third.avi is no video that FFmpeg reads" in values["findings"][0]["text"]
    assert "1 of 3 videos failed" in done.stderr
    alone = labcdp("video", drive, "--neighbours", "--contrast", "100%", "-o", "alone", "--json")
    assert {"video": "drive", **rows(json.loads(alone.stdout), "contrasts")[0]} == rows(values, "contrasts")[0]
    # Other settings leave what is there as it is.
    before = {path: path.read_bytes() for path in (tmp_path / "out").glob("archive.*")}
    done = labcdp("video", tmp_path, "--neighbours", "--contrast", "50%", "-o", "out")
    assert done.returncode == 1
    assert "drive holds the results of another evaluation: give another folder with --output" in done.stderr
    assert len(before) == 3
    assert {path: path.read_bytes() for path in (tmp_path / "out").glob("archive.*")} == before


def test_several_pairs_are_as_each_alone(labcdp, drive, rois):
    asked = ("--roi", "three.json", "--contrast", "50%,200%", "--method", "fixed,sign=follow", "--json")
    pairs = {"sign:ground": "drive-1-sign-ground", "third:ground": "drive-2-third-ground"}
    told = [word for pair in pairs for word in ("--pair", pair)]
    done = labcdp("video", drive, *asked, *told, "-o", "all")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(values)
    assert [row["video"] for row in rows(values, "videos")] == list(pairs.values())
    for number, (pair, folder) in enumerate(pairs.items()):
        alone = labcdp("video", drive, *asked, "--pair", pair, "-o", f"alone-{number}")
        assert alone.returncode == 0, alone.stderr
        expected = [{"video": folder, **row} for row in rows(json.loads(alone.stdout), "contrasts")]
        assert [row for row in rows(values, "contrasts") if row["video"] == folder] == expected
        assert (drive.parent / "all" / folder / "report.html").exists()
    # Nothing is left to do; other pairs have another folder.
    again = labcdp("video", drive, *asked, *told, "-o", "all")
    assert all(row["resumed"] for row in rows(json.loads(again.stdout), "videos"))


def test_what_is_left_out_is_reported(labcdp, tmp_path, drive):
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0.png"), np.zeros((4, 4), np.uint8))
    done = labcdp("video", tmp_path, "drive.avi", "--neighbours", "--contrast", "100%", "--stop", 1, "-o", "out")
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stderr.split())
    assert f"{tmp_path / 'images'} contains images and is left out, as {tmp_path} contains videos" in said
    assert f"drive.avi is the same video as {drive} and is evaluated once" in said


def test_a_session_with_its_calibration(labcdp, tmp_path):
    with Session.open(example_session()) as session:
        patches = [patch.region() for patch in session.configuration.target.patches][:2]
    shapes = []
    for region in patches:
        x0, y0, x1, y1 = region.bounds
        shapes.append(RectangleShape(region.name, x0, y0, x1 - x0, y1 - y0))
    save_regions(tmp_path / "patches.json", shapes)
    assert labcdp("calibrate", example_session(), "-o", "made").returncode == 0
    done = labcdp(
        *("video", example_session(), "--roi", "patches.json", "--method", "fixed", "-o", "out", "--json"),
        *("--calibration", "made/calibration.json"),
    )
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert values["configuration"]["unit"] == "cd/m^2"
    low, high = load_any(tmp_path / "made" / "calibration.json").range_cd_m2
    assert all(low / 2 < region["mean"] < 2 * high for region in rows(values, "regions"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "no regions given: give a file with --roi (see labcdp rois), or --neighbours"),
        (
            ("--roi", "three.json"),
            "three.json holds 3 regions (sign, ground, third): choose pairs with --pair",
        ),
        (("--roi", "rois.json", "--neighbours"), "--neighbours needs no regions"),
        (("--roi", "rois.json", "--method", "magic"), "unknown tracking method 'magic'"),
        (("--roi", "rois.json", "--contrast", "1"), "--contrast is '1': give a percentage"),
        (("--roi", "rois.json", "--start", "500"), "has no frame from 500 to its end"),
        (("--roi", "rois.json", "--reference", "none.nc"), "--reference is 'none.nc': give a contrast such as 1000%"),
        (
            ("--roi", "rois.json", "--calibration", "a.json", "--camera-spec", "b.toml"),
            "are given: give one",
        ),
        (("--roi", "other.json"), "the regions belong to an image of 640 x 480 pixels, drive.avi has 160 x 120"),
        (("--roi", "together.json"), "regions 'sign' and 'ground' have 338 pixels in common"),
    ],
)
def test_bad_input_is_one_line(fails, drive, rois, arguments, message):
    assert message in fails("video", drive.name, *arguments)
    # Nothing is left that another evaluation minds.
    assert not [path for path in (drive.parent / "drive-video").glob("*") if path.name != "video.jsonl"]
    if "--reference" in arguments:
        assert not (drive.parent / "drive-video").exists()
