"""Command image, as it is run from a terminal."""

import json
import re
import resource
import subprocess
import sys
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.metrics import cdp
from labcdp.output import write_files
from labcdp.regions import RectangleShape, save_regions
from labcdp.report.files import schema

_LABCDP = Path(sys.executable).with_name("labcdp")
_LEFT, _RIGHT = (slice(20, 60), slice(10, 50)), (slice(20, 60), slice(70, 110))


@pytest.fixture
def image(labcdp):
    """Run `labcdp image` in an empty folder; returns the finished process."""
    return partial(labcdp, "image")


@pytest.fixture
def scene(tmp_path):
    """Two pictures of one scene, a smaller one of the first one's name, a broken one, and files of regions."""
    for number, (name, shape) in enumerate(
        [("one.png", (80, 120)), ("two.png", (80, 120)), ("small/one.png", (30, 40))]
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / name), _pixels(number, shape))
    (tmp_path / "broken.png").write_bytes((tmp_path / "one.png").read_bytes()[:2000])
    bright, dark = RectangleShape("bright", 70, 20, 40, 40), RectangleShape("dark, left", 10, 20, 40, 40)
    save_regions(tmp_path / "rois.json", (bright, dark))
    save_regions(tmp_path / "three.json", (bright, dark, RectangleShape("corner", 0, 0, 9, 9)))
    return tmp_path


def _pixels(seed, shape=(80, 120)):
    pixels = np.random.default_rng(seed).normal(20.0, 2.0, shape)
    pixels[:, shape[1] // 2 :] += 180
    return np.rint(np.clip(pixels, 0, 255)).astype(np.uint8)


def _lines(done):
    return [line for line in done.stderr.splitlines() if not line.startswith(("Pictures ", "info: ", "warning: "))]


def test_a_picture_with_its_numbers_pages_and_sheets(image, scene):
    done = image("one.png", "--roi", "rois.json", "--contrast", "1000%", "--encoding", "linear", "--json", "--surface")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(values)
    (found,) = values["tables"]["cdp"]["rows"]
    assert found["cdp"] == cdp(_pixels(0)[_RIGHT], _pixels(0)[_LEFT], 10.0).cdp
    assert values["tables"]["pictures"]["rows"][0]["unit"] == "relative"
    assert {one["role"] for one in values["inputs"]} == {"picture", "regions"}
    written = {
        str(path.relative_to(scene / "one-image")) for path in (scene / "one-image").rglob("*") if path.is_file()
    }
    names = {"report.html", "results.xlsx", "results.json", "figures/picture.png", "surface.html", "labcdp-files.json"}
    assert names < written
    assert (scene / "one-image/results.json").read_text() == done.stdout
    assert "warning" not in done.stderr


def test_the_rest_of_a_batch_continues_and_failures_are_reported_at_the_end(image, scene):
    (scene / "link.png").symlink_to(scene / "one.png")
    paths = ("one.png", "broken.png", "small/one.png", "two.png", "link.png", "missing.png")
    done = image(*paths, "--roi", "rois.json", "--contrast", "800%:1000%:3", "--encoding", "linear", "--output", "out")
    assert done.returncode == 1
    lines = _lines(done)
    assert lines[0] == "Note: link.png is the same file as one.png and is evaluated once"
    assert lines[-4] == "labcdp: 3 of 5 pictures failed:"
    assert "broken.png" in lines[-3]
    assert lines[-2] == (
        "  small/one.png: rois.json: region 'bright' spans x 70 to 110, y 20 to 60, but the image is 40 x 30 pixels: "
        "move it inside"
    )
    assert "missing.png cannot be read (No such file or directory)" in lines[-1]
    book = openpyxl.load_workbook(scene / "out/results.xlsx")
    rows = [[cell.value for cell in row] for row in book["cdp bright dark, left"].iter_rows()]
    names = ["one.png", "broken.png", "small/one.png", "two.png", "missing.png"]
    assert rows[0][1:] == [f"{number} {name}" for number, name in enumerate(names, start=1)]
    assert [value is None for value in rows[3]] == [False, False, True, True, False, True]
    assert rows[3][4] == pytest.approx(cdp(_pixels(1)[_RIGHT], _pixels(1)[_LEFT], 10.0).cdp)
    failures = [row[-1].value for row in book["pictures"].iter_rows(min_row=2)]
    assert [text is None for text in failures] == [True, False, False, True, False]
    assert {path.name for path in (scene / "out").iterdir()} == {
        *("report.html", "results.json", "results.xlsx", "picture-1-one", "picture-4-two", "labcdp-files.json")
    }
    assert not (scene / "out/picture-1-one/surface.html").exists()


def test_pictures_of_one_name_in_different_folders_are_kept_apart(image, scene):
    values = json.loads(image("one.png", "small/one.png", "--neighbours", "--output", "out", "--json").stdout)
    assert [one["picture"] for one in values["tables"]["pictures"]["rows"]] == ["one.png", "small/one.png"]
    for folder in ("picture-1-one", "picture-2-one"):
        assert (scene / "out" / folder / "report.html").exists()


def test_the_documentation_names_options_that_exist_and_code_that_runs(image, scene, monkeypatch, capsys):
    text = (Path(__file__).parents[3] / "docs" / "howto" / "picture.md").read_text(encoding="utf-8")
    assert set(re.findall(r"--[a-z][a-z-]+", text)) <= set(re.findall(r"--[a-z][a-z-]+", image("--help").stdout))
    code = text.partition("```python")[2].partition("```")[0]
    (scene / "one.png").rename(scene / "night.png")
    monkeypatch.chdir(scene)
    exec(code, {})
    of_given, of_measured = capsys.readouterr().out.splitlines()
    for line in (of_given, of_measured):
        assert 0.9 < float(re.findall(r"[\d.]+", line)[0]) <= 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "no regions given: give a file with --roi (see labcdp rois), or --neighbours"),
        (("--roi", "no.json"), "no.json cannot be read (No such file or directory)"),
        (("--roi", "rois.json", "--pair", "bright:sky"), "there is no 'sky': choose from bright, dark, left"),
        (("--rectangle", "1,2,3"), "--rectangle is '1,2,3': give two corner pixels x0,y0,x1,y1 as whole numbers"),
    ],
)
def test_bad_input_is_one_line(image, scene, arguments, message):
    before = sorted(scene.rglob("*"))
    done = image("one.png", *arguments)
    assert done.returncode == 1
    lines = _lines(done)
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("labcdp: ")
    assert message in lines[0]
    assert sorted(scene.rglob("*")) == before


