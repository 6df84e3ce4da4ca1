import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest


@pytest.fixture
def night(tmp_path):
    """8-bit image of steps, the last of them saturated."""
    image = np.repeat([50.0, 100.0, 130.0, 400.0], 100) * np.ones((240, 1))
    image += np.repeat([2.0, 2.0, 12.0, 2.0], 100) * np.random.default_rng(0).normal(size=image.shape)
    path = tmp_path / "night.png"
    cv2.imwrite(str(path), np.clip(np.rint(image), 0, 255).astype(np.uint8))
    return path


def test_a_map_as_json(labcdp, night):
    done = labcdp("image-map", night, "--region-size", 30, "--minimum-contrast", "20%", "--epsilon", "40%", "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert values["unit"] == "relative"
    assert (values["size_px"], values["minimum_contrast"], values["epsilon"]) == (30, 0.2, 0.4)
    edges = values["edges"]
    assert min(edges["detected"], edges["lost"], edges["saturated"]) > 3
    assert values["detected_share"] == edges["detected"] / (edges["detected"] + edges["lost"])
    assert values["written"][1] == "night-contrast-map/contrast-map.html"
    assert all((night.parent / name).stat().st_size > 500 for name in values["written"])
    assert all(abs(one["x_px"] - 200) < 2 for one in values["weakest"][:3])


def test_a_map_for_a_person(labcdp, night):
    done = labcdp("image-map", night, "--region-size", 30, "-o", "other")
    assert done.returncode == 0, done.stderr
    assert "The weakest edges" in done.stdout
    assert "Warning: neither calibration nor camera specification" in done.stderr
    assert "edges with a contrast of at least 10 % are detected" in done.stderr
    assert "Map: other/contrast-map.html" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--region-size", 9), "the size of the regions is 9 pixels: give 10 or more"),
        (("--region-size", 300), "superpixels of 300 pixels are larger than the image (400 x 240)"),
        (("--minimum-contrast", "0.1"), "--minimum-contrast is '0.1': give a number with a percent sign"),
        (("--detected", 0), "the CDP of a detected edge is 0.0: give a fraction above 0, up to 1"),
        (("-o", "night.png"), "night.png cannot be made"),
        (("--calibration", "a.json", "--camera", "b.toml"), "give one, the calibration knows more"),
    ],
)
def test_bad_input_is_one_line(fails, night, arguments, message):
    assert message in fails("image-map", night, *arguments)


def test_a_missing_image(fails):
    assert "missing.png cannot be read (No such file or directory)" in fails("image-map", "missing.png")


@pytest.mark.parametrize("arguments", [("missing.png",), ("night.png", "--region-size", 300)])
def test_a_failure_leaves_no_folder(fails, night, arguments):
    fails("image-map", *arguments, "-o", "new/map")
    assert [path.name for path in night.parent.iterdir()] == ["night.png"]


def test_a_folder_that_cannot_be_written_to_is_told_before_the_picture_is_read(fails, night):
    (night.parent / "file").write_text("mine")
    assert "file/map cannot be made" in fails("image-map", "missing.png", "-o", "file/map")
    assert (night.parent / "file").read_text() == "mine"


def test_a_raw_dump_of_a_bayer_camera(labcdp, tmp_path):
    image = np.repeat([500.0, 1000.0, 1300.0, 2400.0], 100) * np.ones((240, 1))
    image += np.random.default_rng(0).normal(scale=20.0, size=image.shape)
    # Red and blue pixels, which say nothing here.
    image[::2, ::2] = image[1::2, 1::2] = 50.0
    np.rint(image).astype("<u2").tofile(tmp_path / "a.raw")
    layout = ("--size", "400x240", "--pixel-format", "BayerRG12", "--encoding", "linear")
    done = labcdp("image-map", "a.raw", *layout, "--region-size", 30, "--minimum-contrast", "50%", "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    contrasts = np.array([one["contrast"] for one in values["weakest"]])
    # The steps from 500 to 1000 and from 1300 to 2400.
    assert np.abs(contrasts[:, None] - [1.0, 2400 / 1300 - 1]).min(axis=1).max() < 0.05
    assert (values["edges"]["lost"], values["edges"]["detected"] > 3) == (0, True)


def test_the_documentation_names_options_that_exist(labcdp):
    text = (Path(__file__).parents[2] / "docs" / "contrast-map.md").read_text(encoding="utf-8")
    there = set(re.findall(r"--[a-z][a-z-]+", labcdp("image-map", "--help").stdout))
    assert set(re.findall(r"--[a-z][a-z-]+", text)) <= there
