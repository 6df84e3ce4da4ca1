import json

import cv2
import numpy as np
import pytest

from labcdp.calibration import load_any
from labcdp.regions import RectangleShape, save_regions
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
    command = ("video", drive, "--roi", rois, "--contrast", "50%:200%:50%", "--reference", "1000%")
    done = labcdp(*command, "--every", 2, "--annotated", "--frames", "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert values["output"] == "drive-cdp"
    assert (values["mode"], values["method"], values["n_frames"]) == ("regions", "kcf", 3)
    assert [one["contrast"] for one in values["contrasts"]] == [0.5, 1.0, 1.5, 2.0]
    assert {region["name"] for region in values["regions"]} == {"sign", "ground"}
    folder = drive.parent / "drive-cdp"
    names = {"results.nc", "results.json", "results.xlsx", "report.html", "annotated.mp4", "video.jsonl"}
    assert names <= {path.name for path in folder.iterdir()}
    assert len(list((folder / "drive").glob("frame-*.png"))) == 3
    again = labcdp(*command, "--every", 2, "--json")
    assert json.loads(again.stdout) == values


def test_a_video_for_a_person(labcdp, drive, rois):
    done = labcdp("video", drive, "--roi", rois, "--method", "fixed", "--stop", "80ms", "-o", "here")
    assert done.returncode == 0, done.stderr
    assert "Contrast detection probability over the frames" in done.stdout
    assert "Report: here/report.html" in done.stderr
    assert "Warning: neither calibration nor camera specification" in done.stderr


def test_several_videos_one_of_them_broken(labcdp, tmp_path, drive):
    write(tmp_path / "second.avi", 3)
    (tmp_path / "third.avi").write_bytes(b"no video")
    done = labcdp("video", tmp_path, "--neighbours", "-o", "out", "--workers", 1, "--json")
    assert done.returncode == 1
    values = json.loads(done.stdout)
    assert [one["results"] and one["results"]["n_frames"] for one in values["videos"]] == [6, 3, None]
    assert "1 of 3 videos failed" in done.stderr
    assert "third.avi is no video that OpenCV opens" in done.stderr
    alone = labcdp("video", drive, "--neighbours", "-o", "alone", "--json")
    assert json.loads(alone.stdout)["contrasts"] == values["videos"][0]["results"]["contrasts"]
    # Other settings leave what is there as it is.
    before = {path: path.read_bytes() for path in (tmp_path / "out").glob("archive.*")}
    done = labcdp("video", tmp_path, "--neighbours", "--contrast", "50%", "-o", "out")
    assert done.returncode == 1
    assert "drive holds the results of another evaluation: give another folder with --output" in done.stderr
    assert len(before) == 3
    assert {path: path.read_bytes() for path in (tmp_path / "out").glob("archive.*")} == before


def test_what_is_left_out_is_told(labcdp, tmp_path, drive):
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0.png"), np.zeros((4, 4), np.uint8))
    done = labcdp("video", tmp_path, "drive.avi", "--neighbours", "--stop", 1, "-o", "out")
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stderr.split())
    assert f"{tmp_path / 'images'} holds images and is left out, as {tmp_path} holds videos" in said
    assert f"drive.avi is the same video as {drive}, and evaluated once" in said


def test_a_full_disk_does_not_hide_which_videos_failed(labcdp, tmp_path, drive):
    (tmp_path / "third.avi").write_bytes(b"no video")
    # In the place of one of the files it cannot be written.
    (tmp_path / "out" / "archive.html").mkdir(parents=True)
    done = labcdp("video", tmp_path, "--neighbours", "--stop", 1, "-o", "out", "--workers", 1)
    assert done.returncode == 1
    assert "archive.html cannot be written" in done.stderr
    assert "third.avi is no video that OpenCV opens" in done.stderr


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
    assert values["unit"] == "cd/m^2"
    low, high = load_any(tmp_path / "made" / "calibration.json").range_cd_m2
    assert all(low / 2 < region["mean"] < 2 * high for region in values["regions"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "there are no regions: give a file with --roi (labcdp rois draws one), or --neighbours"),
        (("--roi", "three.json"), "three.json holds 3 regions (sign, ground, third): choose two with --pair A,B"),
        (("--roi", "one.json"), "one.json holds one region: draw a second one"),
        (("--roi", "three.json", "--pair", "sign,sky"), "--pair is 'sign,sky': give two of the regions"),
        (("--roi", "rois.json", "--neighbours"), "--neighbours needs no regions"),
        (("--roi", "rois.json", "--method", "magic"), "unknown tracking method 'magic'"),
        (("--roi", "rois.json", "--contrast", "1"), "--contrast is '1': give a percentage"),
        (("--roi", "rois.json", "--epsilon", "200%"), "--epsilon is '200%': give a percentage above 0%"),
        (("--roi", "rois.json", "--start", "soon"), "--start is 'soon': give a number of frames"),
        (("--roi", "rois.json", "--start", "9", "--stop", "3"), "stop 3 is not behind start 9"),
        (("--roi", "rois.json", "--start", "500"), "has no frame from 500 to its end"),
        (("--roi", "rois.json", "--reference", "none.nc"), "--reference is 'none.nc': give a contrast such as 1000%"),
        (("--roi", "rois.json", "--reference-by", "luck"), "--reference-by is 'luck': give number or time"),
        (("--roi", "rois.json", "--encoding", "log"), "--encoding is 'log': give linear or srgb"),
        (("--roi", "rois.json", "--calibration", "a.json", "--camera", "b.toml"), "give one, the calibration knows"),
        (("--roi", "rois.json", "-o", "drive.avi"), "drive.avi cannot be"),
        (("--roi", "rois.json", "--reference", "."), "--reference is '.': give a contrast such as 1000%"),
        (("--roi", "other.json"), "the regions belong to an image of 640 x 480 pixels, drive.avi has 160 x 120"),
        (("--roi", "together.json"), "regions 'sign' and 'ground' have 338 pixels in common"),
        (("--neighbours", "--contrast", "1%:121%:1%"), "121 contrasts are given: give up to 120"),
    ],
)
def test_bad_input_is_one_line(fails, drive, rois, arguments, message):
    assert message in fails("video", drive.name, *arguments)
    # Nothing is left that another evaluation minds.
    assert not [path for path in (drive.parent / "drive-cdp").glob("*") if path.name != "video.jsonl"]
    if "--reference" in arguments:
        assert not (drive.parent / "drive-cdp").exists()


def test_a_command_that_was_refused_does_not_block_its_folder(labcdp, fails, drive, rois):
    fails("video", drive, "--roi", rois, "--start", 500)
    done = labcdp("video", drive, "--roi", rois, "--method", "fixed", "--stop", 2, "--json")
    assert json.loads(done.stdout)["n_frames"] == 2


def test_the_results_of_another_evaluation_are_not_overwritten(labcdp, fails, drive, rois):
    assert labcdp("video", drive, "--roi", rois, "--method", "fixed").returncode == 0
    text = fails("video", drive, "--roi", rois)
    assert "drive-cdp holds the results of another evaluation (another settings): give another folder" in text


def test_a_missing_video(fails, rois):
    assert "missing.mp4 is no file" in fails("video", "missing.mp4", "--roi", rois)
