"""Command image, as it is run from a terminal."""

import json
import os
import re
import resource
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import cv2
import numpy as np
import openpyxl
import pytest

from labcdp.contrast import cdp, cdp_rectangle
from labcdp.regions import RectangleShape, save_regions

_LABCDP = Path(sys.executable).with_name("labcdp")
_FORKING = Path(__file__).parents[1] / "cli" / "forking.py"
_LEFT, _RIGHT = (slice(20, 60), slice(10, 50)), (slice(20, 60), slice(70, 110))


@pytest.fixture(scope="module")
def forking():
    with subprocess.Popen(
        [sys.executable, _FORKING], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield process
        process.stdin.close()


@pytest.fixture
def image(tmp_path, tmp_path_factory, forking):
    """Run `labcdp image` in an empty folder; returns the finished process."""

    def run(*arguments):
        streams = tmp_path_factory.mktemp("streams")
        request = {name: str(streams / name) for name in ("stdout", "stderr")} | {"stdin": os.devnull}
        request |= {"arguments": ["labcdp", "image", *map(str, arguments)], "cwd": str(tmp_path), "timeout_s": 120}
        print(json.dumps(request), file=forking.stdin, flush=True)
        status = json.loads(forking.stdout.readline())
        out, err = ((streams / name).read_text() for name in ("stdout", "stderr"))
        return subprocess.CompletedProcess(arguments, status, out, err)

    return run


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
    return [line for line in done.stderr.splitlines() if not line.startswith(("Pictures ", "Warning: "))]


def test_a_picture_with_its_numbers_pages_and_sheets(image, scene):
    done = image("one.png", "--roi", "rois.json", "--contrast", "1000%", "--encoding", "linear", "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    found = values["pictures"][0]["pairs"][0]["contrasts"][0]
    assert found["cdp"] == cdp(_pixels(0)[_RIGHT], _pixels(0)[_LEFT], 10.0).cdp
    assert values["pictures"][0]["unit"] == "relative"
    assert values["output"] == "one-cdp"
    written = {str(path.relative_to(scene / "one-cdp")) for path in (scene / "one-cdp").rglob("*") if path.is_file()}
    assert {"report.html", "surface.html", "results.xlsx", "results.json", "figures/picture.png"} < written
    assert set(json.loads((scene / "one-cdp/results.json").read_text())["written"]) == written
    assert "Warning" not in done.stderr


def test_a_person_is_told_the_result_in_tables(image, scene):
    done = image("one.png", "--roi", "three.json", "--pair", "bright,dark, left", "--no-surface", "--epsilon", "20%")
    assert done.returncode == 0, done.stderr
    assert "800 to 1200" not in done.stdout
    assert "80 to 120" in done.stdout
    assert "bright / dark, left" in done.stdout
    assert "corner" in done.stdout
    assert "Warning: neither calibration nor camera specification" in done.stderr
    assert done.stderr.splitlines()[-1] == "Report: one-cdp/report.html; also results.xlsx and results.json"
    assert not (scene / "one-cdp/surface.html").exists()


def test_the_rest_of_a_batch_goes_on_and_failures_are_told_at_the_end(image, scene):
    paths = ("one.png", "broken.png", "small/one.png", "two.png", "./one.png", "missing.png")
    done = image(
        *paths, "--roi", "rois.json", "--contrast", "800%:1000%:100%", "--encoding", "linear", "--output", "out"
    )
    assert done.returncode == 1
    lines = _lines(done)
    assert lines[0] == "Note: one.png is the same file as one.png, and evaluated once" or "Note" not in done.stderr
    assert lines[-4] == "labcdp: 3 of 5 pictures failed:"
    assert "broken.png" in lines[-3]
    assert lines[-2] == (
        "  small/one.png: rois.json: region 'bright' spans x 70 to 110, y 20 to 60, but the image is 40 x 30 pixels: "
        "move it inside"
    )
    assert "missing.png cannot be read (No such file or directory)" in lines[-1]
    book = openpyxl.load_workbook(scene / "out/results.xlsx")
    rows = [[cell.value for cell in row] for row in book["CDP"].iter_rows()]
    assert rows[0][1:] == [f"Picture number {n}" for n in range(1, 6)]
    assert rows[-1] == ["File", "one.png", "broken.png", "small/one.png", "two.png", "missing.png"]
    assert [value is None for value in rows[3]] == [False, False, True, True, False, True]
    assert rows[3][4] == pytest.approx(cdp(_pixels(1)[_RIGHT], _pixels(1)[_LEFT], 10.0).cdp)
    assert book["Failures"].max_row == 4
    assert {path.name for path in (scene / "out").iterdir()} == {
        *("report.html", "results.json", "results.xlsx", "picture-1-one", "picture-4-two")
    }
    assert not (scene / "out/picture-1-one/surface.html").exists()


def test_pictures_of_one_name_are_kept_apart_and_one_given_twice_counts_once(image, scene):
    (scene / "two.png").unlink()
    (scene / "link.png").symlink_to(scene / "one.png")
    done = image(".", "small", "link.png", "--neighbours", "--output", "out", "--json")
    values = json.loads(done.stdout)
    assert done.returncode == 1
    assert [failure["file"] for failure in values["failures"]] == ["broken.png"]
    assert [picture["file"] for picture in values["pictures"]] == ["link.png", "small/one.png"]
    assert "Note: one.png is the same file as link.png, and evaluated once" in done.stderr
    assert (scene / "out/picture-2-link/report.html").exists()
    assert (scene / "out/picture-3-one/report.html").exists()


def test_the_documentation_names_options_that_exist_and_code_that_runs(image, scene, monkeypatch, capsys):
    text = (Path(__file__).parents[2] / "docs" / "images.md").read_text(encoding="utf-8")
    assert set(re.findall(r"--[a-z][a-z-]+", text)) <= set(re.findall(r"--[a-z][a-z-]+", image("--help").stdout))
    code = textwrap.dedent(text.partition("## From Python")[2].partition("`labcdp.evaluate")[0])
    (scene / "one.png").rename(scene / "night.png")
    monkeypatch.chdir(scene)
    exec(code, {})
    assert float(capsys.readouterr().out.split()[0]) > 0.9


def test_pixel_to_pixel_in_a_rectangle(image, scene):
    done = image(
        "one.png", "--rectangle", "100,70,65,5", "--contrast", "3.3%", "--no-surface", "--encoding", "linear", "--json"
    )
    values = json.loads(done.stdout)["pictures"][0]["neighbours"]
    assert values["rectangle"] == [65, 5, 100, 70]
    assert values["contrasts"][0]["cdp"] == cdp_rectangle(_pixels(0), (65, 5), (100, 70), 0.033).cdp


def test_nothing_is_written_where_all_fail(image, scene):
    done = image("broken.png", "--neighbours")
    assert done.returncode == 1
    assert len(_lines(done)) == 1
    assert _lines(done)[0].startswith("labcdp: broken.png ")
    assert not (scene / "broken-cdp").exists()
    several = image("broken.png", "missing.png", "--neighbours", "--json")
    assert several.returncode == 1
    assert json.loads(several.stdout)["output"] is None
    assert not (scene / "pictures-cdp").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "there are no regions: give a file with --roi (labcdp rois draws one), or --neighbours"),
        (("--roi", "no.json"), "no.json cannot be read (No such file or directory)"),
        (("--roi", "one.png"), "one.png: it is neither JSON nor an ImageJ file of regions (.roi or .zip)"),
        (("--neighbours", "--pair", "a,b"), "--pair names regions: give their file with --roi"),
        (("--roi", "rois.json", "--pair", "bright,sky"), "there is no region 'sky': choose from bright, dark, left"),
        (("--roi", "rois.json", "--pair", "bright"), "--pair is 'bright': give two regions with a comma between them"),
        (("--roi", "rois.json", "--contrast", "10"), "--contrast is '10': give a percentage such as 1000%"),
        (("--roi", "rois.json", "--epsilon", "0%"), "--epsilon is '0%': give a percentage above 0%, up to 100%"),
        (("--roi", "rois.json", "--epsilon", "nan%"), "--epsilon is 'nan%': give a number with a percent sign"),
        (("--rectangle", "1,2,3"), "--rectangle is '1,2,3': give two corner pixels x0,y0,x1,y1 as whole numbers"),
        (("--neighbours", "--encoding", "gamma"), "--encoding is 'gamma': give linear or srgb"),
        (("--neighbours", "--exposure", "5"), "--exposure is '5': give a number above 0 with s, ms or us"),
        (
            ("--neighbours", "--output", "one.png"),
            "one.png cannot be made (File exists): give a folder you can write to",
        ),
        (("--neighbours", "--calibration", "one.png"), "one.png"),
        (("--neighbours", "--camera", "one.png"), "one.png"),
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
        timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
    )


