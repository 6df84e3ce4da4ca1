"""Numbers as text, and one result object rendered as text, page, spreadsheet, JSON and Dataset."""

from contextlib import closing
from datetime import UTC, datetime
from decimal import Decimal
from io import BytesIO
from math import inf, nan

import numpy as np
import openpyxl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.result import Finding, InputFile, NamedValue, Result, error, info, quantity_table, unique, warning
from labcdp.core.table import Column, Table, variables_of
from labcdp.report import text as digits
from labcdp.report.files import envelope, envelope_json
from labcdp.report.html import render_page
from labcdp.report.layout import Card, Page, ReportFigure, Section, facts_table
from labcdp.report.sheets import result_workbook

from ..conftest import CHROMIUM, valid

TIME = datetime(2026, 1, 2, tzinfo=UTC)
COLUMNS = (
    Column("patch", "patch"),
    Column("luminance_cd_m2", "luminance", "cd/m²", "Mean of the patch.", expanded="expanded_cd_m2"),
    Column("expanded_cd_m2", "U (95 %)", "cd/m²", "Expanded uncertainty.", shown=False),
    Column("cdp", "CDP", low="cdp_low", high="cdp_high"),
    *(Column(f"cdp_{end}", f"CDP, {end}", shown=False) for end in ("low", "high")),
    Column("contrast", "contrast", "%", "Weber contrast."),
    Column("exposure_s", "exposure", "s", time=True),
)
ROW = {"patch": "=1+1", "luminance_cd_m2": 103.456, "expanded_cd_m2": 2.04, "cdp": 0.85912, "cdp_low": 0.851,
       "cdp_high": 0.866, "contrast": 2.78, "exposure_s": 0.0123}  # fmt: skip
OTHER = {"patch": "<b>", "luminance_cd_m2": np.float64(1e-4), "cdp": nan, "contrast": inf}


@given(st.floats(1e-9, 1e9), st.integers(1, 6))
def test_shows_the_significant_digits_of_decimal_arithmetic(value, n):
    # Decimal's g rounds half to even on the exact value, as round() does.
    expected = Decimal(f"{Decimal(value):.{n}g}")
    assert abs(Decimal(str(round(value, digits.decimals(value, n)))) - expected) <= expected * Decimal(10) ** -12
    assert digits.decimals(value, n) == n - 1 - expected.adjusted()


@pytest.mark.parametrize(
    ("shown", "arguments", "text"),
    [
        # JCGM 100:2008, 7.2.4: m_S = (100.021 47 +- 0.000 79) g
        (digits.with_half_width, (100.021472, 0.00079), "100.02147 ± 0.00079"),
        (digits.with_half_width, (5.0, 0.0996), "5.00 ± 0.10"),
        (digits.with_half_width, (-0.004, 0.5), "0.00 ± 0.50"),
        (digits.with_half_width, (4.0, float("inf")), "4.00 ± unknown"),
        # A share near all is not called all.
        (digits.share_percent, (0.99972,), "99.972 %"),
        (digits.share_percent, (1 - 1e-8,), "more than 99.9999 %"),
        (digits.shortened, ("a\x00b\ud800cd", 5), "a\ufffdb\ufffd…"),
    ],
)
def test_numbers_are_shown_with_the_digits_that_count(shown, arguments, text):
    assert shown(*arguments) == text


@pytest.fixture
def result(monkeypatch):
    monkeypatch.setitem(digits.templates(), "test-note", "patch {subject} is at {share:percent}")
    table = Table.of_items("patches", "Patches", COLUMNS, [ROW, OTHER])
    return Result("evaluate", "a & b", (table,), (info("test-note", "<i>", share=0.5),), seed=1)


