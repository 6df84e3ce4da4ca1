"""Results, pages and files of pictures."""

import json
import shutil
import subprocess
from datetime import UTC, datetime
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.core.luminance import Invalid, LuminanceMap
from labcdp.core.result import warning
from labcdp.core.roi import Roi
from labcdp.evaluate.picture.conversion import picture_conversion
from labcdp.evaluate.picture.figures import histogram_edges, image_figures
from labcdp.evaluate.picture.image import ImageRequest, evaluate_image
from labcdp.evaluate.picture.page import overview_page, picture_page
from labcdp.evaluate.picture.result import PictureTask
from labcdp.evaluate.picture.surface import MOST_POINTS, surface_page
from labcdp.evaluate.picture.tables import ReportedPicture
from labcdp.files.picture import Picture
from labcdp.report.files import envelope_json, schema
from labcdp.report.sheets import result_workbook

CHROMIUM = shutil.which("chromium")
TIME = datetime(2026, 1, 2, tzinfo=UTC)
HOSTILE = "</script><b>=1+1 $x_{$ [a]:*?/\\{{ 7 }}"
SHAPE = (120, 180)
BRIGHT, DARK = Roi.rectangle("bright", 100, 20, 60, 80), Roi.rectangle(HOSTILE, 10, 10, 60, 80)
REQUEST = ImageRequest((0.5, 1.0, 2.0, 3.0), 0.5, (BRIGHT, DARK), neighbours=True, rectangle=(5, 5, 60, 50))


def _luminance(seed=0):
    luminance = np.random.default_rng(seed).normal(100.0, 10.0, SHAPE)
    luminance[:, 90:] += 110
    return luminance


def _map(luminance, **more):
    invalid = np.zeros(luminance.shape, dtype=np.uint8)
    invalid[:4, :4] = Invalid.SATURATED
    return LuminanceMap(luminance, np.zeros(luminance.shape), (), invalid, **more)


def _picture(luminance, name="night.exr"):
    light = luminance.astype(np.float32)
    return Picture(Path(name), "ab" * 32, None, light, True, "linear", (), None, None, False, False)


@pytest.fixture(scope="module")
def figures():
    luminance = _luminance()
    return image_figures(_evaluation(), _picture(luminance), _map(luminance))


def _evaluation(seed=0, request=REQUEST, name="night.exr", findings=()):
    luminance = _luminance(seed)
    return evaluate_image(_picture(luminance, name), _map(luminance), "cd/m^2", request, findings)


def _result(pictures, request=REQUEST):
    return PictureTask(request, picture_conversion(None, None, None), {"epsilon": 0.5}).result(pictures)


def _reported(n=2, failed=True):
    good = [ReportedPicture(k, f"{k}.exr", f"picture-{k}", _evaluation(k, name=f"{k}.exr")) for k in range(1, n + 1)]
    return [*good, ReportedPicture(n + 1, "bad.png", f"picture-{n + 1}", None, "bad.png is empty")] if failed else good


