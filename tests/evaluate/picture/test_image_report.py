"""Pages, JSON and sheets of pictures hold the numbers of their evaluation."""

import base64
import json
from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser
from io import BytesIO

import cv2
import numpy as np
import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.core.luminance import LuminanceMap
from labcdp.core.result import warning
from labcdp.core.roi import Roi
from labcdp.evaluate.picture.conversion import picture_conversion
from labcdp.evaluate.picture.figures import histogram_edges
from labcdp.evaluate.picture.image import ImageRequest
from labcdp.evaluate.picture.page import overview_page, picture_page
from labcdp.evaluate.picture.result import PictureTask
from labcdp.evaluate.picture.surface import surface_page
from labcdp.evaluate.picture.tables import ReportedPicture
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


class _Text(HTMLParser):
    def __init__(self, page):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text += " ".join(data.split()) + " "


@pytest.mark.parametrize(
    ("values", "width"),
    [
        (np.array([[3, 5], [200, 5]], np.uint8), 1),
        (np.array([[0, 4095]], np.uint16), 16),
        (np.array([[0.0, 0.5, 1.0]]), 0.5),
    ],
)
def test_bars_of_a_histogram_fit_the_values(values, width):
    edges = histogram_edges(values)
    assert np.diff(edges) == pytest.approx(width)
    assert np.histogram(values, edges)[0].sum() == values.size
    # No value on the border of two bars.
    assert not np.isin(values, edges).any()


def test_pages_show_the_answer_first_escape_all_text_and_name_failures(made):
    pictures, files = made
    assert set(files) == {"report.html", "surface.html", *(f"figures/{name}.png" for name in FIGURES)}
    page = _Text(files["report.html"].decode())
    best = max(row["cdp"] for row in TASK.result(pictures[1:2]).table("cdp").rows() if row["bright"])
    parts = (f"{best:.3f}"[:4], "counts as detected", "Regions", "Provenance", pictures[1].evaluation.sha256)
    assert sorted(parts, key=page.text.index) == list(parts)
    assert all(part in page.text for part in (HOSTILE, "target contrast 100 %", "180 x 120 pixels"))
    assert [tag for tag, _ in page.tags].count("img") == len(FIGURES)
    hostile = replace(pictures[1].evaluation, findings=(warning("camera-assumed", camera=HOSTILE),))
    result = TASK.result([ReportedPicture(1, HOSTILE, "", hostile)])
    figures = [ReportFigure(f"{name}.png", b"", HOSTILE, HOSTILE) for name in FIGURES]
    warned = _Text(picture_page(result, figures, HOSTILE, surface=True))
    assert warned.text.count(HOSTILE) >= 4
    for one in (page, warned):
        assert not {"b", "script"} & {tag for tag, _ in one.tags}
    overview = _Text(overview_page(TASK.result(pictures), pictures, "by hand"))
    assert "1 failed" in overview.text
    assert "No result of bad.png: bad.png is empty" in overview.text
    links = [attributes["href"] for tag, attributes in overview.tags if tag == "a"]
    assert links == ["picture-1/report.html", "picture-2/report.html"]


FIGURES = ("picture", "contrasts-1", "cdp", "values")


def test_a_large_picture_becomes_a_surface_of_block_means_and_maxima_with_its_peak():
    luminance = np.random.default_rng(1).normal(50, 1, (1034, 2000)).astype(np.float32)
    luminance[700, 1203] = 900.0
    page = surface_page(LuminanceMap(luminance, luminance, (), np.zeros(luminance.shape, np.uint8)), HOSTILE, "cd/m²")
    assert "900.0 cd/m² at x = 1203.5, y = 700.5" in page
    assert "<b>" not in page[: page.index("<script")]
    call = page[page.rindex("Plotly.newPlot(") :]
    (means, maxima, mark), _ = json.JSONDecoder().raw_decode(call[call.index("[") :])
    blocks = np.add.reduceat(np.add.reduceat(luminance.astype(float), range(0, 1034, 10)), range(0, 2000, 10), axis=1)
    # The last row of blocks is lower than the others.
    heights = np.array([10] * 103 + [4])[:, None]
    np.testing.assert_allclose(_array(means["z"]), blocks / (10 * heights), rtol=1e-6)
    assert _array(maxima["z"])[70, 120] == 900
    assert [mark[axis][1] for axis in "xyz"] == [1203.5, 700.5, 900]


def _array(value):
    return np.frombuffer(base64.b64decode(value["bdata"]), np.float32).reshape(
        [int(n) for n in value["shape"].split(",")]
    )


def test_json_and_sheets_hold_the_numbers_of_the_evaluation(made):
    pictures, _ = made
    result = TASK.result(pictures)
    values = json.loads(envelope_json(result))
    Draft202012Validator(schema()).validate(values)
    tables = {name: table["rows"] for name, table in values["tables"].items()}
    first, *_, near = tables["cdp"][1:5]
    found = pictures[0].evaluation.pairs[0].result
    one = found.results[1]
    assert (first["picture"], first["bright"], first["dark"]) == ("1.png", "bright", HOSTILE)
    assert (first["contrast"], first["contrast_origin"], first["tolerance_above"]) == (1.0, "given", 0.5)
    assert (first["cdp"], first["cdp_low"], first["cdp_high"]) == (one.result.cdp, *one.confidence_interval)
    assert (first["measured_contrast"], first["u_csnr"]) == (found.contrast.value, found.csnr.standard_error)
    assert first["expanded_measured_contrast"] == pytest.approx(1.96 * first["u_measured_contrast"], rel=1e-4)
    assert (near["pair"], near["csnr"]) == ("nearest-neighbour, (5, 5) to (60, 50)", None)
    regions = [(row["region"], row["snr"]) for row in tables["regions"][:2]]
    assert regions == [(HOSTILE, found.b.snr.value), ("bright", found.a.snr.value)]
    assert [row["failure"] for row in tables["pictures"]] == [None, None, "bad.png is empty"]
    book = openpyxl.load_workbook(BytesIO(result_workbook(result, datetime(2026, 1, 2, tzinfo=UTC))))
    sheet = [[cell.value for cell in line] for line in book["cdp"].iter_rows()]
    assert sheet[2][sheet[0].index("CDP")] == pytest.approx(first["cdp"], rel=1e-14)
    # As in the program of the 2018 thesis: a column a picture.
    for number, pair in ((3, "evaluation.pairs"), (4, "nearest-neighbour")):
        head, *lines = ([cell.value for cell in line] for line in book.worksheets[number].iter_rows())
        assert head == ["target contrast (%)", "1 1.png", "2 2.png", "3 bad.png"]
        evaluation = pictures[1].evaluation
        results = evaluation.neighbours.results if pair == "nearest-neighbour" else evaluation.pairs[0].result.results
        expected = [(one.result.contrast, pytest.approx(one.result.cdp, rel=1e-14), None) for one in results]
        assert [(line[0], *line[2:]) for line in lines] == expected
