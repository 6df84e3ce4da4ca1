"""Results, pages and certificates: one set of numbers everywhere, and text that is out to do harm stays text."""

import hashlib
import html
import json
import re
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from labcdp.api.session_result import SessionResult
from labcdp.calibration.budget import budget
from labcdp.calibration.record import SavedFile, load_any, save, save_verification
from labcdp.calibration.verify.history import histories
from labcdp.calibration.verify.verify import verify
from labcdp.core.dcc import LUMINANCE, MEASURED, REFERENCE, read_dcc
from labcdp.core.errors import InputError
from labcdp.core.frame import PLANES
from labcdp.core.result import warning
from labcdp.evaluate.bench.calibrate import calibrate_recorded, calibrate_session
from labcdp.evaluate.bench.calibration_page import calibration_page
from labcdp.evaluate.bench.calibration_result import PATCH_PIXELS, calibration_result
from labcdp.evaluate.bench.certificate import (
    calibration_certificate,
    calibration_dcc,
    certified_patches,
    verification_certificate,
)
from labcdp.evaluate.bench.colours import session_colours
from labcdp.evaluate.bench.history import by_camera, history_files, history_result
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session, observe_calibrated
from labcdp.evaluate.bench.session_page import session_files
from labcdp.evaluate.bench.session_result import session_result
from labcdp.evaluate.bench.verification import verified_patches
from labcdp.metrics import colour_separation
from labcdp.report.files import envelope
from labcdp.report.html import render_page
from labcdp.report.text import finding_text, with_half_width
from labcdp.session import ContrastConfiguration, Session
from labcdp.session.configuration import ConditionsConfiguration, PartyConfiguration

from ...conftest import CHROMIUM, valid
from ...output.test_results_folder import write
from .synthetic import again

NAMES = {
    "upper left": "<b>bold</b>",
    "lower right": "=1+1",
    "upper right": "$\\frac{1}$",
    "P09": '"><img src=x onerror=alert(1)>',
    "P02": "{{ 7 * 7 }}",
    "P04": "grey & \u7070" + "W" * 92,
}

SAVED = SavedFile("<i>calibration</i>.json", "0123-4567-89ab", "f" * 64)