class _Text(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.text = [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text.append(data)


def _parsed(page):
    parser = _Text()
    parser.feed(page)
    parser.close()
    return parser


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


def test_a_page_shows_the_answer_first_and_escapes_all_text(figures):
    result = _result(
        [ReportedPicture(1, "night.exr", "", _evaluation(findings=[warning("camera-assumed", camera=HOSTILE)]))]
    )
    html = picture_page(result, figures, "by hand " + HOSTILE, surface=True)
    page = _parsed(html)
    text = " ".join("".join(page.text).split())
    best = max(result.table("cdp").rows(), key=lambda row: row["cdp"] if row["bright"] else 0.0)
    places = [text.index(part) for part in (f"{best['cdp']:.3f}"[:4], "counts as detected", "Regions", "Provenance")]
    assert places == sorted(places)
    for part in ("night.exr", HOSTILE, "target contrast 100 %", "by hand", "ab" * 32, "180 x 120 pixels"):
        assert part in text
    assert len([tag for tag, _ in page.tags if tag == "img"]) == 4
    assert not {"b", "script"} & {tag for tag, _ in page.tags}


def test_the_overview_shows_failures_and_links_to_the_pages():
    page = _parsed(overview_page(_result(_reported()), _reported(), "by hand"))
    text = " ".join("".join(page.text).split())
    assert "1 failed" in text
    assert "No result of bad.png: bad.png is empty" in text
    links = [attributes["href"] for tag, attributes in page.tags if tag == "a"]
    assert links == ["picture-1/report.html", "picture-2/report.html"]


def _surface_data(page):
    """Traces and layout that the page hands to plotly."""
    call = page[page.rindex("Plotly.newPlot(") :]
    decoder, start = json.JSONDecoder(), call.index("[")
    traces, end = decoder.raw_decode(call[start:])
    rest = call[start + end :]
    layout, _ = decoder.raw_decode(rest[rest.index("{") :])
    return traces, layout


def _array(value):
    import base64

    found = np.frombuffer(base64.b64decode(value["bdata"]), dtype={"f4": np.float32}[value["dtype"]])
    return found.reshape([int(n) for n in value["shape"].split(",")]) if "shape" in value else found


def test_a_large_picture_becomes_a_surface_of_block_means_and_maxima_with_its_peak():
    luminance = np.random.default_rng(1).normal(50, 1, (1034, 2000)).astype(np.float32)
    luminance[700, 1203] = 900.0
    page = surface_page(LuminanceMap(luminance, luminance, (), np.zeros(luminance.shape, np.uint8)), HOSTILE, "cd/m²")
    assert len(page) < 7e6
    assert "each point stands for a block of 10 x 10 pixels" in page
    assert "900.0 cd/m² at x = 1203.5, y = 700.5" in page
    assert "<b>" not in page[: page.index("<script")]
    (means, maxima, mark), layout = _surface_data(page)
    z = _array(means["z"])
    assert z.shape == (104, 200)
    assert max(z.shape) <= MOST_POINTS
    np.testing.assert_allclose(z[10, 20], luminance[100:110, 200:210].mean(), rtol=1e-6)
    # The last row of blocks is lower than the others.
    np.testing.assert_allclose(z[103, 0], luminance[1030:, :10].mean(), rtol=1e-6)
    assert _array(maxima["z"])[70, 120] == 900
    assert (means["visible"], maxima["visible"]) == (True, False)
    assert mark["z"][1] == 900
    assert (mark["x"][1], mark["y"][1]) == (1203.5, 700.5)
    assert layout["scene"]["zaxis"]["range"][1] > 900
    assert _array(means["y"])[-1] == 1032
    buttons = layout["updatemenus"][0]["buttons"]
    assert [button["args"][0]["visible"] for button in buttons] == [[True, False], [False, True]]


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_the_surface_is_drawn_in_a_browser(tmp_path):
    luminance = np.full((60, 80), 20.0)
    luminance[20:40, 20:60] = 90.0
    (tmp_path / "surface.html").write_text(surface_page(_map(luminance), "step", "cd/m²"))
    subprocess.run(
        [
            *(CHROMIUM, "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
            *("--disable-background-networking", "--window-size=600,900", "--virtual-time-budget=2000"),
            *(f"--user-data-dir={tmp_path / 'profile'}", f"--screenshot={tmp_path / 'shot.png'}"),
            (tmp_path / "surface.html").as_uri(),
        ],
        check=True,
        capture_output=True,
        timeout=240,
    )
    shot = cv2.imread(str(tmp_path / "shot.png"))[..., ::-1].astype(int)
    # Dark and bright of the Viridis scale, and the mark of the brightest pixel.
    blue = (shot[..., 2] > shot[..., 1] + 20) & (shot[..., 2] > 50) & (shot.sum(-1) < 400)
    yellow = (shot[..., 0] > 170) & (shot[..., 1] > 170) & (shot[..., 2] < 110)
    assert blue.sum() > 2000
    assert yellow.sum() > 2000


def _book(result):
    return openpyxl.load_workbook(BytesIO(result_workbook(result, TIME)))


def test_json_and_sheet_hold_the_numbers_of_the_evaluation():
    result = _result(_reported())
    values = json.loads(envelope_json(result))
    Draft202012Validator(schema()).validate(values)
    rows = values["tables"]["cdp"]["rows"]
    assert len(rows) == 2 * (4 + 4)
    found = _reported()[0].evaluation.pairs[0].result
    one, row = found.results[1], rows[1]
    assert (row["picture"], row["bright"], row["dark"]) == ("1.exr", "bright", HOSTILE)
    assert (row["contrast"], row["contrast_origin"], row["tolerance_above"]) == (1.0, "given", 0.5)
    assert (row["cdp"], row["cdp_low"], row["cdp_high"]) == (one.result.cdp, *one.confidence_interval)
    assert (row["measured_contrast"], row["u_csnr"]) == (found.contrast.value, found.csnr.standard_error)
    assert row["expanded_measured_contrast"] == pytest.approx(1.96 * row["u_measured_contrast"], rel=1e-4)
    assert (rows[4]["pair"], rows[4]["csnr"]) == ("nearest-neighbour, (5, 5) to (60, 50)", None)
    regions = values["tables"]["regions"]["rows"]
    assert [row["region"] for row in regions[:2]] == [HOSTILE, "bright"]
    assert regions[0]["snr"] == found.b.snr.value
    assert [row["failure"] for row in values["tables"]["pictures"]["rows"]] == [None, None, "bad.png is empty"]
    sheet = [[cell.value for cell in line] for line in _book(result)["cdp"].iter_rows()]
    assert sheet[2][sheet[0].index("CDP")] == pytest.approx(row["cdp"], rel=1e-14)


def test_of_several_pictures_a_sheet_has_a_column_a_picture_as_in_the_thesis():
    book = _book(_result(_reported()))
    near = [[cell.value for cell in line] for line in book["cdp nearest-neighbour"].iter_rows()]
    assert near[0] == ["target contrast (%)", "1 1.exr", "2 2.exr", "3 bad.png"]
    rows = [[cell.value for cell in line] for line in book.worksheets[3].iter_rows()]
    assert [row[0] for row in rows[1:]] == [0.5, 1, 2, 3]
    expected = [one.result.cdp for one in _reported()[1].evaluation.pairs[0].result.results]
    assert [row[2] for row in rows[1:5]] == pytest.approx(expected, rel=1e-14)
    assert [row[3] for row in rows[1:5]] == [None] * 4
