"""The result of a session: one set of numbers in JSON, sheet, Dataset and page."""

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.calibration import Calibration
from labcdp.core.finding import info, warning
from labcdp.core.result import Result
from labcdp.evaluate.bench.calibration.result import summarised
from labcdp.evaluate.bench.report.figures import ReportFigures
from labcdp.evaluate.bench.report.page import session_page
from labcdp.evaluate.bench.report.result import session_result
from labcdp.evaluate.bench.session import SessionEvaluation
from labcdp.report.envelope import envelope, schema
from labcdp.report.figures import ReportFigure
from labcdp.report.html import render_page

CHROMIUM, SOFFICE = shutil.which("chromium"), shutil.which("soffice")


class Elements(HTMLParser):
    """Elements with their attributes, and all text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def page(written: Path) -> Elements:
    return Elements((written / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def rendered() -> Callable[[SessionEvaluation], str]:
    """Return a function that renders the text of a page, without its pictures."""
    figure = ReportFigure("x.png", b"", "caption", "alternative")

    def render(evaluation: SessionEvaluation) -> str:
        figures = ReportFigures(figure, figure, (), ())
        return Elements(render_page(session_page(evaluation, session_result(evaluation), figures))).text

    return render


def codes(result: Result) -> set[str]:
    return {finding.code for finding in result.findings}


def test_json_follows_the_schema_and_holds_the_evaluation(
    evaluation: SessionEvaluation, result: Result, written: Path
) -> None:
    values = json.loads((written / "results.json").read_text(encoding="utf-8"))
    Draft202012Validator(schema()).validate(values)
    assert values == json.loads(json.dumps(envelope(result)))
    assert values["simulated"] is True
    for row, expected in zip(values["tables"]["contrasts"]["rows"], evaluation.contrasts, strict=True):
        assert (row["bright"], row["dark"]) == (expected.bright, expected.dark)
        assert (row["cdp"], row["below"], row["above"]) == (expected.cdp.cdp, expected.cdp.below, expected.cdp.above)
        assert (row["cdp_low"], row["cdp_high"]) == expected.cdp.confidence_interval
        assert row["measured_contrast"] == expected.measured_contrast
        assert row["u_camera_contrast"] == expected.camera_standard_uncertainty
        assert row["expanded_camera_contrast"] == expected.camera_half_width_95
    patches = {row["patch"]: row for row in values["tables"]["luminance"]["rows"]}
    for patch in evaluation.patches:
        row, u = patches[patch.region.name], patch.calibrated.half_width_95_rel
        assert row["measured_cd_m2"] == patch.measured_cd_m2
        assert row["calculated_cd_m2"] == patch.calculated_cd_m2
        assert row["calibrated_cd_m2"] == patch.calibrated.luminance_cd_m2
        assert row["expanded_calibrated_cd_m2"] == pytest.approx(u * row["calibrated_cd_m2"], rel=1e-12)
        assert row["deviation_rel"] == pytest.approx(row["calibrated_cd_m2"] / row["measured_cd_m2"] - 1, abs=1e-15)


def test_patches_are_sorted_by_luminance(result: Result) -> None:
    for table, column in (("luminance", "measured_cd_m2"), ("calibration_patches", "meter_cd_m2")):
        values = list(result.table(table)[column])
        assert values == sorted(values)


def test_the_sheet_and_the_dataset_have_the_same_numbers(result: Result, written: Path) -> None:
    book = openpyxl.load_workbook(written / "results.xlsx")
    assert book.sheetnames == [*(table.name for table in result.tables), "findings", "about"]
    for table in result.tables:
        cells = list(book[table.name].iter_rows(min_row=2, values_only=True))
        for line, row in zip(cells, table.rows(), strict=True):
            assert tuple(None if cell == "" else cell for cell in line) == tuple(map(_cell, row.values()))
        assert not [cell for line in book[table.name].iter_rows() for cell in line if cell.data_type == "f"]
    dataset = result.table("contrasts").to_dataset()
    assert list(dataset["cdp"].values) == list(result.table("contrasts")["cdp"])


def _cell(value: Any) -> Any:
    """Return what a sheet has: text as text, numbers within the 16 digits of the file."""
    if isinstance(value, bool | str):
        return {True: "yes", False: "no", "": None}.get(value, value)
    return None if value is None else pytest.approx(value, rel=1e-14, abs=0)


@pytest.mark.skipif(SOFFICE is None, reason="soffice (LibreOffice) is not installed")
def test_libreoffice_opens_the_spreadsheet(written: Path, evaluation: SessionEvaluation, sheets_by_libreoffice) -> None:
    _, *rows = sheets_by_libreoffice(written / "results.xlsx")["luminance"]
    assert len(rows) == len(evaluation.patches)


def test_the_limit_of_the_cdp_decides_what_is_detected(evaluation: SessionEvaluation) -> None:
    row = next(row for row in evaluation.contrasts if 0.01 < row.cdp.cdp < 0.99)
    low, high = row.cdp.confidence_interval
    verdicts = [replace(row, cdp_limit=limit).verdict for limit in (low / 2, (low + high) / 2, (1 + high) / 2)]
    assert verdicts == ["detected", "undecided", "not detected"]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda c: c, "not-checked"),
        (lambda c: replace(c, residuals=c.residuals[1:]), "checked-by-held-out"),
        (
            lambda c: replace(c, provenance=replace(c.provenance, input_sha256="0" * 64)),
            "checked-by-another-measurement",
        ),
    ],
)
def test_says_whether_deviations_check_the_calibration(
    evaluation: SessionEvaluation, change: Callable[[Calibration], Calibration], code: str
) -> None:
    assert code in codes(session_result(replace(evaluation, calibration=change(evaluation.calibration))))


def test_the_page_answers_first(page: Elements, evaluation: SessionEvaluation) -> None:
    positions = [page.text.index(text) for text in ("Simulated data", "95\u00a0% interval", "CDP, 95", "Calibration")]
    assert positions == sorted(positions)
    assert page.text.count("target contrast") >= len(evaluation.contrasts)


def test_a_warning_stands_on_top_of_the_page_once(
    evaluation: SessionEvaluation, rendered: Callable[[SessionEvaluation], str]
) -> None:
    odd = warning("readings-scatter", "lamp & <shade> flickers", scatter_rel=0.1)
    text = rendered(replace(evaluation, findings=(odd, odd, *evaluation.findings)))
    assert text.count("lamp & <shade>") == 1
    assert text.index("lamp & <shade>") < text.index("95\u00a0% interval")


def test_an_unknown_interval_is_null_in_json_and_missing_on_the_page(
    evaluation: SessionEvaluation, rendered: Callable[[SessionEvaluation], str]
) -> None:
    nan = float("nan")
    row = evaluation.contrasts[0]
    unknown = replace(
        row.calibrated_cdp,
        result=replace(row.cdp, standard_error=nan, confidence_interval=(nan, nan)),
        confidence_interval=(nan, nan),
    )
    changed = replace(evaluation, contrasts=[replace(row, calibrated_cdp=unknown)])
    found = envelope(session_result(changed))["tables"]["contrasts"]["rows"][0]
    assert found["cdp_low"] is found["cdp_high"] is found["u_cdp_pixels"] is None
    assert "95\u00a0% interval " not in rendered(changed)


def test_the_page_needs_nothing_else_and_escapes_all_text(page: Elements, written: Path) -> None:
    for tag, attributes in page.elements:
        assert tag not in ("script", "link", "iframe", "object", "base", "b", "i", "em")
        assert not {"href", "srcset", "action", "style"} & set(attributes)
        assert not any(name.startswith("on") for name in attributes)
        assert (attributes.get("src") or "data:image/png;base64,").startswith("data:image/png;base64,")
    html = (written / "report.html").read_text(encoding="utf-8")
    assert html.count("</style>") == 1
    assert "{{ 7 * 7 }}" in page.text
    assert "Test <i>session</i>" in page.text
    images = [attributes for tag, attributes in page.elements if tag == "img"]
    assert len(images) == len(list((written / "figures").iterdir())) == 5
    assert all(len(image["alt"] or "") > 20 for image in images)


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
@pytest.mark.parametrize("width", [400, 1280])
def test_every_picture_loads_and_nothing_is_wider_than_the_window(written: Path, tmp_path: Path, width: int) -> None:
    # A copy of the page that may run a script, which leaves what it measures in the title.
    script = (
        "<script>onload = () => { document.title = JSON.stringify([innerWidth, document.documentElement.scrollWidth,"
        " ...Array.from(document.images, i => i.naturalWidth)]) }</script></body>"
    )
    html = (written / "report.html").read_text(encoding="utf-8")
    html = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", html).replace("</body>", script)
    (tmp_path / "page.html").write_text(html, encoding="utf-8")
    arguments = ("--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", f"--window-size={width},900")
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    command = ["chromium", *arguments, profile, (tmp_path / "page.html").as_uri()]
    dom = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout
    found = re.search(r"<title>\[(.*)\]</title>", dom)
    assert found is not None
    inner, scrolled, *pictures = map(int, found[1].split(","))
    assert scrolled <= inner
    assert len(pictures) == 5
    assert min(pictures) > 800


def test_exposures_left_out_in_bracketing_are_one_note() -> None:
    found = [info("exposure-saturated", name, exposures_s=[0.5]) for name in ("P1", "P2")]
    assert summarised([*found, warning("few-patches", count=3, advised=6)]) == (
        warning("few-patches", count=3, advised=6),
        info("exposures-left-out", patches=["P1", "P2"]),
    )
