"""labcdp verify and labcdp history, as a person runs them."""

import json
import os
import sys
import time
from datetime import UTC, datetime

import pytest

from labcdp.acquire import acquire
from labcdp.calibration import load, save
from labcdp.core.clock import SimulatedClock
from labcdp.drivers.simulated import SimulatedBenchFile
from labcdp.drivers.simulated.bench import SimulatedBench
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.session import Session, SessionConfiguration

from .conftest import SIMULATED, SMALL_BENCH, plan, results_of, rows_of

PLAN = plan("P01|P04|P07|P12|upper right|lower right", [0.002, 0.032])
CERTIFICATE = """number = "K 42"
laboratory = "A laboratory <of> Berlin"
date = 2025-12-01
due_date = 2026-12-01
correction = 1.05
expanded_uncertainty_rel = 0.008
degrees_of_freedom = 50
"""


def record(path, clock):
    configuration = SessionConfiguration.from_toml(PLAN, "plan")
    bench = SimulatedBench(configuration, SimulatedBenchFile.load(SMALL_BENCH).devices(), clock=clock)
    with (
        Session.create(path, configuration, clock=clock) as session,
        bench,
        bench.in_process_camera() as camera,
        bench.in_process_meter() as meter,
    ):
        acquire(session, camera, meter, bench, clock=clock)
    return path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A session on the small bench."""
    return record(tmp_path_factory.mktemp("recorded") / "session", SimulatedClock())


@pytest.fixture(scope="module")
def again(tmp_path_factory):
    """The same bench, recorded a day later."""
    return record(tmp_path_factory.mktemp("again") / "session", SimulatedClock(datetime(2030, 1, 2, tzinfo=UTC)))


@pytest.fixture(scope="module")
def saved(recorded):
    """Calibration of the first."""
    path = recorded.with_name("calibration.json")
    with Session.open(recorded) as session:
        save(calibrate_session(observe_session(session)), path)
    return path


def verdict(values):
    (row,) = values["tables"]["verdict"]["rows"]
    return row["verdict"]


def codes(values):
    return {one["code"] for one in values["findings"]}


def test_a_recorded_session_is_verified_and_stands_in_the_history(labcdp, saved, again, tmp_path):
    done = labcdp("verify", saved, again, "--output", "all/2026", "--tolerance", "6%")
    assert done.returncode == 0, done.stderr
    assert "conform: camera and meter agree on all 6 patches within ± 6.0 %" in done.stderr
    for name in ("calibration.json", "calibration-2.json", "calibration-3.json", "other.json"):
        (tmp_path / "all" / name).write_bytes(saved.read_bytes())
    (tmp_path / "all" / "other.json").write_text("{}")
    # One is cut off, one altered: they are named and left out.
    (tmp_path / "all" / "calibration-2.json").write_bytes(saved.read_bytes()[:500])
    (tmp_path / "all" / "calibration-3.json").write_text(saved.read_text().replace("D65", "D66"))
    done = labcdp("history", "all", "-o", "history.html", "--json")
    assert [row["by"] for row in rows_of(done, "history")] == ["calibration", "verification: conform"]
    assert "Left out: all/calibration-2.json: not valid JSON" in done.stderr
    assert "Left out: calibration all/calibration-3.json was changed after it was written" in done.stderr
    page = (tmp_path / "history.html").read_text()
    assert "data:image/png;base64," in page
    assert "Simulated" in page
    for suffix, start in (("png", b"\x89PNG"), ("xlsx", b"PK")):
        done = labcdp("history", "all/calibration.json", "all/2026/verification.json", "-o", f"history.{suffix}")
        assert "verification: conform" in done.stdout
        assert (tmp_path / f"history.{suffix}").read_bytes().startswith(start)
    # The meter shows 0.50 cd/m² for P01: one digit is more than the tolerance, U of the calibration.
    options = ("--output", "all/2026", "--force", "--patch", "P01", "--patch", "P07", "--json")
    values = results_of(labcdp("verify", saved, again, *options), status=4)
    assert verdict(values) == "undecided"
    rows = values["tables"]["patches"]["rows"]
    assert [(row["patch"], row["verdict"]) for row in rows] == [("P01", "undecided"), ("P07", "conform")]
    assert values["tables"]["verdict"]["rows"][0]["same_meter"] is True
    assert values == json.loads((tmp_path / "all/2026/results.json").read_text(encoding="utf-8"))


def test_measuring_again_on_the_same_bench(labcdp, saved, tmp_path):
    (tmp_path / "bench.toml").write_text(PLAN)
    command = ("verify", saved, "bench.toml", "own", *SIMULATED, "--tolerance", "6%", "--json")
    values = results_of(labcdp(*command))
    assert verdict(values) == "conform"
    assert len(values["tables"]["patches"]["rows"]) == 3
    assert (tmp_path / "own-verify" / "verification.json").exists()
    with Session.open(tmp_path / "own") as session:
        session.verify()
        assert len(session.frames("dark")) >= 2
    # What is complete is not measured again.
    assert results_of(labcdp(*command, "--force"))["tables"] == values["tables"]


def test_a_certificate_is_applied_stated_and_found_overdue(labcdp, recorded, again, tmp_path):
    (tmp_path / "certificate.toml").write_text(CERTIFICATE)
    assert labcdp("calibrate", recorded, "--output", "plain").returncode == 0
    done = labcdp("calibrate", recorded, "--output", "out", "--certificate", "certificate.toml", "--json")
    assert "meter-without-certificate" not in codes(results_of(done))
    plain, corrected = (load(tmp_path / name / "calibration.json") for name in ("plain", "out"))
    ratio = plain.responsivity.responsivity_dn_s_cd_m2 / corrected.responsivity.responsivity_dn_s_cd_m2
    assert ratio == pytest.approx(1.05, rel=1e-6)
    page = (tmp_path / "out" / "certificate.html").read_text(encoding="utf-8")
    assert "A laboratory &lt;of&gt; Berlin, 2025-12-01, due 2026-12-01: correction 1.05" in page
    # The session's own configuration has none: with the same meter that of the calibration holds.
    values = results_of(labcdp("verify", "out/calibration.json", again, "--tolerance", "6%", "--json"))
    assert (verdict(values), values["tables"]["verdict"]["rows"][0]["same_meter"]) == ("conform", True)
    assert "certificate-overdue" in codes(values)
    (folder,) = tmp_path.glob("*-verify")
    page = (folder / "certificate.html").read_text(encoding="utf-8")
    assert "was due on 2026-12-01" in page
    assert "6 of 6 patches conform to ± 6.0" in page


@pytest.mark.skipif(sys.platform != "linux", reason="xdg-open is that of Linux")
def test_open_shows_the_page(labcdp, saved, tmp_path):
    opened, browser = tmp_path / "opened", tmp_path / "bin" / "xdg-open"
    browser.parent.mkdir()
    browser.write_text(f'#!/bin/sh\necho "$1" > {opened}.part && mv {opened}.part {opened}\n')
    browser.chmod(0o755)
    path = {"PATH": f"{browser.parent}:{os.environ['PATH']}"}
    assert labcdp("history", saved, "-o", "history.html", "--open", environment=path).returncode == 0
    deadline = time.monotonic() + 300
    while not opened.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert opened.read_text() == "history.html\n"
