"""The page: complete, escaped, in need of nothing else, and true to the evaluation."""

import base64
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from labcdp.calibration import Calibration
from labcdp.evaluate import SessionEvaluation
from labcdp.report.figures import ReportFigure, ReportFigures
from labcdp.report.page import html_page

CHROMIUM = shutil.which("chromium")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


class Page(HTMLParser):
    """Elements with their attributes, tables as text, and all text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.tables: list[list[list[str]]] = []
        self.text = ""
        self._cell = False
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        self._cell = tag in ("td", "th")

    def handle_endtag(self, tag: str) -> None:
        self._cell = False

    def handle_data(self, data: str) -> None:
        self.text += data
        if self._cell:
            self.tables[-1][-1][-1] += data

    def named(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def page(written: Path) -> Page:
    return Page((written / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def no_figures() -> ReportFigures:
    """Stand-ins where the pictures do not matter."""
    figure = ReportFigure("x.png", b"", "caption", "alternative")
    return ReportFigures(figure, figure, figure, ())


def numbers(cell: str) -> list[tuple[float, float]]:
    """Numbers in a cell, each with half a unit of its last digit."""
    found = re.findall(r"[+-]?\d+(?:\.(\d+))?", cell)
    values = re.findall(r"[+-]?\d+(?:\.\d+)?", cell)
    return [(float(value), 0.5000001 * 10 ** -len(places)) for value, places in zip(values, found, strict=True)]


def assert_shown(cell: str, *expected: float) -> None:
    shown = numbers(cell)
    assert len(shown) == len(expected), cell
    for (value, tolerance), truth in zip(shown, expected, strict=True):
        assert abs(value - truth) <= tolerance, (cell, truth)


def test_nothing_is_loaded_from_elsewhere(page: Page) -> None:
    for tag, attributes in page.elements:
        assert tag not in ("script", "link", "iframe", "object", "base")
        assert not {"href", "srcset", "action", "style"} & set(attributes)
        assert not any(name.startswith("on") for name in attributes)
        assert (attributes.get("src") or "data:").startswith("data:image/png;base64,") or "src" not in attributes


def test_style_loads_nothing(written: Path) -> None:
    html = (written / "report.html").read_text(encoding="utf-8")
    style = html[html.index("<style>") : html.index("</style>")]
    assert "url(" not in style
    assert "@import" not in style


def test_every_picture_is_a_png_with_words_for_it(page: Page, written: Path) -> None:
    images = page.named("img")
    files = sorted((written / "figures").iterdir())
    assert len(images) == len(files) == 5
    inside = []
    for image in images:
        assert len(image["alt"] or "") > 20
        data = base64.b64decode((image["src"] or "").removeprefix("data:image/png;base64,"), validate=True)
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert 400 < picture.shape[0] < 2000
        assert 900 < picture.shape[1] < 2500
        inside.append(data)
    assert sorted(inside) == sorted(file.read_bytes() for file in files)


def test_language_title_viewport_and_headings(page: Page) -> None:
    assert page.named("html") == [{"lang": "en"}]
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in page.named("meta")
    assert len(page.named("title")) == len(page.named("h1")) == 1
    assert all(column["scope"] in ("col", "row") for column in page.named("th"))


def test_patches_are_those_of_the_evaluation(page: Page, evaluation: SessionEvaluation) -> None:
    _, *rows = page.tables[0]
    assert len(rows) == len(evaluation.patches) == 6
    for cells, row in zip(rows, evaluation.patches, strict=True):
        assert cells[0] == row.region.name
        assert row.calculated_cd_m2 is not None
        expected = (
            row.measured_cd_m2,
            row.calculated_cd_m2,
            row.calibrated.luminance_cd_m2,
            100 * (row.calibrated.luminance_cd_m2 / row.measured_cd_m2 - 1),
            100 * row.calibrated.half_width_95_rel,
        )
        for cell, value in zip(cells[1:], expected, strict=True):
            assert_shown(cell, value)


def test_contrasts_are_those_of_the_evaluation(page: Page, evaluation: SessionEvaluation) -> None:
    _, *rows = page.tables[1]
    assert len(rows) == len(evaluation.contrasts) == 2
    for cells, row in zip(rows, evaluation.contrasts, strict=True):
        result = row.cdp
        assert cells[0] == f"{row.bright} / {row.dark}"
        assert_shown(cells[1], 100 * result.contrast)
        assert_shown(cells[2], *(100 * value for value in result.interval))
        assert_shown(cells[3], 100 * row.measured_contrast, 196 * row.measured_standard_uncertainty)
        assert_shown(cells[4], 100 * row.camera_contrast, 196 * row.camera_standard_uncertainty)
        assert_shown(cells[5], result.cdp, *result.confidence_interval)
        assert_shown(cells[6], result.below)
        assert_shown(cells[7], result.above)
        assert cells[8] == f"{row.exposure_s * 1e3:g} ms"


def test_residuals_are_those_of_the_calibration(page: Page, evaluation: SessionEvaluation) -> None:
    _, *rows = page.tables[2]
    for cells, row in zip(rows, evaluation.calibration.residuals, strict=True):
        assert cells[:2] == [row.patch, str(row.n_readings)]
        assert_shown(cells[2], row.reading_cd_m2, 1.96 * row.reading_random_cd_m2)
        assert_shown(cells[3], row.luminance_cd_m2)
        assert_shown(cells[4], 100 * row.residual_rel)
        assert_shown(cells[5], row.standardised_residual)


def test_what_was_simulated_stands_on_top(page: Page) -> None:
    banner = "Simulated: camera Manta_G-505B, luminance meter LS-110 and target."
    assert banner in page.text
    assert page.text.index(banner) < page.text.index("recorded on")


def test_a_real_bench_has_no_banner(real_evaluation: SessionEvaluation, no_figures: ReportFigures) -> None:
    html = html_page(real_evaluation, no_figures)
    assert 'class="banner"' not in html
    assert "Simulated:" not in html


def test_warnings_of_calibration_and_patches_stand_once_each(
    evaluation: SessionEvaluation, no_figures: ReportFigures
) -> None:
    odd = "lamp & <shade> flickers"
    first, *rest = evaluation.patches
    first = replace(first, calibrated=replace(first.calibrated, warnings=(odd, "patch is odd")))
    patches = [first, *(replace(row, calibrated=replace(row.calibrated, warnings=())) for row in rest)]
    text = Page(html_page(replace(evaluation, warnings=(odd,), patches=patches), no_figures)).text
    assert text.count(odd) == text.count("patch is odd") == 1
    assert "2 warnings" in text


def test_text_of_the_session_is_escaped(written: Path, page: Page) -> None:
    html = (written / "report.html").read_text(encoding="utf-8")
    for tag in ("<b>", "<i>", "<em>", "<img src=x"):
        assert tag not in html
    assert html.count("</style>") == 1
    assert "{{ 7 * 7 }}" in page.text
    assert "Test <i>session</i>" in page.text


def test_without_contrasts_the_page_says_so(evaluation: SessionEvaluation, no_figures: ReportFigures) -> None:
    page = Page(html_page(replace(evaluation, contrasts=[]), no_figures))
    assert "No contrast was asked for." in page.text
    assert len(page.tables) == 2


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda c: c, "calibrated with these very readings"),
        (lambda c: replace(c, residuals=c.residuals[1:]), "The deviations of <b>bold</b>, left out of the calibration"),
        (
            lambda c: replace(c, provenance=replace(c.provenance, input_sha256="0" * 64)),
            "The calibration comes from another measurement",
        ),
    ],
)
def test_says_whether_deviations_check_the_calibration(
    evaluation: SessionEvaluation,
    no_figures: ReportFigures,
    change: Callable[[Calibration], Calibration],
    sentence: str,
) -> None:
    changed = replace(evaluation, calibration=change(evaluation.calibration))
    assert sentence in Page(html_page(changed, no_figures)).text


def chromium(tmp_path: Path, page: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    assert CHROMIUM is not None
    quiet = "--disable-quic --no-first-run --disable-background-networking --disable-component-update --disable-sync"
    return subprocess.run(
        [
            CHROMIUM,
            *("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", *quiet.split()),
            *("--enable-logging=stderr", f"--user-data-dir={tmp_path / 'profile'}", *arguments, page.as_uri()),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )


def complaints(run: subprocess.CompletedProcess[str], page: Path) -> list[str]:
    """Lines of the console that come from the page; Chromium's own pages write there too."""
    return [line for line in run.stderr.splitlines() if "CONSOLE" in line and page.as_uri() in line]


