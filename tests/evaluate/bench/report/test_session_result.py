"""The result of a session: one set of numbers in JSON, sheet, Dataset and page; its files are whole or not there."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser

import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.evaluate.bench.session_result import session_result
from labcdp.report.files import envelope, schema

CHROMIUM = shutil.which("chromium")
FIGURES = ("target", "luminance", "contrasts-1", "calibration-fit", "calibration-residuals")


class Elements(HTMLParser):
    """Elements with their attributes, and all text."""

    def __init__(self, html):
        super().__init__()
        self.elements, self.text = [], ""
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data


def test_json_follows_the_schema_and_holds_the_evaluation(evaluation, result, written):
    values = json.loads((written / "results.json").read_text(encoding="utf-8"))
    Draft202012Validator(schema()).validate(values)
    assert values == json.loads(json.dumps(envelope(result)))
    assert values["simulated"] is True
    for row, expected in zip(values["tables"]["contrasts"]["rows"], evaluation.contrasts, strict=True):
        assert (row["cdp"], row["below"], row["above"]) == (expected.cdp.cdp, expected.cdp.below, expected.cdp.above)
        assert (row["cdp_low"], row["cdp_high"]) == expected.cdp.confidence_interval
        assert row["measured_contrast"] == expected.measured_contrast
    patches = {row["patch"]: row for row in values["tables"]["luminance"]["rows"]}
    for patch in evaluation.patches:
        row, u = patches[patch.region.name], patch.calibrated.half_width_95_rel
        seen = patch.measured_cd_m2, patch.calculated_cd_m2, patch.calibrated.luminance_cd_m2
        assert (row["measured_cd_m2"], row["calculated_cd_m2"], row["calibrated_cd_m2"]) == seen
        assert row["expanded_calibrated_cd_m2"] == pytest.approx(u * row["calibrated_cd_m2"], rel=1e-12)
        assert row["deviation_rel"] == pytest.approx(seen[2] / seen[0] - 1, abs=1e-15)


def test_the_sheet_has_the_same_numbers(result, written):
    book = openpyxl.load_workbook(written / "results.xlsx")
    assert book.sheetnames == [*(table.name for table in result.tables), "findings", "about"]
    for table in result.tables:
        cells = list(book[table.name].iter_rows(min_row=2, values_only=True))
        for line, row in zip(cells, table.rows(), strict=True):
            assert tuple(None if cell == "" else cell for cell in line) == tuple(map(_cell, row.values()))


def _cell(value):
    """Return what a sheet has: text as text, numbers within the 16 digits of the file."""
    if isinstance(value, bool | str):
        return {True: "yes", False: "no", "": None}.get(value, value)
    return None if value is None else pytest.approx(value, rel=1e-14, abs=0)


def test_the_limit_of_the_cdp_decides_what_is_detected(evaluation):
    row = next(row for row in evaluation.contrasts if 0.01 < row.cdp.cdp < 0.99)
    low, high = row.cdp.confidence_interval
    verdicts = [replace(row, cdp_limit=limit).verdict for limit in (low / 2, (low + high) / 2, (1 + high) / 2)]
    assert verdicts == ["detected", "undecided", "not detected"]


def test_says_whether_deviations_check_the_calibration(evaluation):
    fitted = evaluation.calibration
    for calibration, code in (
        (fitted, "not-checked"),
        (replace(fitted, residuals=fitted.residuals[1:]), "checked-by-held-out"),
        (replace(fitted, provenance=replace(fitted.provenance, input_sha256="0" * 64)),
         "checked-by-another-measurement"),
    ):  # fmt: skip
        findings = session_result(replace(evaluation, calibration=calibration)).findings
        assert code in {finding.code for finding in findings}


def test_the_page_answers_first_needs_nothing_else_and_escapes_all_text(evaluation, written):
    html = (written / "report.html").read_text(encoding="utf-8")
    page = Elements(html)
    places = [page.text.index(text) for text in ("Simulated data", "95\u00a0% interval", "CDP, 95", "Calibration")]
    assert places == sorted(places)
    assert page.text.count("target contrast") >= len(evaluation.contrasts)
    for tag, attributes in page.elements:
        assert tag not in ("script", "link", "iframe", "object", "base", "b", "i", "em")
        assert not {"href", "srcset", "action", "style"} & set(attributes)
        assert not any(name.startswith("on") for name in attributes)
        assert (attributes.get("src") or "data:image/png;base64,").startswith("data:image/png;base64,")
    assert html.count("</style>") == 1
    assert "{{ 7 * 7 }}" in page.text
    assert "Test <i>session</i>" in page.text


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_every_picture_loads_and_nothing_is_wider_than_a_phone(written, tmp_path):
    # A copy of the page that may run a script, which leaves what it measures in the title.
    script = (
        "<script>onload = () => { document.title = JSON.stringify([innerWidth, document.documentElement.scrollWidth,"
        " ...Array.from(document.images, i => i.naturalWidth)]) }</script></body>"
    )
    html = (written / "report.html").read_text(encoding="utf-8")
    html = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", html).replace("</body>", script)
    (tmp_path / "page.html").write_text(html, encoding="utf-8")
    arguments = ("--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", "--window-size=400,900")
    command = [CHROMIUM, *arguments, f"--user-data-dir={tmp_path / 'profile'}", (tmp_path / "page.html").as_uri()]
    dom = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout
    inner, scrolled, *pictures = map(int, re.search(r"<title>\[(.*)\]</title>", dom)[1].split(","))
    assert scrolled <= inner
    assert len(pictures) == len(FIGURES)
    assert min(pictures) > 800
