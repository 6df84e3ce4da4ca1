"""The report of a calibration: complete, escaped, true to the numbers, the same on page and sheets."""

from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO

import pytest
from openpyxl import load_workbook

from labcdp.calibration.budget import budget, combined
from labcdp.calibration.colour import ColourCalibration, CombinationStep
from labcdp.calibration.colour_budget import colour_budget
from labcdp.calibration.findings import FitTest, LeftOut, ModelStep
from labcdp.calibration.verify import verify
from labcdp.report.calibration_budget import PATCH_PIXELS
from labcdp.report.calibration_page import calibration_document, combination_document
from labcdp.report.calibration_results import write_calibration_report
from labcdp.report.calibration_sheets import combination_sheets
from labcdp.report.page import document_page
from labcdp.report.workbook import workbook
from labcdp.response import Response
from labcdp.vignetting import RadialVignetting


class Page(HTMLParser):
    """Elements, tables as text, and all text."""

    def __init__(self, html):
        super().__init__()
        self.elements, self.tables, self.text, self._cell = [], [], "", False
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        self._cell = tag in ("td", "th")

    def handle_endtag(self, tag):
        self._cell = False

    def handle_data(self, data):
        self.text += data
        if self._cell:
            self.tables[-1][-1][-1] += data

    def named(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


def assert_percent(cell, fraction):
    """A cell holds a fraction in percent, rounded to three decimals."""
    assert float(cell.removeprefix("± ")) == pytest.approx(100 * fraction, abs=0.0005001)


@pytest.fixture(scope="module")
def calibration(evaluation):
    """The evaluation's calibration, with all kinds of findings."""
    fitted = evaluation.calibration
    first, *rest = fitted.residuals
    return replace(
        fitted,
        residuals=tuple(rest),
        held_out=(first,),
        left_out=(
            LeftOut("<b>bold</b>", 0.02, None, "is saturated"),
            LeftOut("<b>bold</b>", 0.2, None, "is saturated"),
            LeftOut("=1+1", None, 2, "reading 2 contradicts the others"),
        ),
        ladder=(
            ModelStep("linear", 1, 0.012, False, "leaves a bend"),
            ModelStep("quadratic", 2, 0.004, True, "predicts held-out patches best"),
        ),
        tests=(
            FitTest("glare", 0.012, 0.002, "cd/m^2", True, "light from elsewhere: shade the lens"),
            FitTest("drift", 0.0, 0.0, "1/h", False, "not testable: one time only"),
        ),
        response=Response("quadratic", (0.0, 4000.0), (0.0, 4200.0)),
    )


@pytest.fixture(scope="module")
def written(calibration, tmp_path_factory):
    folder = tmp_path_factory.mktemp("calibration")
    paths = write_calibration_report(calibration, folder, "Title <i>here</i>")
    assert [path.name for path in paths] == ["calibration.html", "calibration.xlsx"]
    return folder


@pytest.fixture(scope="module")
def page(written):
    return Page((written / "calibration.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def book(written):
    return load_workbook(BytesIO((written / "calibration.xlsx").read_bytes()))


def table(page, head):
    return next(rows for rows in page.tables if rows[0][0] == head[0] and rows[0][1] == head[1])


def test_everything_is_escaped_and_inside(page):
    names = {name for name, _ in page.elements}
    assert not names & {"script", "link", "b", "i", "iframe"}
    for image in page.named("img"):
        assert image["src"].startswith("data:image/png;base64,")
        assert image["alt"]
    assert len(page.named("img")) == 3
    assert "Title <i>here</i>" in page.text


def test_plain_words_come_first(page, calibration):
    start = page.text[: page.text.index("Patches of the fit")]
    assert "measures luminance from" in start
    assert "is known to ±" in start
    assert "1 patch that the fit was not shown" in start
    assert "Test of glare: light from elsewhere: shade the lens" in start
    assert "Simulated: camera" in start


def test_budget_says_what_the_calibration_says(page, calibration):
    rows = {row[0]: row for row in table(page, ("source", page.tables[-1][0][1]))}
    low, high = calibration.range_cd_m2
    for column, luminance in ((1, low), (2, (low * high) ** 0.5), (3, high)):
        at = budget(calibration, luminance, n_pixels=PATCH_PIXELS)
        whole = combined(at, len(calibration.residuals))
        assert_percent(rows["combined standard uncertainty"][column], whole.standard_uncertainty_rel)
        assert_percent(rows["95 % half width"][column], whole.expanded_95_rel)
        for row in at:
            if row.included and 100 * row.standard_uncertainty_rel > 0.001:
                assert_percent(rows[row.source][column], row.standard_uncertainty_rel)
    assert rows["meter scale"][-1] == "yes"
    assert rows["meter digits"][-1] == "in another row"
    assert rows["meter f1'"][1:4] == ["-", "-", "-"]


def test_models_tests_and_what_was_left_out(page):
    assert ["quadratic", "2", "0.40", "yes"] in table(page, ("model", "parameters"))
    tests = table(page, ("test", "deviation, with 95 % half width"))
    assert ["glare", "0.0120 ± 0.0039", "cd/m²", "yes"] in tests
    assert ["drift", "-", "1/h", "not tested"] in tests
    assert "patch <b>bold</b>, 20 ms, 200 ms" in page.text
    assert "patch =1+1, reading 2" in page.text
    assert "h(DN - d(t)) = R t V(x, y) L" in page.text


def test_sheets_hold_numbers(book, calibration):
    assert book.sheetnames == [
        "Summary",
        "Patches",
        "Models",
        "Tests",
        "Budget",
        "Left out",
        "Facts",
        "Provenance",
    ]
    patches = list(book["Patches"].iter_rows(min_row=2, values_only=True))
    assert [row[1] for row in patches] == ["fit"] * 5 + ["held out"]
    for cells, row in zip(patches, (*calibration.residuals, *calibration.held_out), strict=True):
        assert cells[0] == row.patch
        assert cells[3] == pytest.approx(row.reading_cd_m2)
        assert cells[6] == pytest.approx(100 * row.residual_rel)
    budgets = list(book["Budget"].iter_rows(min_row=2, values_only=True))
    low = budget(calibration, calibration.range_cd_m2[0], n_pixels=PATCH_PIXELS)
    for cells, row in zip(budgets, low, strict=False):
        assert cells[2] == row.source
        assert cells[3] == pytest.approx(100 * row.standard_uncertainty_rel)
    # No text became a formula.
    assert all(cell.data_type != "f" for sheet in book for line in sheet.iter_rows() for cell in line)


def test_a_measured_fall_off_and_a_plain_calibration(calibration):
    plain = replace(
        calibration,
        response=Response(),
        ladder=(),
        tests=(),
        held_out=(),
        left_out=(),
        vignetting=RadialVignetting(-0.2, 0.01, 0.0, slow_rel=0.004),
    )
    page = Page(document_page(calibration_document(plain)))
    for title in ("Models", "Tests", "Held-out patches", "Left out"):
        assert title not in [row[0] for rows in page.tables for row in rows]
    assert len(page.named("img")) == 2
    assert "1 - 0.200 r² + 0.0100 r⁴ + 0" in page.text
    assert "no patch was held out to test it" in page.text


@pytest.fixture(scope="module")
def colour(calibration):
    planes = tuple(replace(calibration, state=replace(calibration.state, plane=p)) for p in ("R", "Gr", "Gb", "B"))
    return ColourCalibration(
        planes=planes,
        weights=(0.2, 0.3, 0.3, 0.2),
        weight_covariance=((1e-4, 0.0, 0.0, 0.0), (0.0, 1e-4, 0.0, 0.0), (0.0, 0.0, 1e-4, 0.0), (0.0, 0.0, 0.0, 1e-4)),
        spectral_rel=0.01,
        scatter_rel=0.0,
        range_cd_m2=calibration.range_cd_m2,
        residuals=calibration.residuals,
        held_out=calibration.held_out,
        left_out=calibration.left_out,
        ladder=(
            CombinationStep("combination", 0.004, True, "predicts best"),
            CombinationStep("green", 0.02, False, "misled by colour"),
        ),
        sensitivity=None,
        f1_prime=0.12,
        warnings=("R: a warning",),
    )


def test_colour_planes(colour, calibration):
    page = Page(document_page(combination_document(colour)))
    assert [row[:2] for row in table(page, ("plane", "weight"))[1:]] == [
        ["R", "+0.200"],
        ["Gr", "+0.300"],
        ["Gb", "+0.300"],
        ["B", "+0.200"],
    ]
    assert ["combination", "0.40", "yes"] in table(page, ("luminance from", page.tables[3][0][1]))
    assert "12.0 %" in page.text
    assert "R: a warning" in page.text
    book = load_workbook(BytesIO(workbook(combination_sheets(colour), "t", calibration.provenance.measured)))
    assert book.sheetnames[:4] == ["Planes", "Combination", "Budget", "R Summary"]
    assert [cell.value for cell in book["Planes"]["B"]][1:] == [0.2, 0.3, 0.3, 0.2]


def test_budget_of_the_combination_says_what_the_calibration_says(colour, calibration):
    page = Page(document_page(combination_document(colour)))
    rows = {row[0]: row for row in next(rows for rows in page.tables if rows[0][0] == "source")}
    low, high = colour.range_cd_m2
    for column, luminance in ((1, low), (2, (low * high) ** 0.5), (3, high)):
        at = colour_budget(colour, luminance, n_groups=PATCH_PIXELS // 4)
        whole = combined(at, len(calibration.residuals))
        assert_percent(rows["combined standard uncertainty"][column], whole.standard_uncertainty_rel)
        assert_percent(rows["95 % half width"][column], whole.expanded_95_rel)
        for row in at:
            if row.included and 100 * row.standard_uncertainty_rel > 0.001:
                assert_percent(rows[row.source][column], row.standard_uncertainty_rel)
    assert rows["fit"][6] == rows["meter scale"][6] == "yes"
    assert rows["shot and read noise"][6] == "no"
    assert "The mean over a grey patch of 1000 pixels in the middle of the image" in page.text
    assert "0.01 times the standard deviation of its red, green and blue" in page.text
    book = load_workbook(BytesIO(workbook(combination_sheets(colour), "t", calibration.provenance.measured)))
    cells = list(book["Budget"].iter_rows(min_row=2, values_only=True))
    for row, expected in zip(cells, colour_budget(colour, low, n_groups=PATCH_PIXELS // 4), strict=False):
        assert row[2] == expected.source
        assert row[3] == pytest.approx(100 * expected.standard_uncertainty_rel)
        assert row[6] == ("yes" if expected.common else "no")


def test_a_verification_of_the_very_same_measurement(evaluation):
    observed = evaluation.observed
    observations = [o for group in observed.patches.values() for o in group]
    result = verify(evaluation.calibration, observations, observed.darks, observed.readings)
    assert result.verdict == "valid"