def _limited(scene, *arguments):
    """Run the command where no file may be larger than 100 kB, as on a full disk."""
    return subprocess.run(
        [_LABCDP, "image", *arguments],
        cwd=scene,
        capture_output=True,
        text=True,
        timeout=300,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
    )


def test_a_disk_without_room_is_one_line_and_leaves_the_results_before(scene):
    write_files(scene / "out", "image", {"results.json": b"before"})
    before = {path.name: path.read_bytes() for path in (scene / "out").iterdir()}
    done = _limited(scene, "two.png", "--neighbours", "--output", "out", "--force")
    assert done.returncode == 1
    assert len(_lines(done)) == 1, done.stderr
    assert "cannot be written (File too large): give a folder you can write to, on a disk with" in _lines(done)[0]
    assert {path.name: path.read_bytes() for path in (scene / "out").iterdir()} == before


def test_many_pictures_on_all_cores_are_as_one_by_one(image, scene):
    """Four pictures take two processes; one that is broken is reported in its place."""
    for number in range(5):
        cv2.imwrite(str(scene / f"many-{number}.png"), _pixels(number))
    (scene / "many-2.png").write_bytes((scene / "broken.png").read_bytes())
    names = [f"many-{number}.png" for number in range(5)]
    asked = ("--roi", "rois.json", "--contrast", "1000%", "--json", "--no-pages")
    done = image(*names, *asked, "-o", "all")
    assert done.returncode == 1
    assert "1 of 5 pictures failed" in done.stderr
    rows = json.loads(done.stdout)["tables"]["cdp"]["rows"]
    assert [row["picture"] for row in rows] == [name for name in names if name != "many-2.png"]
    for row in rows[1:3]:
        (alone,) = json.loads(image(row["picture"], *asked, "--force").stdout)["tables"]["cdp"]["rows"]
        assert [alone[name] for name in ("cdp", "u_cdp")] == [row[name] for name in ("cdp", "u_cdp")]
    written = {path.name for path in (scene / "all").rglob("*")}
    assert written == {"report.html", "results.json", "results.xlsx", "labcdp-files.json"}
