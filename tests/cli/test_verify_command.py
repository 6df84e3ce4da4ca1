"""labcdp verify and labcdp history, as a person runs them."""

import json
import os
import re
import sys
import time
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from jsonschema import Draft202012Validator

from labcdp.acquire import acquire
from labcdp.calibration import ColourCalibration, load, save
from labcdp.core.clock import SimulatedClock
from labcdp.core.frame import PLANES
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.report.envelope import schema
from labcdp.session import Session, SessionConfiguration, example_session

SIMULATED = ("--simulated", "--virtual-clock")
OTHER_PATCHES = re.compile(r'\[\[target\.patch\]\]\nname = "(?!P01|P04|P07|P12|upper right|lower right)[^[]*\[[^\[]*')


@pytest.fixture
def verify(labcdp):
    """Run the command with --json; returns its exit status and its tables."""

    def run(*arguments):
        done = labcdp("verify", *arguments, "--json")
        assert done.returncode in (0, 3, 4), done.stderr
        values = json.loads(done.stdout)
        Draft202012Validator(schema()).validate(values)
        return done.returncode, values

    return run


def verdict(values):
    (row,) = values["tables"]["verdict"]["rows"]
    return row["verdict"]


def plan():
    text = re.sub(r"\[\[contrast\]\][^\[]*", "", (example_session() / "session.toml").read_text())
    text = re.sub(r"exposures_s = .*", "exposures_s = [0.002, 0.032]", text)
    return OTHER_PATCHES.sub("", text)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A session on the bench that --simulated opens."""
    return record(tmp_path_factory.mktemp("recorded") / "session", SimulatedClock())


@pytest.fixture(scope="module")
def again(tmp_path_factory):
    """The same bench, recorded a day later."""
    return record(tmp_path_factory.mktemp("again") / "session", SimulatedClock(datetime(2030, 1, 2, tzinfo=UTC)))


def record(path, clock):
    configuration = SessionConfiguration.from_toml(plan(), "plan")
    bench = SimulatedBench(configuration, BenchDevices.standard(), clock=clock)
    with (
        Session.create(path, configuration, clock=clock) as session,
        bench,
        bench.in_process_camera() as camera,
        bench.in_process_meter() as meter,
    ):
        acquire(session, camera, meter, bench, clock=clock)
    return path


@pytest.fixture(scope="module")
def saved(recorded):
    """Its calibration."""
    path = recorded.with_name("calibration.json")
    with Session.open(recorded) as session:
        save(calibrate_session(observe_session(session)), path)
    return path


@pytest.fixture
def bench(tmp_path):
    """Write the configuration of the example, with lines replaced."""

    def write(*changes):
        text = plan()
        for old, new in changes:
            assert re.search(old, text), text
            text = re.sub(old, new, text, count=1)
        (tmp_path / "bench.toml").write_text(text)
        return "bench.toml"

    return write


def test_a_recorded_session(labcdp, verify, saved, again, tmp_path):
    done = labcdp("verify", saved, again, "--output", "out", "--tolerance", "6%")
    assert done.returncode == 0, done.stderr
    assert "conform: camera and meter agree on all 6 patches within ± 6.0 %" in done.stderr
    assert "Patches measured again" in done.stdout
    assert "Saved: out/verification.json" in done.stderr
    status, values = verify(saved, again, "--output", "out", "--force", "--patch", "P01", "--patch", "P07")
    # The meter shows 0.50 cd/m² for P01: one digit is more than the tolerance, U of the calibration.
    assert (status, verdict(values)) == (4, "undecided")
    assert [row["verdict"] for row in values["tables"]["patches"]["rows"]] == ["undecided", "conform"]
    assert [row["patch"] for row in values["tables"]["patches"]["rows"]] == ["P01", "P07"]
    assert values["tables"]["verdict"]["rows"][0]["same_meter"] is True
    assert values == json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))


def test_measuring_again_on_the_same_bench(labcdp, saved, bench, tmp_path):
    options = (*SIMULATED, "--tolerance", "6%", "--json")
    done = labcdp("verify", saved, bench(), "own", *options)
    assert done.returncode == 0, done.stderr
    assert "Measuring" in done.stderr
    values = json.loads(done.stdout)
    assert verdict(values) == "conform"
    assert len(values["tables"]["patches"]["rows"]) == 3
    assert (tmp_path / "own-verify" / "verification.json").exists()
    with Session.open(tmp_path / "own") as session:
        session.verify()
        assert len(session.frames("dark")) >= 2
    # What is complete is not measured again.
    again = labcdp("verify", saved, "bench.toml", "own", *options, "--force")
    assert json.loads(again.stdout)["tables"] == values["tables"]


def test_a_lens_that_lets_less_light_through(labcdp, saved, bench):
    dirty = bench((r"(\[lens\][^\[]*f_number = 2.6)", r"\1\ntransmittance = 0.85"))
    done = labcdp("verify", saved, dirty, "own", *SIMULATED)
    assert done.returncode == 3, done.stderr
    assert "not conform: camera and meter differ by more than ± 1.9 %" in done.stderr
    # 0.85 of 0.90 is 5.6 % less; U of the patches is 1 %.
    deviation = float(re.search(r"all patches deviate by about the same, (-\d\.\d) %", done.stderr)[1])
    assert deviation == pytest.approx(100 * (0.85 / 0.90 - 1), abs=1.0)
    assert "calibrate again" in done.stderr


def test_a_camera_that_is_warmer(verify, saved, bench, tmp_path):
    (tmp_path / "faults.txt").write_text("temperature +40 C\n")
    _, values = verify(saved, bench(), "own", *SIMULATED, "--faults", "faults.txt")
    assert verdict(values) != "conform"
    assert "P01" in [one["subject"] for one in values["findings"] if one["code"] == "patch-not-verified"]
    warmer = next(one["values"] for one in values["findings"] if one["code"] == "temperature-not-covered")
    assert (warmer["temperature_c"], warmer["highest_c"]) == pytest.approx((75.0, 35.0))


def test_history_of_calibrations_and_verifications(labcdp, saved, again, tmp_path):
    assert labcdp("verify", saved, again, "--output", "all/2026", "--tolerance", "6%").returncode == 0
    (tmp_path / "all" / "calibration.json").write_bytes(saved.read_bytes())
    (tmp_path / "all" / "other.json").write_text("{}")
    done = labcdp("history", "all", "-o", "history.html")
    assert done.returncode == 0, done.stderr
    assert "verification: conform" in done.stdout
    assert "Written: history.html" in done.stderr
    text = (tmp_path / "history.html").read_text()
    assert "data:image/png;base64," in text
    assert "Simulated" in text
    done = labcdp("history", "all/calibration.json", "all/2026/verification.json", "--json", "-o", "history.png")
    result = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(result)
    assert [row["by"] for row in result["tables"]["history"]["rows"]] == ["calibration", "verification: conform"]
    assert (tmp_path / "history.png").read_bytes().startswith(b"\x89PNG")
    assert labcdp("history", "all", "-o", "history.xlsx").returncode == 0


CERTIFICATE = """number = "K 42"
laboratory = "A laboratory <of> Berlin"
date = 2025-12-01
due_date = 2026-12-01
correction = 1.05
expanded_uncertainty_rel = 0.008
degrees_of_freedom = 50
"""


def test_a_certificate_is_applied_stated_and_found_overdue(labcdp, verify, recorded, again, tmp_path):
    (tmp_path / "certificate.toml").write_text(CERTIFICATE)
    assert labcdp("calibrate", recorded, "--output", "plain").returncode == 0
    done = labcdp("calibrate", recorded, "--output", "out", "--certificate", "certificate.toml", "--json")
    values = json.loads(done.stdout)
    assert "meter-without-certificate" not in {one["code"] for one in values["findings"]}
    plain, corrected = (load(tmp_path / name / "calibration.json") for name in ("plain", "out"))
    ratio = plain.responsivity.responsivity_dn_s_cd_m2 / corrected.responsivity.responsivity_dn_s_cd_m2
    assert ratio == pytest.approx(1.05, rel=1e-6)
    page = (tmp_path / "out" / "certificate.html").read_text(encoding="utf-8")
    assert "A laboratory &lt;of&gt; Berlin, 2025-12-01, due 2026-12-01: correction 1.05" in page
    # The session's own configuration has none: with the same meter that of the calibration holds.
    _, values = verify("out/calibration.json", again, "--tolerance", "6%")
    assert (verdict(values), values["tables"]["verdict"]["rows"][0]["same_meter"]) == ("conform", True)
    assert "certificate-overdue" in {one["code"] for one in values["findings"]}
    (folder,) = tmp_path.glob("*-verify")
    page = (folder / "certificate.html").read_text(encoding="utf-8")
    assert "was due on 2026-12-01" in page
    assert "6 of 6 patches conform to ± 6.0" in page
    # The uncorrected calibration by the same meter: a change, and not of the camera alone.
    _, values = verify("plain/calibration.json", again, "--certificate", "certificate.toml", "--output", "other")
    assert verdict(values) != "conform"
    assert "meter-recalibrated" in {one["code"] for one in values["findings"]}


@pytest.mark.skipif(sys.platform != "linux", reason="xdg-open is that of Linux")
def test_open_shows_the_page(labcdp, saved, tmp_path):
    opened, browser = tmp_path / "opened", tmp_path / "bin" / "xdg-open"
    browser.parent.mkdir()
    browser.write_text(f'#!/bin/sh\necho "$1" > {opened}.part && mv {opened}.part {opened}\n')
    browser.chmod(0o755)
    path = {"PATH": f"{browser.parent}:{os.environ['PATH']}"}
    assert labcdp("history", saved, "-o", "history.html", "--open", environment=path).returncode == 0
    deadline = time.monotonic() + 60
    while not opened.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert opened.read_text() == "history.html\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("{saved}", "bench.toml", "own", "x", "--simulated"), "3 paths after the calibration are too many"),
        (("{saved}", "{session}", "--tolerance", "0%"), "tolerance_rel is 0.0: give a fraction above 0, up to 1"),
        (("{saved}", "bench.toml"), "bench.toml is a file: give the folder of a session"),
        (("{saved}", "none"), "none is not a session"),
        (("bench.toml", "none"), "bench.toml: not valid JSON"),
        (("{saved}", "{session}", "--simulated"), "options of devices cannot be used with a recorded session"),
        (("{saved}", "{session}", "--patch", "none"), "there is no patch 'none' to verify with: choose from P01"),
        (("{saved}", "bench.toml", "own", "--simulated", "--patch", "none"), "there is no patch 'none' to verify with"),
        (("{saved}", "bench.toml", "own"), "no serial port for the meter"),
    ],
)
def test_refusals_of_verify(fails, saved, recorded, bench, arguments, words):
    bench()
    given = [text.format(saved=saved, session=recorded) for text in arguments]
    assert words in fails("verify", *given)


def test_the_simulated_bench_has_no_colour_filters(fails, saved, bench, tmp_path):
    mono = load(saved)
    planes = tuple(replace(mono, state=replace(mono.state, plane=plane)) for plane in PLANES)
    nothing = ((0.0,) * 4,) * 4
    residuals, low_high = mono.residuals, mono.range_cd_m2
    save(
        ColourCalibration(planes, (0.25,) * 4, nothing, 0.0, 0.0, low_high, residuals, (), (), (), None, None, ()),
        tmp_path / "colour.json",
    )
    line = fails("verify", "colour.json", bench(), "own", *SIMULATED)
    assert "the camera of the simulated bench has no colour filters, the calibration's has: measure with that" in line
    assert not (tmp_path / "own").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("{saved}", "-o", "history.pdf"), "--output is history.pdf: give a file that ends in .html, .png or .xlsx"),
        (("none.json",), "none.json cannot be read"),
        (
            ("{saved}", "-o", "history.png", "--open"),
            "--open opens a page: give --output with a file that ends in .html",
        ),
        (("empty",), "empty contains no calibration"),
    ],
)
def test_refusals_of_history(fails, saved, tmp_path, arguments, words):
    (tmp_path / "empty").mkdir()
    assert words in fails("history", *(text.format(saved=saved) for text in arguments))


def test_a_broken_file_of_a_history_is_named_and_the_rest_is_shown(labcdp, saved, tmp_path):
    (tmp_path / "all").mkdir()
    (tmp_path / "all" / "calibration.json").write_bytes(saved.read_bytes())
    (tmp_path / "all" / "calibration-2.json").write_bytes(saved.read_bytes()[:500])
    (tmp_path / "all" / "calibration-3.json").write_text(
        saved.read_text().replace("LED", "led", 1).replace("D65", "D66")
    )
    done = labcdp("history", "all", "--json")
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)["tables"]["history"]["rows"]) == 1
    assert "Left out: all/calibration-2.json: not valid JSON" in done.stderr
    assert "Left out: calibration all/calibration-3.json was changed after it was written" in done.stderr


def test_the_calibration_s_own_session_is_refused(fails, saved, recorded):
    assert "the calibration was made from session" in fails("verify", saved, recorded, "--output", "own")