def test_text_json_sheet_and_dataset_of_a_table(result):
    _, rows = digits.text_table(result.table("patches"))
    assert rows[0] == ["=1+1", "103.5 ± 2.0", "0.8591 (0.8510 to 0.8660)", "278.0", "12.3 ms"]
    assert rows[1] == ["<b>", "0.0001000", "-", "∞", "-"]
    values = valid(envelope(result))
    first, second = values["tables"]["patches"]["rows"]
    assert (first, second["cdp"], second["contrast"]) == (ROW, None, None)
    assert values["findings"][0]["text"] == "patch <i> is at 50 %"
    assert "NaN" not in envelope_json(result)
    data = result_workbook(result, TIME)
    assert data == result_workbook(result, TIME)
    sheet = openpyxl.load_workbook(BytesIO(data))["patches"]
    assert [cell.value for cell in sheet[2]] == list((ROW | {"contrast": 278.0}).values())
    assert (sheet["A2"].data_type, sheet["D3"].value) == ("s", None)
    np.testing.assert_array_equal(result.table("patches").to_dataset()["luminance_cd_m2"], [103.456, 1e-4])
    assert [*Table("size", "", (Column("px", ""),), {"px": [(1, 2), None]}).to_dataset()["px"].values] == ["(1, 2)", ""]
    ((dims, found, _),) = variables_of((Column("x", "", value="0"),), ("a", "b"), [[(1, 2), (3, 4)]]).values()
    assert (dims, found.tolist()) == (("a", "b"), [[1, 3]])


def test_a_quantity_in_percent_is_a_fraction_in_data():
    quantities = (NamedValue("PRNU", 0.0123, "%", u=0.0005), NamedValue("K", 0.5, "DN/e⁻", u=0.01))
    table = quantity_table("quantities", "Quantities", quantities)
    assert [row[1] for row in digits.text_table(table)[1]] == ["1.230 ± 0.098", "0.500 ± 0.020"]
    result = Result("characterise", "a", (table,))
    rows = envelope(result)["tables"]["quantities"]["rows"]
    found = [(row["value"], row["u_value"], row["unit"]) for row in rows]
    assert found == [(0.0123, 0.0005, "1"), (0.5, 0.01, "DN/e⁻")]
    # What another program reads of a sheet is in the unit that stands there, and the sheet says so.
    book = openpyxl.load_workbook(BytesIO(result_workbook(result, TIME)))
    head, prnu, k = book["quantities"].iter_rows(values_only=True)
    values = dict(zip(head, prnu, strict=True))
    assert (values["value"], values["u of value"], values["unit"]) == (1.23, 0.05, "%")
    assert dict(zip(head, k, strict=True))["value"] == 0.5
    assert "37 %" in str(book["about"]["D2"].value)


@pytest.mark.parametrize(
    ("value", "n_digits", "text"),
    [(1.723e-60, 4, "1.723e-60"), (-1.5e-12, 2, "-1.5e-12"), (0.000123456, 4, "0.0001235"), (0.0, 4, "0.0000")],
)
def test_a_tiny_number_has_an_exponent_and_no_tens_of_zeros(value, n_digits, text):
    assert digits.significant(value, n_digits) == text
    table = Table("t", "T", (Column("x", "x", digits=n_digits),), {"x": [value]})
    assert digits.text_table(table)[1] == [[text]]
    sheet = openpyxl.load_workbook(BytesIO(result_workbook(Result("demo", "a", (table,)), TIME)))["t"]
    assert sheet["A2"].value == value
    assert len(sheet["A2"].number_format) < 12


def test_a_wide_sheet_is_printed_on_several_pages_of_a_readable_size():
    columns = [Column(f"x{number}", f"a head of some length {number}") for number in range(40)]
    table = Table.of_items("wide", "Wide", columns, [{one.name: 1.5 for one in columns}])
    sheet = openpyxl.load_workbook(BytesIO(result_workbook(Result("demo", "a", (table,)), TIME)))["wide"]
    width = sum(sheet.column_dimensions[letter].width for letter in sheet.column_dimensions)
    # Excel shrinks to fit: 7 pixels of 1/96 inch a character at 100 %, on 297 mm less the margins.
    scale = 10.9 * 96 / 7 * sheet.page_setup.fitToWidth / max(width, 40 * 9)
    assert scale > 0.65
    assert (sheet.page_setup.paperSize, sheet.print_title_cols) == (9, "$A:$A")