@pytest.fixture(scope="module")
def hostile(recorded, tmp_path_factory):
    """The example session with six patches of hostile names."""
    target = recorded.configuration.target
    patches = [patch.model_copy(update={"name": NAMES[patch.name]}) for patch in target.patches if patch.name in NAMES]
    pairs = ((NAMES["lower right"], 9.6, 0.03), (NAMES["upper right"], 3.0, 0.25))
    pair = {"bright": NAMES["upper left"]}
    changes = {
        "name": "Test <i>session</i>", "operator": "=cmd()", "notes": "A note with </style> in it.",
        "customer": PartyConfiguration(name="<b>Customer</b>", address="1 Street, \\7 Town"),
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
    return evaluate_session(observed, calibrate_session(observed))


@pytest.fixture(scope="module")
def written(evaluated, tmp_path_factory):
    """Folder with the results of the evaluation."""
    folder = tmp_path_factory.mktemp("results")
    write(folder, session_files(evaluated, session_result(evaluated)))
    return folder


def certificate(observed, calibration, saved=SAVED):
    """The page of a calibration's certificate."""
    return calibration_certificate(observed, calibration, saved).decode()


def rows(result, table, key):
    return {row[key]: row for row in result.table(table).rows()}


def test_results_hold_the_evaluation(evaluated, written):
    values = valid((written / "results.json").read_text(encoding="utf-8"))
    for row, one in zip(values["tables"]["contrasts"]["rows"], evaluated.contrasts, strict=True):
        assert (row["cdp"], row["below"], row["above"]) == (one.cdp.cdp, one.cdp.below, one.cdp.above)
        assert (row["cdp_low"], row["cdp_high"]) == one.cdp.interval
        assert row["measured_contrast"] == one.measured_contrast
        counting = [(1 + sign * row["epsilon"]) * row["target_contrast"] for sign in (-1, 1)]
        assert [row["detected_from"], row["detected_up_to"]] == pytest.approx(counting, rel=1e-12)
    patches = {row["patch"]: row for row in values["tables"]["luminance"]["rows"]}
    for patch in evaluated.patches:
        row, u = patches[patch.region.name], patch.calibrated.U_rel
        seen = patch.reading.luminance_cd_m2, patch.calculated_cd_m2, patch.calibrated.luminance_cd_m2
        assert (row["measured_cd_m2"], row["calculated_cd_m2"], row["calibrated_cd_m2"]) == seen
        assert row["expanded_calibrated_cd_m2"] == pytest.approx(u * row["calibrated_cd_m2"], rel=1e-12)
        assert row["deviation_rel"] == pytest.approx(seen[2] / seen[0] - 1, abs=1e-15)


def test_limits_of_cdp_and_luminance_decide_with_the_whole_interval(evaluated):
    contrast = next(row for row in evaluated.contrasts if 0.01 < row.cdp.cdp < 0.99)
    low, high = contrast.cdp.interval
    limits = {"detected": low / 2, "undecided": (low + high) / 2, "not detected": (1 + high) / 2}
    asked = [contrast.target.model_copy(update={"cdp_limit": limit}) for limit in limits.values()]
    assert [replace(contrast, target=one).verdict for one in asked] == list(limits)
    row, *others = evaluated.patches
    low, high = row.calibrated.interval_95_cd_m2
    middle = row.calibrated.luminance_cd_m2
    limits = {"pass": (0.9 * low, 1.1 * high), "undecided": (middle, 1.1 * high), "fail": (1.01 * high, 2 * high)}
    for verdict, given in limits.items():
        limited = replace(row, patch=row.patch.model_copy(update={"limits_cd_m2": given}))
        judged = session_result(replace(evaluated, patches=[limited, *others]))
        assert rows(judged, "luminance", "patch")[row.region.name]["limit_verdict"] == verdict


def test_says_whether_deviations_check_the_calibration(evaluated):
    fitted = evaluated.calibration
    elsewhere = replace(fitted.provenance, input_sha256="0" * 64)
    for calibration, code in (
        (fitted, "not-checked"),
        (replace(fitted, residuals=fitted.residuals[1:]), "checked-by-held-out"),
        (replace(fitted, provenance=elsewhere), "checked-by-another-measurement"),
    ):
        assert code in {one.code for one in session_result(replace(evaluated, calibration=calibration)).findings}


def test_text_of_a_user_is_no_markup_on_any_page(evaluated, hostile, written):
    observed, calibration = evaluated.observed, evaluated.calibration
    seen = observed.by_plane, observed.darks_by_plane, observed.readings
    found = verify(calibration, *seen, observed.meter_scale, 0.5)
    verification = verification_certificate(observed, calibration, found, SAVED, SAVED).decode()
    assert "<strong>Conform</strong>" in verification
    assert "<dd>&lt;b&gt;Customer&lt;/b&gt;, 1 Street, \\7 Town</dd>" in verification
    titled = calibration_result(calibration, "Title <i>here</i>")
    for page in (
        (written / "report.html").read_text(encoding="utf-8"),
        render_page(calibration_page(calibration, titled)),
        certificate(observed, calibration),
        verification,
    ):
        body = page[page.index("<body") :]
        tags = [tag for tag in re.findall(r"<[^>]*>", body) if not tag.startswith('<img src="data:image/png;base64,')]
        assert not [tag for tag in tags if re.match("<(script|link|iframe|object|base|b|i|em|img)[ >]", tag)]
        assert not [tag for tag in tags if re.search(r"\s(href|srcset|action|style|on\w+)=", tag)]
        assert page.count("</style>") == 1
        assert "Simulated data" in body


def facts(page):
    """Named values of a certificate."""
    return {key: html.unescape(value) for key, value in re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", page)}


def stated(text):
    """Numbers of a text, all of them."""
    return [float(one) for one in re.findall(r"-?\d+\.?\d*", text)]


def test_a_certificate_says_what_iso_17025_asks_for(evaluated, tmp_path):
    """Each result has a number of its own, which its file has; warnings, place, condition and end are on the page."""
    given = {
        "place": "Building 3", "camera_condition": "undamaged", "relative_humidity": 0.45, "temperature_c": 23.5,
    }  # fmt: skip
    observed = evaluated.observed
    conditions = ConditionsConfiguration.model_validate(given)
    observed = replace(observed, configuration=observed.configuration.model_copy(update={"conditions": conditions}))
    told = warning("readings-scatter", "P02", scatter_rel=0.1)
    numbers = []
    for r in (2450.0, 2350.0):
        fit = replace(evaluated.calibration.responsivity, responsivity_dn_s_cd_m2=r)
        calibration = replace(evaluated.calibration, responsivity=fit, findings=(told,))
        save(calibration, path := tmp_path / f"{r:g}.json")
        page = certificate(observed, calibration, SavedFile.of(path))
        shown, number = facts(page), json.loads(path.read_text())["number"]
        assert shown["Number"] == number
        assert hashlib.sha256(path.read_bytes()).hexdigest() in shown["File"]
        assert (shown["Place"], shown["Camera&#39;s condition"]) == ("Building 3", "undamaged")
        assert (stated(shown["Humidity"]), stated(shown["Room"])) == ([45.0], [23.5])
        temperatures = [o.temperature_c for group in observed.patches.values() for o in group]
        temperatures += [o.temperature_c for o in observed.darks_by_plane[None]]
        ends = stated(shown["Camera&#39;s temperature"])
        assert (ends[0], ends[-1]) == pytest.approx((min(temperatures), max(temperatures)), abs=0.06)
        assert html.escape(finding_text(told)[1:], quote=False).replace("'", "&#39;").replace(" %", "\xa0%") in page
        assert page.rstrip().endswith(f"End of certificate {number}</p>\n</body>\n</html>")
        numbers.append(number)
        seen = observed.by_plane, observed.darks_by_plane, observed.readings
        verification = verify(calibration, *seen, observed.meter_scale, 0.5)
        save_verification(verification, again := tmp_path / f"verification-{r:g}.json")
        page = verification_certificate(
            observed, calibration, verification, SavedFile.of(again), SavedFile.of(path)
        ).decode()
        assert facts(page)["Number"] == json.loads(again.read_text())["number"] != number
        assert number in facts(page)["Calibration"]
        assert f"calibration {number} is unchanged" in page
        numbers.append(facts(page)["Number"])
    assert len(set(numbers)) == 4


def test_u_in_the_corners_of_a_certificate_has_the_uncertainty_of_the_vignetting(evaluated):
    """With nothing else to be seen beside an assumed vignetting that is uncertain by half, U is 1.96 times that."""
    whole = replace(evaluated.calibration.vignetting, corner_rel=0.5)
    page = certificate(evaluated.observed, replace(evaluated.calibration, vignetting=whole))
    rows = re.findall(r'<tr><th scope="row">.*?</tr>', page)
    assert len(rows) == 6
    for row in rows:
        *_, here, _, _, corner = (cell for cell in re.findall(r">([^<]*)</td>", row))
        assert float(here) < float(corner)
        assert float(corner) == pytest.approx(98, abs=3)


def coloured(frames):
    """Frames as of a sensor with colour filters."""
    return [(replace(one, colour_filter="RG", pixel_format="BayerRG12"), role, None) for one, role in frames]


@pytest.mark.parametrize("filtered", [False, True])
def test_a_patch_has_one_luminance_and_one_u(recorded, filtered, tmp_path):
    """In calibration, certificate and report of a session, also for a calibration that was read from its file."""
    if filtered:
        again(tmp_path / "session", recorded, coloured)
    with Session.open(tmp_path / "session" if filtered else recorded.path) as session:
        (observed,), calibration = calibrate_recorded([session], held_out=["P05"])
        save(calibration, tmp_path / "calibration.json")
        evaluation = evaluate_session(*observe_calibrated(session, load_any(tmp_path / "calibration.json")))
    reported = {row["patch"]: row for row in session_result(evaluation).table("luminance").rows()}
    for result in (calibration_result(calibration), session_result(evaluation)):
        rows = [*result.table("calibration_patches").rows()]
        assert len(rows) == 16
        for row in rows:
            expected = reported[row["patch"]]
            for here, there in (
                ("camera_cd_m2", "calibrated_cd_m2"),
                ("expanded_camera_cd_m2", "expanded_calibrated_cd_m2"),
                ("u_camera_cd_m2", "u_calibrated_cd_m2"),
                ("meter_cd_m2", "measured_cd_m2"),
                ("expanded_meter_cd_m2", "expanded_measured_cd_m2"),
            ):
                assert row[here] == pytest.approx(expected[there], rel=1e-9)
            assert row["expanded_rel"] == pytest.approx(expected["expanded_rel"], rel=1e-9)
            assert row["deviation_rel"] == pytest.approx(expected["deviation_rel"], abs=1e-9)
            assert row["coverage_factor"] == pytest.approx(row["expanded_camera_cd_m2"] / row["u_camera_cd_m2"])
    certified = certified_patches(calibration)
    for row in certified.rows():
        expected = reported[row["patch"].removesuffix(" (held out)")]
        seen = [row[name] for name in ("camera_cd_m2", "expanded_rel", "meter_cd_m2", "expanded_meter_cd_m2")]
        names = "calibrated_cd_m2", "expanded_rel", "measured_cd_m2", "expanded_measured_cd_m2"
        assert seen == pytest.approx([expected[name] for name in names], rel=1e-9)
    assert {row["patch"] for row in certified.rows()} == {*reported} - {"P05"} | {"P05 (held out)"}
    page = certificate(observed, calibration)
    for row in evaluation.patches:
        assert (
            with_half_width(row.reading.luminance_cd_m2, row.reading.U_rel(row.meter) * row.reading.luminance_cd_m2)
            in page
        )


def test_a_calibration_of_an_older_file_states_no_u_of_its_patches(evaluated):
    unknown = {"u_rel": None, "U_rel": None, "dof": None, "reading_U_rel": None}
    rows = tuple(replace(row, **unknown) for row in evaluated.calibration.residuals)
    result = session_result(replace(evaluated, calibration=replace(evaluated.calibration, residuals=rows)))
    names = "expanded_camera_cd_m2", "u_camera_cd_m2", "expanded_rel", "coverage_factor", "expanded_meter_cd_m2"
    for row in result.table("calibration_patches").rows():
        assert [row[name] for name in names] == [None] * 5
        assert row["deviation_rel"] == pytest.approx(row["camera_cd_m2"] / row["meter_cd_m2"] - 1, abs=1e-12)
    assert session_files(evaluated, result)["report.html"]


def test_a_verification_states_the_same_u_of_the_meter(evaluated):
    observed = evaluated.observed
    seen = observed.by_plane, observed.darks_by_plane, observed.readings
    rows = verified_patches(verify(evaluated.calibration, *seen, observed.meter_scale, 0.5)).rows()
    reported = {row["patch"]: row for row in session_result(evaluated).table("luminance").rows()}
    for row in rows:
        assert row["expanded_meter_cd_m2"] == pytest.approx(reported[row["patch"]]["expanded_measured_cd_m2"], rel=1e-9)


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
def test_the_certificate_of_a_verification_is_one_sheet(browser, observed, calibration):
    """Also of all 16 patches of the example; more often two or three are measured again."""
    seen = (observed.by_plane, observed.darks_by_plane, observed.readings, observed.meter_scale)
    verification = verify(calibration, *seen, 0.03)
    verified = verification_certificate(observed, calibration, verification, SAVED, SAVED)
    with closing(browser.new_page()) as page:
        page.set_content(verified.decode())
        pdf = page.pdf(prefer_css_page_size=True)
    assert len(verification.patches) >= 16
    assert len(re.findall(rb"/Type\s*/Page\b", pdf)) == 1


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
def test_long_names_stay_on_the_paper_of_a_certificate(browser, evaluated):
    with closing(browser.new_page()) as page:
        page.set_content(certificate(evaluated.observed, evaluated.calibration))
        page.emulate_media(media="print")
        page.set_viewport_size({"width": 680, "height": 1000})  # 210 mm less margins of 15 mm, at 96 px an inch
        assert page.get_by_text("WWWWWW").count() > 0
        assert page.evaluate("document.documentElement.scrollWidth") <= 680


def test_budget_and_patches_are_those_of_the_calibration(evaluated):
    first, *rest = evaluated.calibration.residuals
    calibration = replace(evaluated.calibration, residuals=tuple(rest), held_out=(first,))
    result = calibration_result(calibration, "Title")
    valid(envelope(result))
    sources, (low, high) = rows(result, "budget", "source"), calibration.range_cd_m2
    at = zip(("lowest", "middle", "highest"), (low, (low * high) ** 0.5, high), strict=True)
    for (place, luminance), total in zip(at, result.table("uncertainty").rows(), strict=True):
        found = budget(calibration, luminance, n_pixels=PATCH_PIXELS)
        assert total["expanded_rel"] == pytest.approx(found.U_rel)
        for row in found.rows:
            if row.included:
                assert sources[row.source][f"u_{place}_rel"] == pytest.approx(row.u_rel)
                # One basis stands for all three luminances, whose exposures differ.
                assert sources[row.source]["basis"] == finding_text(row.basis)
    patches = rows(result, "calibration_patches", "patch")
    for use, group in (("fit", rest), ("held out", [first])):
        for patch in group:
            seen = use, patch.reading_cd_m2, patch.reading_random_cd_m2, patch.deviation_rel
            row = patches[patch.patch]
            assert tuple(row[key] for key in ("used_for", "meter_cd_m2", "u_meter_cd_m2", "deviation_rel")) == seen
    # 95 % of a rectangular error lie within fewer standard uncertainties than of a normal one.
    row = rows(result, "calibration", "quantity")["responsivity R"]
    assert 1.6 < row["expanded_value"] / row["u_value"] < 1.96


def test_a_history_has_a_row_for_each_plane_and_measurement(evaluated, tmp_path):
    """Two measurements of four planes; the second one found nothing of red."""
    (mono,) = histories({"c.json": evaluated.calibration}, {})
    (first,) = mono.points
    later = replace(first, source="v.json", measured=first.measured.replace(year=first.measured.year + 1))
    nothing = replace(later, responsivity=None, k_dn_per_e=None)
    points = {p: (first, nothing if p == "R" else later) for p in PLANES}
    planes = [replace(mono, state=replace(mono.state, plane=p), points=points[p]) for p in PLANES]
    # A monochrome camera of the same name is another one.
    assert [[one.plane for one in camera] for camera in by_camera([*planes, mono])] == [list(PLANES), [None]]
    seen = [(row["plane"], row["responsivity"]) for row in history_result(planes).table("history").rows()]
    r = first.responsivity[0]
    assert seen == [(p, r) for p in PLANES] + [(p, None if p == "R" else r) for p in PLANES]
    write(tmp_path / "two", history_files([*planes, mono], history_result([*planes, mono])))
    assert [one.name for one in sorted((tmp_path / "two/figures").iterdir())] == ["history-1.png", "history-2.png"]


def test_colours_of_a_session_are_those_of_the_cells_of_its_frames(recorded, tmp_path):
    """The distance does not depend on the gain of a plane, nor on the calibration of each."""
    again(tmp_path / "session", recorded, coloured)
    with Session.open(tmp_path / "session") as session:
        (observed,), calibration = calibrate_recorded([session])
        evaluation = evaluate_session(observed, calibration)
        result = SessionResult(evaluation).colour_separation()
        row = evaluation.contrasts[-1]
        frame = next(record for record in session.frames("light") if record.number == row.frame_number)
        dn = session.load(frame).dn.astype(float)
    pixels = []
    for patch in (row.bright, row.dark):
        window = patch.region.window(dn.shape)
        rows, columns = (slice(part.start + part.start % 2, part.stop // 2 * 2) for part in window)
        cell = dn[rows, columns]
        green = (cell[::2, 1::2] + cell[1::2, ::2]) / 2
        pixels.append(np.stack([cell[::2, ::2], green, cell[1::2, 1::2]], axis=-1))
    by_dn = colour_separation(*pixels)
    name = f"{row.target.bright} / {row.target.dark}"
    # Only the calibration corrects vignetting and dark pattern.
    assert float(result["colour_distance"].sel(pair=name)) == pytest.approx(by_dn.distance.value, rel=0.05)
    with_colours = replace(evaluation, colours=session_colours(evaluation))
    table = session_result(with_colours).table("colour_separation")
    assert table["distance"][-1] == float(result["colour_distance"].sel(pair=name))
    assert b"Colour separation" in session_files(with_colours, session_result(with_colours))["report.html"]


def test_a_session_without_colour_filter_has_no_colours(evaluation):
    with pytest.raises(InputError, match="no colour filter"):
        session_colours(evaluation)


def test_a_calibration_has_a_digital_certificate_where_the_country_of_the_laboratory_is_stated(evaluated):
    observed, calibration = evaluated.observed, evaluated.calibration
    assert calibration_dcc(observed, calibration, SAVED) is None
    laboratory = PartyConfiguration(name="Lab <1>", address="1 Street,\x07 Town", country="DE")
    configuration = observed.configuration.model_copy(update={"laboratory": laboratory})
    read = read_dcc(calibration_dcc(replace(observed, configuration=configuration), calibration, SAVED), "it")
    assert (read.number, read.laboratory, read.country) == (SAVED.number, "Lab <1>", "DE")
    assert read.laboratory_address == "1 Street,\ufffd Town"
    assert read.serial == calibration.state.camera.serial
    (meter,), (camera,) = (read.quantities_of_kind(kind, LUMINANCE) for kind in (REFERENCE, MEASURED))
    rows = calibration.residuals
    assert meter.values[: len(rows)] == pytest.approx([row.reading_cd_m2 for row in rows])
    expanded = [row.luminance_cd_m2 * row.U_rel for row in rows]
    assert camera.expanded[: len(rows)] == pytest.approx(expanded)
    assert read.statements[0].startswith("Traceability of the luminances: ")
