"""The samples that a command writes: their contrast is the one they were computed with."""

import pytest

from labcdp import open_video, read_image
from labcdp.evaluate.samples import FRAMES, sample_files


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("samples")
    for name, data in sample_files().items():
        (folder / name).write_bytes(data)
    return folder


def test_the_picture_has_its_contrast_and_states_its_encoding(folder):
    image = read_image(folder / "night.png")
    found = image.regions(folder / "rois.json").cdp(1.0)
    contrast, u = float(found.measured_contrast.squeeze()), float(found.u_measured_contrast.squeeze())
    assert contrast == pytest.approx(6.0 / 3.0 - 1, abs=1.96 * u)
    assert float(found.cdp.squeeze()) > 0.99
    assert not any(one.code.startswith("encoding-assumed") for one in image.findings)


def test_the_regions_of_the_video_follow_their_objects_in_all_frames(folder):
    found = open_video(folder / "drive.mp4").track(folder / "rois.json").cdp(1.0)
    assert found.sizes["frame"] == FRAMES
    assert not found.lost.any()
    moved = found.centre_x.isel(side=0).squeeze()
    assert float(moved[-1] - moved[0]) == pytest.approx(2 * (FRAMES - 1), abs=1.5)
    assert float(found.cdp.min()) > 0.9


def test_a_command_writes_them_once(labcdp, tmp_path):
    done = labcdp("init", "samples", "samples")
    assert done.returncode == 0, done.stderr
    names = {"night.png", "drive.mp4", "rois.json"}
    assert {path.name for path in (tmp_path / "samples").iterdir()} == names
    again = labcdp("init", "samples", "samples")
    assert again.returncode == 1
    assert "night.png" in again.stderr
    assert "input" not in again.stderr
    assert labcdp("init", "samples", "samples", "--force").returncode == 0
    (tmp_path / "file").touch()
    refused = labcdp("init", "samples", "file")
    assert (refused.returncode, "file cannot be made" in refused.stderr) == (1, True)