def test_a_page_escapes_all_text_and_shows_warnings_before_the_answer(result):
    page = Page(
        "report", "<script>x</script>", cards=(Card("<b>pair</b>", "0.859", verdict="detected", state="good"),),
        lead=(ReportFigure("a.png", b"png", "<u>caption</u>", "text"), result.table("patches")),
        findings=(*result.findings, warning("test-note", "P1", share=0.25)),
        sections=(Section("Details", ("<p>text", facts_table((("<dt>", "<dd>"),))), collapsed=True),),
    )  # fmt: skip
    html = render_page(page)
    for text in ("<script>x", "<b>pair", "<u>caption", "<p>text", "<dt><", "patch <i>"):
        assert text not in html
    assert html.index("Patch P1 is at 25") < html.index("0.859") < html.index("Details") < html.index("Notes (1)")


def test_each_finding_stands_once_with_the_severe_ones_first_and_inputs_have_hashes(tmp_path):
    first, second = info("a"), Finding("b", "error")
    assert unique([first, second, first, warning("c")]) == (second, warning("c"), first)
    (tmp_path / "a").write_bytes(b"abc")
    # FIPS 180-2, appendix B.1
    assert InputFile.of("picture", tmp_path / "a").sha256.startswith("ba7816bf8f01cfea")
    with pytest.raises(InputError, match="cannot be read"):
        InputFile.of("picture", tmp_path / "b")


def test_several_findings_of_one_kind_are_one_line_and_failures_of_other_reasons_are_not(monkeypatch):
    monkeypatch.setitem(digits.templates(), "test-note", "patch {subject} is at {share:percent}")
    notes = [warning("test-note", f"P{number}", share=number / 100) for number in range(1, 14)]
    files = [error("picture-failed", name, reason=f"{name} is {why}") for name, why in
             [("a.png", "empty"), ("b.png", "cut off"), ("c.png", "empty")]]  # fmt: skip
    found = digits.finding_lines([*notes, *files, info("test-note", "Q", share=0.5)])
    assert [severity for severity, _ in found] == ["error", "error", "warning", "info"]
    (_, empty), (_, cut), (_, note), (_, alone) = found
    assert "a.png" in empty
    assert "c.png" in empty
    assert "b.png" not in empty
    assert "b.png" in cut
    # How many there are, and what they are about, of which a long list is cut short.
    assert all(text in note for text in ("patch P1 is at 1 %", "12 more", "P2, P3", "and 4 more"))
    assert alone == "patch Q is at 50 %"


@pytest.mark.parametrize(
    ("kind", "tab"),
    [
        ("Contrast detection probability (CDP) of a picture", "CDP of a picture: night.png"),
        ("map of contrast detection probability", "Map of CDP: night.png"),
        ("Calibration of a camera", "Calibration of a camera: night.png"),
    ],
)
def test_tabs_of_a_browser_say_which_page_they_are(kind, tab):
    assert f"<title>{tab} - labcdp</title>" in render_page(Page(kind, "night.png"))


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
def test_long_names_wrap_in_the_table_beside_the_picture(browser):
    # Heads and values as wide as those of a video.
    heads = ("Weber contrast (%)", "detected (%)", "interval includes limit (%)", "evaluated frames", "lost frames",
             "mean CDP", "lowest CDP", "in frame")  # fmt: skip
    shares = [Column(f"x{number}", head) for number, head in enumerate(heads)]
    columns = (Column("pair", "bright / dark region"), *shares)
    numbers = {column.name: 1000 for column in shares}
    rows = [{**numbers, "pair": "sign of the wall behind the delivery van / board"}, {**numbers, "pair": "W" * 60}]
    table = Table.of_items("shares", "CDP over the evaluated frames", columns, rows)
    html = render_page(Page("report", "drive.mp4", lead=(ReportFigure("a.png", b"png", "CDP", "CDP"), table)))
    with closing(browser.new_page(viewport={"width": 1280, "height": 800})) as page:
        page.set_content(html)
        cut_px = page.evaluate("(e => e.scrollWidth - e.clientWidth)(document.querySelector('.lead .wide'))")
    assert cut_px == 0
