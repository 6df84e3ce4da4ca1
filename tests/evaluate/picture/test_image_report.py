"""Pages, JSON and sheets of pictures hold the numbers of their evaluation, also as command `image` writes them."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from io import BytesIO

import cv2
import numpy as np
import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.core.result import warning
from labcdp.core.roi import Roi
from labcdp.evaluate.picture.conversion import picture_conversion
from labcdp.evaluate.picture.figures import histogram_edges
from labcdp.evaluate.picture.image import ImageRequest
from labcdp.evaluate.picture.page import overview_page, picture_page
from labcdp.evaluate.picture.result import PictureTask
from labcdp.evaluate.picture.tables import ReportedPicture
from labcdp.metrics import cdp
from labcdp.regions import RectangleShape, save_regions
from labcdp.report.files import envelope_json, schema
from labcdp.report.layout import ReportFigure
from labcdp.report.sheets import result_workbook

HOSTILE = "</script><b>=1+1 $x_{$ [a]:*?/\\{{ 7 }}"
BRIGHT, DARK = Roi.rectangle("bright", 100, 20, 60, 80), Roi.rectangle(HOSTILE, 10, 10, 60, 80)
REQUEST = ImageRequest((0.5, 1.0, 2.0, 3.0), 0.5, (BRIGHT, DARK), neighbours=True, rectangle=(5, 5, 60, 50))
TASK = PictureTask(REQUEST, picture_conversion(None, None, "linear"), {"epsilon": 0.5})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two pictures as they are evaluated, the second with its pages; and one that failed."""
    folder, found = tmp_path_factory.mktemp("pictures"), []
    for seed in (1, 2):
        dn = np.random.default_rng(seed).normal(100.0, 10.0, (120, 180)) + 110 * (np.arange(180) > 90)
        cv2.imwrite(str(folder / f"{seed}.png"), np.clip(dn, 0, 255).astype(np.uint8))
        evaluation, files = TASK.made(folder / f"{seed}.png", pages=seed == 2, surface=seed == 2)
        found.append(ReportedPicture(seed, f"{seed}.png", f"picture-{seed}", evaluation))
    return [*found, ReportedPicture(3, "bad.png", "picture-3", None, "bad.png is empty")], files


@pytest.mark.parametrize(("values", "width"), [(np.uint8([[3, 5], [200, 5]]), 1), (np.uint16([[0, 4095]]), 16)])
def test_bars_of_a_histogram_fit_the_values(values, width):
    edges = histogram_edges(values)
    assert np.diff(edges) == pytest.approx(width)
    assert np.histogram(values, edges)[0].sum() == values.size
    # No value on the border of two bars.
    assert not np.isin(values, edges).any()


def test_pages_escape_all_text_and_name_failures(made):
    pictures, files = made
    hostile = replace(pictures[1].evaluation, findings=(warning("camera-assumed", camera=HOSTILE),))
    result = TASK.result([ReportedPicture(1, HOSTILE, "", hostile)])
    figures = [ReportFigure(f"{name}.png", b"", HOSTILE, HOSTILE) for name in ("picture", "values")]
    warned = picture_page(result, figures, HOSTILE, surface=True)
    overview = overview_page(TASK.result(pictures), pictures, "by hand")
    for page in (files["report.html"].decode(), warned, overview):
        assert "<b>" not in page
        assert "<script" not in page
    assert "No result of bad.png: bad.png is empty" in overview


def test_json_and_sheets_hold_the_numbers_of_the_evaluation(made):
    pictures, _ = made
    result = TASK.result(pictures)
    values = json.loads(envelope_json(result))
    Draft202012Validator(schema()).validate(values)
    tables = {name: table["rows"] for name, table in values["tables"].items()}
    first, found = tables["cdp"][1], pictures[0].evaluation.pairs[0]
    one = found.results[1]
    assert (first["picture"], first["dark"], first["contrast"]) == ("1.png", HOSTILE, 1.0)
    assert (first["cdp"], first["cdp_low"], first["cdp_high"]) == (one.result.cdp, *one.confidence_interval)
    assert (first["measured_contrast"], first["u_csnr"]) == (found.contrast.value, found.csnr.standard_error)
    assert first["expanded_measured_contrast"] == pytest.approx(1.96 * first["u_measured_contrast"], rel=1e-4)
    assert [row["failure"] for row in tables["pictures"]] == [None, None, "bad.png is empty"]
    # As in the program of the 2018 thesis: a column a picture.
    book = openpyxl.load_workbook(BytesIO(result_workbook(result, datetime(2026, 1, 2, tzinfo=UTC))))
    evaluation = pictures[1].evaluation
    for number, results in ((3, evaluation.pairs[0].results), (4, evaluation.neighbours.results)):
        _, *lines = ([cell.value for cell in line] for line in book.worksheets[number].iter_rows())
        expected = [(one.result.contrast, pytest.approx(one.result.cdp, rel=1e-14), None) for one in results]
        assert [(line[0], *line[2:]) for line in lines] == expected


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
