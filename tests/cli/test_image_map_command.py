import cv2
import numpy as np

from .conftest import results_of


def steps(*levels, noise=2.0):
    image = np.repeat(levels, 100) * np.ones((240, 1))
    return image + noise * np.random.default_rng(0).normal(size=image.shape)


def quantities(values):
    return {row["quantity"]: row["value"] for row in values["tables"]["summary"]["rows"]}


def test_the_map_of_a_picture(labcdp, tmp_path):
    image = steps(50.0, 100.0, 130.0, 400.0, noise=np.repeat([2.0, 2.0, 12.0, 2.0], 100))
    cv2.imwrite(str(tmp_path / "night.png"), np.clip(np.rint(image), 0, 255).astype(np.uint8))
    command = ("image-map", "night.png", "--region-size", 30)
    done = labcdp(*command, "--minimum-contrast", "20%", "--epsilon", "40%", "--json")
    values = results_of(done)
    asked, found = values["configuration"], quantities(values)
    assert (asked["region_size_px"], asked["minimum_contrast"], asked["epsilon"]) == (30, 0.2, 0.4)
    detected, lost = found["edges: detected"], found["edges: lost"]
    assert min(detected, lost, found["edges: saturated"]) > 3
    assert found["detected edges"] == detected / (detected + lost)
    assert (tmp_path / "night-image-map/results.json").read_text() == done.stdout
    assert all(abs(one["x_px"] - 200) < 2 for one in values["tables"]["weakest"]["rows"][:3])
    done = labcdp(*command, "-o", "other")
    assert "The weakest edges" in done.stdout
    assert "info: no calibration or camera specification: using relative luminance" in done.stderr
    assert "Report: other/report.html" in done.stderr


def test_a_map_asks_for_the_contrast_of_a_reference(labcdp, tmp_path):
    night = np.clip(np.rint(steps(50.0, 100.0, 130.0)), 0, 255).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "night.png"), night)
    cv2.imwrite(str(tmp_path / "fog.png"), (night // 2 + 100).astype(np.uint8))
    command = ("image-map", "fog.png", "--region-size", 30, "--encoding", "linear", "--json", "--force")
    own, asked = (results_of(labcdp(*command, *more)) for more in ((), ("--reference", "night.png")))
    assert {one["code"] for one in own["findings"]} >= {"map-of-own-contrast"}
    assert "map-of-own-contrast" not in {one["code"] for one in asked["findings"]}
    assert [one["role"] for one in asked["inputs"]] == ["picture", "reference"]
    # Steps of 100 % and 30 % before the fog, of 20 % and 10 % in it.
    assert asked["tables"]["weakest"]["rows"][0]["asked_contrast"] > 0.25
    assert quantities(own)["detected edges"] > 0.6
    assert quantities(asked)["detected edges"] < 0.1
