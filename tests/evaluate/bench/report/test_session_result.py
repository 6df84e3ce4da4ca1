"""The result of a session: one set of numbers in JSON, sheet, Dataset and page; its files are whole or not there."""

import json
import re
import resource
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser

import openpyxl
import pytest
from jsonschema import Draft202012Validator

from labcdp.core.errors import InputError
from labcdp.core.result import info, warning
from labcdp.evaluate.bench.calibration_result import summarised
from labcdp.evaluate.bench.session_page import session_page, write_results
from labcdp.evaluate.bench.session_result import session_result
from labcdp.output import LIST_FILE
from labcdp.report.files import envelope, schema
from labcdp.report.html import render_page
from labcdp.report.layout import ReportFigure

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


def text_of(evaluation):
    """Text of a page without its pictures."""
    figure = ReportFigure("x.png", b"", "caption", "alternative")
    page = session_page(
        evaluation,
        session_result(evaluation),
        {"target": [figure], "luminance": [], "contrasts": [], "calibration": []},
    )
    return Elements(render_page(page)).text


def test_json_follows_the_schema_and_holds_the_evaluation(evaluation, result, written):
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
        seen = patch.measured_cd_m2, patch.calculated_cd_m2, patch.calibrated.luminance_cd_m2
        assert (row["measured_cd_m2"], row["calculated_cd_m2"], row["calibrated_cd_m2"]) == seen
        assert row["expanded_calibrated_cd_m2"] == pytest.approx(u * row["calibrated_cd_m2"], rel=1e-12)
        assert row["deviation_rel"] == pytest.approx(seen[2] / seen[0] - 1, abs=1e-15)
    for table, column in (("luminance", "measured_cd_m2"), ("calibration_patches", "meter_cd_m2")):
        assert list(result.table(table)[column]) == sorted(result.table(table)[column])


def test_the_sheet_and_the_dataset_have_the_same_numbers(result, written):
    book = openpyxl.load_workbook(written / "results.xlsx")
    assert book.sheetnames == [*(table.name for table in result.tables), "findings", "about"]
    for table in result.tables:
        cells = list(book[table.name].iter_rows(min_row=2, values_only=True))
        for line, row in zip(cells, table.rows(), strict=True):
            assert tuple(None if cell == "" else cell for cell in line) == tuple(map(_cell, row.values()))
        assert not [cell for line in book[table.name].iter_rows() for cell in line if cell.data_type == "f"]
    dataset = result.table("contrasts").to_dataset()
    assert list(dataset["cdp"].values) == list(result.table("contrasts")["cdp"])


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
    images = [attributes for tag, attributes in page.elements if tag == "img"]
    assert len(images) == len(FIGURES)
    assert all(len(image["alt"] or "") > 20 for image in images)


def test_a_warning_stands_on_top_of_the_page_once(evaluation):
    odd = warning("readings-scatter", "lamp & <shade> flickers", scatter_rel=0.1)
    text = text_of(replace(evaluation, findings=(odd, odd, *evaluation.findings)))
    assert text.count("lamp & <shade>") == 1
    assert text.index("lamp & <shade>") < text.index("95\u00a0% interval")


def test_an_unknown_interval_is_null_in_json_and_missing_on_the_page(evaluation):
    row, unknown = evaluation.contrasts[0], (float("nan"), float("nan"))
    cdp = replace(row.cdp, standard_error=float("nan"), confidence_interval=unknown)
    changed = replace(row, calibrated_cdp=replace(row.calibrated_cdp, result=cdp, confidence_interval=unknown))
    evaluation = replace(evaluation, contrasts=[changed])
    found = envelope(session_result(evaluation))["tables"]["contrasts"]["rows"][0]
    assert found["cdp_low"] is found["cdp_high"] is found["u_cdp_pixels"] is None
    assert "95\u00a0% interval " not in text_of(evaluation)


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


def test_exposures_left_out_in_bracketing_are_one_note():
    found = [info("exposure-saturated", name, exposures_s=[0.5]) for name in ("P1", "P2")]
    assert summarised([*found, warning("few-patches", count=3, advised=6)]) == (
        warning("few-patches", count=3, advised=6),
        info("exposures-left-out", patches=["P1", "P2"]),
    )


def files(folder):
    whole = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    return {name: content for name, content in whole.items() if name != LIST_FILE}


def test_files_are_the_same_again(evaluation, result, written, tmp_path):
    names = ["results.json", "report.html", "results.xlsx", *(f"figures/{name}.png" for name in FIGURES)]
    assert write_results(evaluation, result, tmp_path) == [tmp_path / name for name in names]
    assert files(tmp_path) == files(written)
    assert set(files(written)) == set(names)


def test_a_file_that_does_not_fit_leaves_no_part_of_the_results(evaluation, tmp_path):
    """No file of this process may grow beyond a size: writing fails as on a full disk."""
    fewer = replace(evaluation, contrasts=[])
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(InputError, match=r"report\.html cannot be written \(File too large\)"):
            write_results(fewer, session_result(fewer), tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert files(tmp_path) == {}
