"""Results, pages and certificates: one set of numbers everywhere, and text that is out to do harm stays text."""

import json
import re
import shutil
import subprocess
from dataclasses import replace

import pytest
from jsonschema import Draft202012Validator

from labcdp.calibration.budget import budget, combined
from labcdp.calibration.colour.model import ColourCalibration, CombinationStep
from labcdp.calibration.findings import FitTest, LeftOut, ModelStep
from labcdp.calibration.verify.history import histories
from labcdp.calibration.verify.verify import verify
from labcdp.core.dn import Response
from labcdp.core.frame import PLANES
from labcdp.core.result import Finding, info, warning
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.calibration_page import calibration_page
from labcdp.evaluate.bench.calibration_result import PATCH_PIXELS, calibration_result
from labcdp.evaluate.bench.certificate import calibration_certificate, verification_certificate
from labcdp.evaluate.bench.history import by_camera, history_result, write_history
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.evaluate.bench.session_page import write_results
from labcdp.evaluate.bench.session_result import session_result
from labcdp.report.files import envelope, schema
from labcdp.report.html import render_page
from labcdp.session import ConditionsConfiguration, ContrastConfiguration, Session

from .synthetic import again

CHROMIUM = shutil.which("chromium")
NAMES = {
    "upper left": "<b>bold</b>",
    "lower right": "=1+1",
    "upper right": "$\\frac{1}$",
    "P09": '"><img src=x onerror=alert(1)>',
    "P02": "{{ 7 * 7 }}",
    "P04": "grey & \u7070",
}


@pytest.fixture(scope="module")
def hostile(recorded, tmp_path_factory):
    """The example session with six patches of hostile names."""
    target = recorded.configuration.target
    patches = [patch.model_copy(update={"name": NAMES[patch.name]}) for patch in target.patches if patch.name in NAMES]
    pairs = ((NAMES["lower right"], 9.6, 0.03), (NAMES["upper right"], 3.0, 0.25))
    pair = {"bright": NAMES["upper left"]}
    changes = {
        "name": "Test <i>session</i>", "operator": "=cmd()", "notes": "A note with </style> in it.",
        "target": target.model_copy(update={"name": "Six <em>patches</em>", "patches": tuple(patches)}),
        "contrasts": tuple(
            ContrastConfiguration(dark=dark, contrast=contrast, epsilon=epsilon, **pair)
            for dark, contrast, epsilon in pairs
        ),
    }  # fmt: skip
    path = tmp_path_factory.mktemp("hostile") / "session"
    again(path, recorded, lambda frames: [(*one, None) for one in frames], NAMES, **changes)
    with Session.open(path) as session:
        yield session


@pytest.fixture(scope="module")
def evaluated(hostile):
    observed = observe_session(hostile)
    return evaluate_session(hostile, observed, calibrate_session(observed))


@pytest.fixture(scope="module")
def written(evaluated, tmp_path_factory):
    """Folder with the results of the evaluation."""
    folder = tmp_path_factory.mktemp("results")
    write_results(evaluated, session_result(evaluated), folder)
    return folder


def rows(result, table, key):
    return {row[key]: row for row in result.table(table).rows()}


def opened(page, folder, *options):
    """What Chromium prints of a page."""
    (folder / "page.html").write_text(page, encoding="utf-8")
    how = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", *options)
    command = [CHROMIUM, *how, f"--user-data-dir={folder / 'profile'}", (folder / "page.html").as_uri()]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout


def test_results_hold_the_evaluation(evaluated, written):
    values = json.loads((written / "results.json").read_text(encoding="utf-8"))
    Draft202012Validator(schema()).validate(values)
    for row, one in zip(values["tables"]["contrasts"]["rows"], evaluated.contrasts, strict=True):
        assert (row["cdp"], row["below"], row["above"]) == (one.cdp.cdp, one.cdp.below, one.cdp.above)
        assert (row["cdp_low"], row["cdp_high"]) == one.cdp.confidence_interval
        assert row["measured_contrast"] == one.measured_contrast
    patches = {row["patch"]: row for row in values["tables"]["luminance"]["rows"]}
    for patch in evaluated.patches:
        row, u = patches[patch.region.name], patch.calibrated.half_width_95_rel
        seen = patch.measured_cd_m2, patch.calculated_cd_m2, patch.calibrated.luminance_cd_m2
        assert (row["measured_cd_m2"], row["calculated_cd_m2"], row["calibrated_cd_m2"]) == seen
        assert row["expanded_calibrated_cd_m2"] == pytest.approx(u * row["calibrated_cd_m2"], rel=1e-12)
        assert row["deviation_rel"] == pytest.approx(seen[2] / seen[0] - 1, abs=1e-15)


