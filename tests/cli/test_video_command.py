from hashlib import sha256
from importlib.resources import files

import cv2
import numpy as np
import pytest

from labcdp.regions import RectangleShape, save_regions

from .conftest import results_of


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
    shapes = [RectangleShape("sign", 22, 42, 26, 26), RectangleShape("ground", 22, 82, 26, 26)]
    save_regions(tmp_path / "rois.json", shapes, (160, 120))
    return write(tmp_path / "drive.avi")


def test_a_video_with_all_that_can_be_asked_for(labcdp, drive):
    command = ("video", drive, "--roi", "rois.json", "--contrast", "50%:200%:4", "--reference", "1000%", "--every", 2)
    done = labcdp(*command, "--annotated", "--frames", "--json")
    values, folder = results_of(done), drive.parent / "drive-video"
    assert (values["configuration"]["mode"], values["configuration"]["method"]) == ("regions", "follow")
    assert values["tables"]["summary"]["rows"][0]["value"] == 3
    assert [one["contrast"] for one in values["tables"]["contrasts"]["rows"]] == [10.0, 0.5, 1.0, 1.5, 2.0]
    assert {region["region"] for region in values["tables"]["regions"]["rows"]} == {"sign", "ground"}
    assert (folder / "results.json").read_text() == done.stdout
    names = {"results.nc", "results.json", "results.xlsx", "report.html", "annotated.mp4", "video.jsonl"}
    assert names <= {path.name for path in folder.iterdir()}
    assert len(list((folder / "drive").glob("frame-*.png"))) == 3
    assert results_of(labcdp(*command, "--json", "--force")) == values


def test_a_video_for_a_person_and_with_a_camera_specification(labcdp, drive):
    command = ("video", drive, "--roi", "rois.json", "--stop")
    done = labcdp(*command, "80ms", "--method", "fixed", "-o", "here")
    assert done.returncode == 0, done.stderr
    assert "CDP over all frames" in done.stdout
    assert "Report: here/report.html" in done.stderr
    assert "info: no contrast was given: the one measured in frame 0" in done.stderr
    assert "the encoding is correct" in done.stderr
    camera = files("labcdp").joinpath("data/cameras/thesis-2018.toml")
    values = results_of(labcdp(*command, 2, "--camera-spec", camera, "--exposure", "5ms", "--json"))
    assert values["configuration"]["unit"] == "cd/m^2"
    (recorded,) = (one["sha256"] for one in values["inputs"] if one["role"] == "camera")
    assert recorded == sha256(camera.read_bytes()).hexdigest()


def test_several_videos_one_of_them_broken(labcdp, tmp_path, drive):
    write(tmp_path / "second.avi", 3)
    (tmp_path / "third.avi").write_bytes(b"no video")
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0.png"), np.zeros((4, 4), np.uint8))
    command = ("video", tmp_path, "drive.avi", "--neighbours", "-o", "out", "--contrast")
    done = labcdp(*command, "100%", "--workers", 1, "--json")
    values = results_of(done, status=1)
    assert [one["n_frames"] for one in values["tables"]["videos"]["rows"]] == [6, 3, None]
    assert "third.avi is no video that FFmpeg reads" in values["findings"][0]["text"]
    assert "1 of 3 videos failed" in done.stderr
    # What is left out is reported.
    said = " ".join(done.stderr.split())
    assert f"{tmp_path / 'images'} contains images and is left out, as {tmp_path} contains videos" in said
    assert f"drive.avi is the same video as {drive} and is evaluated once" in said
    # Other settings leave what is there as it is.
    before = {path: path.read_bytes() for path in (tmp_path / "out").glob("archive.*")}
    done = labcdp(*command, "50%")
    assert done.returncode == 1
    assert "drive holds the results of another evaluation: give another folder with --output" in done.stderr
    assert len(before) == 3
    assert {path: path.read_bytes() for path in (tmp_path / "out").glob("archive.*")} == before