def test_a_disk_without_room_is_one_line_and_leaves_the_results_before(scene):
    (scene / "out").mkdir()
    (scene / "out/results.json").write_text('{"written": ["results.json"]}')
    done = _limited(scene, "two.png", "--neighbours", "--output", "out")
    assert done.returncode == 1
    assert len(_lines(done)) == 1, done.stderr
    assert _lines(done)[0] == (
        "labcdp: results cannot be written to out (File too large): make room there, or give another folder for the "
        "results"
    )
    assert [path.name for path in (scene / "out").iterdir()] == ["results.json"]
    assert (scene / "out/results.json").read_text() == '{"written": ["results.json"]}'


@pytest.fixture
def small_disk(tmp_path):
    """Folder on a disk of 200 kB of its own."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = shutil.which("mount") and subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", folder], capture_output=True
    )
    if not mounted or mounted.returncode:
        pytest.skip("a disk of its own cannot be mounted here")
    yield folder
    subprocess.run(["umount", folder], check=True)


def test_a_full_disk_and_one_that_cannot_be_written_to(image, scene, small_disk):
    full = image("one.png", "--neighbours", "--output", small_disk / "out")
    assert full.returncode == 1
    assert len(_lines(full)) == 1
    assert f"results cannot be written to {small_disk / 'out'} (No space left on device): make room" in _lines(full)[0]
    assert list(small_disk.iterdir()) == []
    subprocess.run(["mount", "-o", "remount,ro", small_disk], check=True)
    locked = image("one.png", "--neighbours", "--output", small_disk)
    assert locked.returncode == 1
    assert _lines(locked) == [
        f"labcdp: {small_disk} cannot be written to (Read-only file system): give a folder you can write to, on a disk "
        "with enough space"
    ]
