import json
import shutil

import pytest

from labcdp.session import Session, example_session

#: Fewer patches than the session has, which are quicker.
FEW = [text for i in range(1, 13) if i not in (1, 5) for text in ("--without", f"P{i:02}")]


def test_the_twin_is_written_and_its_chain_simulated(labcdp, tmp_path):
    done = labcdp("twin", example_session(), "-o", "out", "--json", *FEW)
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert values["pairs_agreeing"] >= 0.93 * values["pairs_compared"]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "chain.toml",
        "report.html",
        "results.xlsx",
        "results.json",
        "twin.png",
    }
    simulated = labcdp("simulate", "out/chain.toml", "-o", "simulated", "--json")
    assert simulated.returncode == 0, simulated.stderr
    assert {stage["name"] for stage in json.loads(simulated.stdout)["stages"]} >= {"scene", "optics", "sensor"}


def test_a_person_is_told_the_result_and_what_to_do_next(labcdp):
    done = labcdp("twin", example_session(), "-o", "out", "--contrast", "200%", "--epsilon", "30%", *FEW)
    assert done.returncode == 0, done.stderr
    text = " ".join(done.stderr.split())
    assert "agree with the measurement within the joint 95 % interval" in text
    assert "Next: labcdp simulate out/chain.toml" in text


def test_a_calibration_from_a_file_is_used(labcdp):
    assert labcdp("calibrate", example_session(), "-o", "results").returncode == 0
    done = labcdp("twin", example_session(), "--calibration", "results/calibration.json", "-o", "out", "--json", *FEW)
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert values["calibration_input_sha256"] == values["input_sha256"]


@pytest.fixture
def session(tmp_path):
    """A copy of the example session that may be changed."""
    shutil.copytree(example_session(), tmp_path / "s")
    with Session.open(tmp_path / "s", writable=True) as opened:
        yield opened


def test_a_session_without_darks_is_refused(fails, session):
    session.supersede(session.frames("dark"), "test")
    assert "no dark frames: cover the lens" in fails("twin", "s")


def test_a_session_without_readings_is_refused(fails, session):
    session.supersede(session.readings(), "test")
    assert "reading" in fails("twin", "s")


def test_what_cannot_be_read_is_named(fails, tmp_path):
    assert "nowhere" in fails("twin", "nowhere")
    assert "--contrast" in fails("twin", example_session(), "--contrast", "much")
    (tmp_path / "file").write_text("")
    assert "file cannot be made" in fails("twin", example_session(), "-o", "file")