def test_limits_of_cdp_and_luminance_decide_with_the_whole_interval(evaluated):
    contrast = next(row for row in evaluated.contrasts if 0.01 < row.cdp.cdp < 0.99)
    low, high = contrast.cdp.confidence_interval
    limits = {"detected": low / 2, "undecided": (low + high) / 2, "not detected": (1 + high) / 2}
    assert [replace(contrast, cdp_limit=limit).verdict for limit in limits.values()] == list(limits)
    row, *others = evaluated.patches
    low, high = row.calibrated.interval_95_cd_m2
    middle = row.calibrated.luminance_cd_m2
    limits = {"pass": (0.9 * low, 1.1 * high), "undecided": (middle, 1.1 * high), "fail": (1.01 * high, 2 * high)}
    for verdict, given in limits.items():
        judged = session_result(replace(evaluated, patches=[replace(row, limits_cd_m2=given), *others]), [])
        assert rows(judged, "luminance", "patch")[row.region.name]["limit_verdict"] == verdict


def test_says_whether_deviations_check_the_calibration(evaluated):
    fitted = evaluated.calibration
    elsewhere = replace(fitted.provenance, input_sha256="0" * 64)
    for calibration, code in (
        (fitted, "not-checked"),
        (replace(fitted, residuals=fitted.residuals[1:]), "checked-by-held-out"),
        (replace(fitted, provenance=elsewhere), "checked-by-another-measurement"),
    ):
        findings = session_result(replace(evaluated, calibration=calibration)).findings
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
    dom = opened(html, tmp_path, "--dump-dom", "--window-size=400,900")
    inner, scrolled, *pictures = map(int, re.search(r"<title>\[(.*)\]</title>", dom)[1].split(","))
    assert scrolled <= inner
    # The target, its luminance, the contrasts, and fit and deviations of the calibration.
    assert len(pictures) == 5
    assert min(pictures) > 800


def with_findings(fitted):
    """The calibration with all kinds of findings."""
    first, *rest = fitted.residuals
    found = warning("intercept", intercept_cd_m2=0.012, expanded_cd_m2=0.004, intercept_dn_s=50.0, z=6.0)
    drift = FitTest("drift", 0.0, 0.0, "1/h", False, info("not-testable-time", "drift"))
    return replace(
        fitted, residuals=tuple(rest), held_out=(first,), findings=(found,),
        left_out=(LeftOut("<b>bold</b>", 0.02, None, "saturated"), LeftOut("=1+1", None, 2, "contradicts the others")),
        ladder=(ModelStep("linear", 1, 0.012, True, info("model-simplest")),),
        tests=(FitTest("glare", 0.012, 0.002, "cd/m²", True, found), drift),
        response=Response("quadratic", (0.0, 4000.0), (0.0, 4200.0)),
    )  # fmt: skip


def of_colours(one):
    return ColourCalibration(
        planes=tuple(replace(one, state=replace(one.state, plane=p)) for p in ("R", "Gr", "Gb", "B")),
        weights=(0.2, 0.3, 0.3, 0.2), spectral_rel=0.01, scatter_rel=0.0, sensitivity=None, f1_prime=0.12,
        weight_covariance=tuple(tuple(1e-4 * (i == j) for j in range(4)) for i in range(4)),
        ladder=(CombinationStep("combination", 0.004, True, info("combination-best")),),
        findings=(Finding("patches-of-one-colour"),),
        **{n: getattr(one, n) for n in ("range_cd_m2", "residuals", "held_out", "left_out")},
    )  # fmt: skip


