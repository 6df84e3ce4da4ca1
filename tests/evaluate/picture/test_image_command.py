"""Command image, as it is run from a terminal."""

import json

import cv2
import numpy as np
import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.metrics import cdp
from labcdp.regions import RectangleShape, save_regions
from labcdp.report.files import schema

_ASKED = ("--roi", "rois.json", "--encoding", "linear", "--contrast")
_LEFT, _RIGHT = (slice(20, 60), slice(10, 50)), (slice(20, 60), slice(70, 110))


@pytest.fixture
def scene(tmp_path):
    """Two pictures of one scene, a smaller one of the first one's name, a broken one, and a file of regions."""
    (tmp_path / "small").mkdir()
    for number, (name, shape) in enumerate(
        [("one.png", (80, 120)), ("two.png", (80, 120)), ("small/one.png", (30, 40))]
    ):
        cv2.imwrite(str(tmp_path / name), _pixels(number, shape))
    (tmp_path / "broken.png").write_bytes((tmp_path / "one.png").read_bytes()[:2000])
    bright, dark = RectangleShape("bright", 70, 20, 40, 40), RectangleShape("dark, left", 10, 20, 40, 40)
    save_regions(tmp_path / "rois.json", (bright, dark))
    return tmp_path


def _pixels(seed, shape=(80, 120)):
    pixels = np.random.default_rng(seed).normal(20.0, 2.0, shape)
    pixels[:, shape[1] // 2 :] += 180
    return np.rint(np.clip(pixels, 0, 255)).astype(np.uint8)


def _lines(done):
    return [line for line in done.stderr.splitlines() if not line.startswith(("Pictures ", "info: ", "warning: "))]


def test_a_picture_with_its_numbers_pages_and_sheets(labcdp, scene):
    done = labcdp("image", "one.png", *_ASKED, "1000%", "--json", "--surface")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(values)
    (found,) = values["tables"]["cdp"]["rows"]
    assert found["cdp"] == cdp(_pixels(0)[_RIGHT], _pixels(0)[_LEFT], 10.0).cdp
    assert {one["role"] for one in values["inputs"]} == {"picture", "regions"}
    folder = scene / "one-image"
    names = {"report.html", "results.xlsx", "results.json", "figures/picture.png", "surface.html", "labcdp-files.json"}
    assert names < {str(path.relative_to(folder)) for path in folder.rglob("*")}
    assert (folder / "results.json").read_text() == done.stdout
    assert "warning" not in done.stderr


def test_the_rest_of_a_batch_on_all_cores_continues_and_failures_are_reported_at_the_end(labcdp, scene):
    (scene / "link.png").symlink_to(scene / "one.png")
    paths = ("one.png", "broken.png", "small/one.png", "two.png", "link.png", "missing.png")
    done = labcdp("image", *paths, *_ASKED, "800%:1000%:3", "--output", "out")
    assert done.returncode == 1
    lines = _lines(done)
    assert lines[0] == "Note: link.png is the same file as one.png and is evaluated once"
    assert lines[-4] == "labcdp: 3 of 5 pictures failed:"
    assert "broken.png" in lines[-3]
    assert lines[-2].startswith("  small/one.png: rois.json: region 'bright' spans x 70 to 110, y 20 to 60, but the")
    assert "missing.png cannot be read (No such file or directory)" in lines[-1]
    book = openpyxl.load_workbook(scene / "out/results.xlsx")
    head, *_, row = ([cell.value for cell in row] for row in book["cdp bright dark, left"].iter_rows())
    assert head[1:] == ["1 one.png", "2 broken.png", "3 small/one.png", "4 two.png", "5 missing.png"]
    one, two = (cdp(_pixels(seed)[_RIGHT], _pixels(seed)[_LEFT], 10.0).cdp for seed in (0, 1))
    assert row[1:] == [pytest.approx(one), None, None, pytest.approx(two), None]
    failures = [row[-1].value for row in book["pictures"].iter_rows(min_row=2)]
    assert [text is None for text in failures] == [True, False, False, True, False]
    assert {path.name for path in (scene / "out").iterdir()} == {
        *("report.html", "results.json", "results.xlsx", "picture-1-one", "picture-4-two", "labcdp-files.json")
    }


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--roi", "no.json"), "no.json cannot be read (No such file or directory)"),
        (("--roi", "rois.json", "--pair", "bright:sky"), "there is no 'sky': choose from bright, dark, left"),
        (("--rectangle", "1,2,3"), "--rectangle is '1,2,3': give two corner pixels x0,y0,x1,y1 as whole numbers"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(labcdp, scene, arguments, message):
    before = sorted(scene.rglob("*"))
    done = labcdp("image", "one.png", *arguments)
    assert done.returncode == 1
    (line,) = _lines(done)
    assert line.startswith("labcdp: ")
    assert message in line
    assert sorted(scene.rglob("*")) == before
