import json

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
    done = labcdp("image-map", night, "--size", 30, "--minimum-contrast", "20%", "--epsilon", "40%", "--json")
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
    done = labcdp("image-map", night, "--size", 30, "-o", "other")
    assert done.returncode == 0, done.stderr
    assert "The weakest edges" in done.stdout
    assert "Warning: neither calibration nor camera specification" in done.stderr
    assert "edges with a contrast of at least 10 % are detected" in done.stderr
    assert "Map: other/contrast-map.html" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--size", 9), "the size of the regions is 9 pixels: give 10 or more"),
        (("--size", 300), "superpixels of 300 pixels are larger than the image (400 x 240)"),
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
