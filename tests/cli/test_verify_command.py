"""labcdp verify and labcdp history, as a person runs them."""

import json
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
    """Sessions on the small bench, the second one some years later, and the calibration of the first."""
    folder = tmp_path_factory.mktemp("recorded")
    first = record(folder / "session", SimulatedClock())
    again = record(folder / "again", SimulatedClock(datetime(2030, 1, 2, tzinfo=UTC)))
    with Session.open(first) as session:
        save(calibrate_session(observe_session(session)), folder / "calibration.json")
    return first, again, folder / "calibration.json"


def verdict(values):
    (row,) = values["tables"]["verdict"]["rows"]
    return row["verdict"], row["same_meter"]


def test_a_recorded_session_is_verified_and_stands_in_the_history(labcdp, recorded, tmp_path):
    _, again, saved = recorded
    done = labcdp("verify", saved, again, "--output", "all/2026", "--tolerance", "6%")
    assert done.returncode == 0, done.stderr
    made = json.loads((tmp_path / "all/2026/verification.json").read_text(encoding="utf-8"))
    assert made["verification"]["calibration_number"] == json.loads(saved.read_text(encoding="utf-8"))["number"]
    # One is cut off, one altered, one something else: they are left out.
    (tmp_path / "all/calibration.json").write_bytes(saved.read_bytes())
    (tmp_path / "all/calibration-2.json").write_bytes(saved.read_bytes()[:500])
    (tmp_path / "all/calibration-3.json").write_text(saved.read_text().replace("D65", "D66"))
    (tmp_path / "all/other.json").write_text("{}")
    done = labcdp("history", "all", "--json")
    assert [row["by"] for row in rows_of(done, "history")] == ["calibration", "verification: conform"]
    assert "Left out: all/calibration-2.json: not valid JSON" in done.stderr
    assert "Left out: calibration all/calibration-3.json was changed after it was written" in done.stderr
    assert (tmp_path / "all-history/report.html").exists()
    # The meter shows 0.50 cd/m² for P01: one digit is more than the tolerance, U of the calibration.
    options = ("--output", "all/2026", "--force", "--patch", "P01", "--patch", "P07", "--json")
    values = results_of(labcdp("verify", saved, again, *options), status=4)
    assert verdict(values) == ("undecided", True)
    rows = values["tables"]["patches"]["rows"]
    assert [(row["patch"], row["verdict"]) for row in rows] == [("P01", "undecided"), ("P07", "conform")]
    assert values == json.loads((tmp_path / "all/2026/results.json").read_text(encoding="utf-8"))


def test_measuring_again_on_the_same_bench(labcdp, recorded, tmp_path):
    (tmp_path / "bench.toml").write_text(PLAN)
    command = ("verify", recorded[2], "bench.toml", "own", *SIMULATED, "--tolerance", "6%", "--json")
    values = results_of(labcdp(*command))
    assert verdict(values)[0] == "conform"
    assert len(values["tables"]["patches"]["rows"]) == 3
    assert (tmp_path / "own-verify" / "verification.json").exists()
    with Session.open(tmp_path / "own") as session:
        session.verify()
        assert len(session.frames("dark")) >= 2
    # What is complete is not measured again; each file that is written is named.
    said = labcdp(*command[:-1], "--force")
    assert "Report: own-verify/certificate.html; also results.json and verification.json" in said.stdout + said.stderr
    assert results_of(labcdp(*command, "--force"))["tables"] == values["tables"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (("2025-12-01", "2026-03-02"), "certificate K 42 of 2026-03-02 is later than the readings of the meter"),
        (
            ("degrees", 'serial = "73323008"\ndegrees'),
            "certificate K 42 is of the meter LS-110 73323008, not of LS-110",
        ),
    ],
)
def test_a_certificate_that_says_nothing_about_the_readings_is_refused(labcdp, recorded, tmp_path, changes, message):
    (tmp_path / "certificate.toml").write_text(CERTIFICATE.replace(*changes))
    done = labcdp("calibrate", recorded[0], "--output", "out", "--certificate", "certificate.toml")
    (said,) = [line for line in done.stderr.splitlines() if line.startswith("labcdp: ")]
    assert (done.returncode, message in said) == (1, True)
    assert not (tmp_path / "out/calibration.json").exists()


def test_a_certificate_is_applied_stated_and_found_overdue(labcdp, recorded, tmp_path):
    (tmp_path / "certificate.toml").write_text(CERTIFICATE)
    done = labcdp("calibrate", recorded[0], "--output", "out", "--certificate", "certificate.toml", "--json")
    assert "meter-without-certificate" not in {one["code"] for one in results_of(done)["findings"]}
    plain, corrected = map(load, (recorded[2], tmp_path / "out/calibration.json"))
    ratio = plain.responsivity.responsivity_dn_s_cd_m2 / corrected.responsivity.responsivity_dn_s_cd_m2
    assert ratio == pytest.approx(1.05, rel=1e-6)
    page = (tmp_path / "out" / "certificate.html").read_text(encoding="utf-8")
    assert "A laboratory &lt;of&gt; Berlin, 2025-12-01, due 2026-12-01: correction 1.05" in page
    # The session's own configuration has none: with the same meter that of the calibration holds.
    done = labcdp("verify", "out/calibration.json", recorded[1], "--tolerance", "6%", "--output", "all", "--json")
    values = results_of(done)
    assert verdict(values) == ("conform", True)
    assert "certificate-overdue" in {one["code"] for one in values["findings"]}
    page = (tmp_path / "all/certificate.html").read_text(encoding="utf-8")
    assert "2026-12-01" in page
    assert "6 of 6 patches conform to ± 6.0" in page