@pytest.mark.parametrize("colours", [False, True])
def test_budget_patches_and_quantities_are_those_of_the_calibration_also_on_its_page(evaluated, colours):
    one = with_findings(evaluated.calibration)
    # Each plane has figures of its own.
    calibration = of_colours(replace(one, response=Response())) if colours else one
    result = calibration_result(calibration, "Title <i>here</i>")
    Draft202012Validator(schema()).validate(envelope(result))
    page = render_page(calibration_page(calibration, result))
    assert "Title &lt;i&gt;here&lt;/i&gt;" in page
    assert "<b>bold" not in page
    assert page.index("Simulated data") < page.index("Calibrated range") < page.index("Uncertainty budget")

    sources, (low, high) = rows(result, "budget", "source"), calibration.range_cd_m2
    at = zip(("lowest", "middle", "highest"), (low, (low * high) ** 0.5, high), strict=True)
    for (place, luminance), total in zip(at, result.table("uncertainty").rows(), strict=True):
        # Each plane has a quarter of a patch's pixels.
        found = budget(calibration, luminance, n_pixels=PATCH_PIXELS // (4 if colours else 1))
        whole = combined(found)
        assert total["u_rel"] == pytest.approx(whole.standard_uncertainty_rel)
        assert total["expanded_rel"] == pytest.approx(whole.expanded_95_rel)
        for row in found:
            if row.included:
                assert sources[row.source][f"u_{place}_rel"] == pytest.approx(row.standard_uncertainty_rel)
    assert sources["meter scale"]["included"] == "yes"
    assert sources["meter f1'"]["u_lowest_rel"] is None

    patches = rows(result, "calibration_patches", "patch")
    assert len(patches) == len(NAMES)
    for use, group in (("fit", calibration.residuals), ("held out", calibration.held_out)):
        for patch in group:
            seen = use, patch.reading_cd_m2, patch.reading_random_cd_m2, patch.residual_rel
            row = patches[patch.patch]
            assert tuple(row[key] for key in ("used_for", "meter_cd_m2", "u_meter_cd_m2", "deviation_rel")) == seen
    quantities = rows(result, "calibration", "quantity")
    if colours:
        weights = {name: row["weight"] for name, row in rows(result, "planes", "plane").items()}
        assert weights == {"R": 0.2, "Gr": 0.3, "Gb": 0.3, "B": 0.2}
        assert quantities["f1' of the combination"]["value"] == 0.12
    else:
        # 95 % of a rectangular error lie within fewer standard uncertainties than of a normal one.
        row = quantities["responsivity R"]
        assert 1.6 < row["expanded_value"] / row["u_value"] < 1.96


@pytest.mark.parametrize("of", ["calibration", "verification"])
def test_a_certificate_identifies_all_and_prints_on_one_or_two_pages_of_a4(evaluated, hostile, of, tmp_path):
    observed, calibration, plane = evaluated.observed, evaluated.calibration, evaluated.observed.monochrome
    conditions = ConditionsConfiguration.model_validate({"camera_distance_m": 0.8, "angle_deg": 0.0})
    configuration = observed.configuration.model_copy(update={"conditions": conditions})
    observed = replace(observed, configuration=configuration)
    verdict = ()
    if of == "calibration":
        page = calibration_certificate(hostile, observed, calibration).decode()
    else:
        seen = {"": [o for group in plane.patches.values() for o in group]}
        found = verify(calibration, seen, {"": plane.darks}, observed.readings, observed.meter_scale, 0.5)
        page = verification_certificate(hostile, observed, calibration, found).decode()
        verdict = ("<strong>Conform</strong>", "Tolerance T\u00a0=\u00a0± 50\u00a0%, as stated.")
    for words in (
        *("Simulated data, not a measurement.", observed.input_sha256, "Kowa LM6NCL (simulated)", "SIM-73323007"),
        *("0° to the normal", "<dt>Camera distance</dt><dd>0.8 m</dd>", *verdict),
        "<dd>focus, meter distance, measuring field, room</dd>",
    ):
        assert words in page
    # One picture, no script, and nothing of a user's text as markup.
    assert page.count("<img") == page.count("data:image/png;base64,") == 1
    assert not re.search("<script|<em>", page)
    if of == "calibration":  # has less on it
        return
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    opened(page, tmp_path, f"--print-to-pdf={tmp_path / 'a.pdf'}")
    content = (tmp_path / "a.pdf").read_bytes()
    assert len(re.findall(rb"/Type\s*/Page\b", content)) in (1, 2)
    # 210 x 297 mm in points.
    size = re.search(rb"/MediaBox\s*\[0 0 ([\d.]+) ([\d.]+)\]", content).groups()
    assert [float(side) for side in size] == pytest.approx([595.3, 841.9], abs=1)


def test_history_by_time_with_weights_and_verdicts(evaluated, tmp_path):
    """Two measurements of four planes; blue lost a tenth, and the second one found nothing of red."""
    (mono,) = histories({"c.json": evaluated.calibration}, {})
    (first,) = mono.points
    r, *others = first.responsivity
    later = {"source": "v.json", "measured": first.measured.replace(year=first.measured.year + 1)}
    adjusted = replace(first.meter, meter=replace(first.meter.meter, calibration_date="2027-01-01"))
    later |= {"verdict": "undecided", "weight": None, "k_dn_per_e": None, "meter": adjusted}
    found = dict(zip(PLANES, (None, (r, *others), (r, *others), (0.9 * r, *others)), strict=True))
    weights = dict(zip(PLANES, (0.2, 0.45, 0.45, -0.1), strict=True))
    points = {p: (replace(first, weight=weights[p]), replace(first, responsivity=found[p], **later)) for p in PLANES}
    planes = [replace(mono, plane=plane, points=points[plane]) for plane in PLANES]
    # A monochrome camera of the same name is another one.
    assert [[one.plane for one in camera] for camera in by_camera([*planes, mono])] == [list(PLANES), [None]]
    seen = list(history_result(planes).table("history").rows())
    assert [(row["plane"], row["weight"]) for row in seen[:4]] == list(weights.items())
    assert {row["by"] for row in seen[4:]} == {"verification: undecided"}
    assert seen[4]["responsivity"] is seen[4]["expanded_r"] is None
    write_history(planes, history_result(planes), tmp_path / "h")
    page = (tmp_path / "h/report.html").read_text()
    assert page.index("was calibrated") < page.index("changed</span>") < page.index("data:image/png")
    write_history([*planes, mono], history_result([*planes, mono]), tmp_path / "two")
    assert [one.name for one in sorted((tmp_path / "two/figures").iterdir())] == ["history-1.png", "history-2.png"]