@needs_chromium
def test_chromium_shows_the_page_without_complaint(written: Path, tmp_path: Path) -> None:
    shot = tmp_path / "shot.png"
    run = chromium(tmp_path, written / "report.html", f"--screenshot={shot}", "--window-size=1000,2500")
    assert complaints(run, written / "report.html") == []
    picture = cv2.imread(str(shot))
    assert picture is not None
    # The middle of the colour map viridis is in the page only if the luminance map is.
    teal = np.all(np.abs(picture[..., ::-1].astype(int) - (33, 145, 140)) < 12, axis=-1)
    assert teal.sum() > 200


@needs_chromium
def test_chromium_would_complain_about_something_from_elsewhere(written: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    html = (written / "report.html").read_text(encoding="utf-8")
    page.write_text(html.replace("<main>", '<main><img src="other.png">'), encoding="utf-8")
    assert len(complaints(chromium(tmp_path, page, "--dump-dom"), page)) == 1


@needs_chromium
@pytest.mark.parametrize("width", [400, 1100])
def test_every_picture_loads_and_nothing_is_wider_than_the_window(written: Path, tmp_path: Path, width: int) -> None:
    # A copy of the page that may run a script, which leaves what it measures in the title.
    script = (
        "<script>onload = () => { document.title = JSON.stringify([innerWidth, document.documentElement.scrollWidth,"
        " ...Array.from(document.images, i => i.naturalWidth)]) }</script></body>"
    )
    html = (written / "report.html").read_text(encoding="utf-8")
    html = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", html).replace("</body>", script)
    (tmp_path / "page.html").write_text(html, encoding="utf-8")
    dom = chromium(tmp_path, tmp_path / "page.html", "--dump-dom", f"--window-size={width},900").stdout
    found = re.search(r"<title>\[(.*)\]</title>", dom)
    assert found is not None
    inner, scrolled, *pictures = map(int, found[1].split(","))
    assert scrolled <= inner
    assert len(pictures) == 5
    assert min(pictures) > 900
