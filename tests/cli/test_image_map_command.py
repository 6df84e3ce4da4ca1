import json

import cv2
import numpy as np
import pytest
from jsonschema import Draft202012Validator

from labcdp.report.envelope import schema


@pytest.fixture
def night(tmp_path):
    """8-bit image of steps, the last of them saturated."""
    image = np.repeat([50.0, 100.0, 130.0, 400.0], 100) * np.ones((240, 1))
    image += np.repeat([2.0, 2.0, 12.0, 2.0], 100) * np.random.default_rng(0).normal(size=image.shape)
    path = tmp_path / "night.png"
    cv2.imwrite(str(path), np.clip(np.rint(image), 0, 255).astype(np.uint8))
    return path


def _quantities(values):
    return {row["quantity"]: row["value"] for row in values["tables"]["summary"]["rows"]}


def test_a_map_as_json(labcdp, night):
    done = labcdp("image-map", night, "--region-size", 30, "--minimum-contrast", "20%", "--epsilon", "40%", "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(values)
    asked = values["configuration"]
    assert (asked["region_size_px"], asked["minimum_contrast"], asked["epsilon"]) == (30, 0.2, 0.4)
    found = _quantities(values)
    detected, lost = found["edges: detected"], found["edges: lost"]
    assert min(detected, lost, found["edges: saturated"]) > 3
    assert found["detected edges"] == detected / (detected + lost)
    assert (night.parent / "night-image-map/results.json").read_text() == done.stdout
    assert all(abs(one["x_px"] - 200) < 2 for one in values["tables"]["weakest"]["rows"][:3])


def test_a_map_for_a_person(labcdp, night):
    done = labcdp("image-map", night, "--region-size", 30, "-o", "other")
    assert done.returncode == 0, done.stderr
    assert "The weakest edges" in done.stdout
    assert "detected edges" in done.stdout
    assert "info: no calibration or camera specification: using relative luminance" in done.stderr
    assert "Report: other/report.html" in done.stderr


def test_a_map_asks_for_the_contrast_of_a_reference(labcdp, night):
    image = cv2.imread(str(night), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(night.parent / "fog.png"), (image // 2 + 100).astype(np.uint8))
    told = ("image-map", "fog.png", "--region-size", 30, "--encoding", "linear", "--json", "--force")
    own, asked = (json.loads(labcdp(*told, *more).stdout) for more in ((), ("--reference", night)))
    assert {one["code"] for one in own["findings"]} >= {"map-of-own-contrast"}
    assert "map-of-own-contrast" not in {one["code"] for one in asked["findings"]}
    assert [one["role"] for one in asked["inputs"]] == ["picture", "reference"]
    # Steps of 100 % and 30 % before the fog, of 20 % and 8 % in it.
    (weakest, *_) = asked["tables"]["weakest"]["rows"]
    assert weakest["asked_contrast"] > 0.25
    assert _quantities(own)["detected edges"] > 0.6
    assert _quantities(asked)["detected edges"] < 0.1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--region-size", 9), "the size of the regions is 9 pixels: give 10 or more"),
        (("--region-size", 300), "superpixels of 300 pixels are larger than the image (400 x 240)"),
        (("--minimum-contrast", "0.1"), "--minimum-contrast is '0.1': give a number with a percent sign"),
        (("--detected", 0), "the CDP of a detected edge is 0.0: give a fraction above 0, up to 1"),
        (("-o", "night.png"), "night.png is not a folder"),
        (("--calibration", "a.json", "--camera-spec", "b.toml"), "are given: give one"),
    ],
)
def test_bad_input_is_one_line(fails, night, arguments, message):
    assert message in fails("image-map", night, *arguments)


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
    contrasts = np.array([one["contrast"] for one in values["tables"]["weakest"]["rows"]])
    # The steps from 500 to 1000 and from 1300 to 2400.
    assert np.abs(contrasts[:, None] - [1.0, 2400 / 1300 - 1]).min(axis=1).max() < 0.05
    assert (_quantities(values)["edges: lost"], _quantities(values)["edges: detected"] > 3) == (0, True)
