"""Command image, as it is run from a terminal."""

import cv2
import numpy as np
import openpyxl
import pytest

from labcdp.metrics import cdp
from labcdp.regions import RectangleShape, save_regions

_LEFT, _RIGHT = (slice(20, 60), slice(10, 50)), (slice(20, 60), slice(70, 110))


def _pixels(seed, shape=(80, 120)):
    pixels = np.random.default_rng(seed).normal(20.0, 2.0, shape)
    pixels[:, shape[1] // 2 :] += 180
    return np.rint(np.clip(pixels, 0, 255)).astype(np.uint8)


def test_the_rest_of_a_batch_on_all_cores_continues_and_failures_are_reported_at_the_end(labcdp, tmp_path):
    (tmp_path / "small").mkdir()
    for seed, (name, shape) in enumerate([("one.png", (80, 120)), ("two.png", (80, 120)), ("small/one.png", (30, 40))]):
        cv2.imwrite(str(tmp_path / name), _pixels(seed, shape))
    (tmp_path / "broken.png").write_bytes((tmp_path / "one.png").read_bytes()[:2000])
    bright, dark = RectangleShape("bright", 70, 20, 40, 40), RectangleShape("dark, left", 10, 20, 40, 40)
    save_regions(tmp_path / "rois.json", (bright, dark))
    (tmp_path / "link.png").symlink_to(tmp_path / "one.png")
    paths = ("one.png", "broken.png", "small/one.png", "two.png", "link.png", "missing.png")
    asked = ("--roi", "rois.json", "--encoding", "linear", "--contrast", "800%:1000%:3", "--output", "out")
    done = labcdp("image", *paths, *asked)
    assert done.returncode == 1
    told = done.stderr.splitlines()
    assert "Note: link.png is the same file as one.png and is evaluated once" in told
    *_, count, broken, small, missing = told
    assert count == "labcdp: 3 of 5 pictures failed:"
    for line, words in ((broken, "broken.png"), (small, "small/one.png: rois"), (missing, "missing.png cannot be re")):
        assert words in line
    book = openpyxl.load_workbook(tmp_path / "out/results.xlsx")
    head, *_, row = ([cell.value for cell in row] for row in book["cdp bright dark, left"].iter_rows())
    assert head[1:] == ["1 one.png", "2 broken.png", "3 small/one.png", "4 two.png", "5 missing.png"]
    one, two = (cdp(_pixels(seed)[_RIGHT], _pixels(seed)[_LEFT], 10.0).cdp for seed in (0, 1))
    assert row[1:] == [pytest.approx(one), None, None, pytest.approx(two), None]
    assert {path.name for path in (tmp_path / "out").iterdir() if path.is_dir()} == {"picture-1-one", "picture-4-two"}
