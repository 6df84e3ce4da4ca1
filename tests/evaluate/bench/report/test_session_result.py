"""The result of a session: one set of numbers in JSON, sheet, Dataset and page; its files are whole or not there."""

import json
import re
import shutil
import subprocess
from dataclasses import replace

import pytest
from jsonschema import Draft202012Validator

from labcdp.evaluate.bench.session_result import session_result
from labcdp.report.files import envelope, schema

CHROMIUM = shutil.which("chromium")
FIGURES = ("target", "luminance", "contrasts-1", "calibration-fit", "calibration-residuals")


def test_json_follows_the_schema_and_holds_the_evaluation(evaluation, result, written):
    values = json.loads((written / "results.json").read_text(encoding="utf-8"))
    Draft202012Validator(schema()).validate(values)
    assert values == json.loads(json.dumps(envelope(result)))
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


def test_the_page_answers_first_needs_nothing_else_and_escapes_all_text(written):
    html = (written / "report.html").read_text(encoding="utf-8")
    body = html[html.index("<body") :]
    places = [body.index(text) for text in ("Simulated data", "95\u00a0% interval", "CDP, 95", "Calibration")]
    assert places == sorted(places)
    tags = [tag for tag in re.findall(r"<[^>]*>", body) if not tag.startswith('<img src="data:image/png;base64,')]
    assert not [tag for tag in tags if re.match("<(script|link|iframe|object|base|b|i|em|img)[ >]", tag)]
    assert not [tag for tag in tags if re.search(r"\s(href|srcset|action|style|on\w+)=", tag)]
    assert html.count("</style>") == 1
    assert "{{ 7 * 7 }}" in html
    assert "Test &lt;i&gt;session&lt;/i&gt;" in html


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
