import json
import shutil
from dataclasses import replace

import pytest
from jsonschema import validate

from labcdp.report.envelope import schema
from labcdp.session import Session, example_session

#: Fewer patches than the session has, which are quicker.
FEW = [text for i in range(1, 13) if i not in (1, 5) for text in ("--without", f"P{i:02}")]


def test_the_twin_is_written_and_its_chain_simulated(labcdp, tmp_path):
    done = labcdp("twin", example_session(), "-o", "out", "--json", *FEW)
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    validate(values, schema())
    (counts,) = values["tables"]["summary"]["rows"]
    assert counts["agreeing"] >= 0.93 * counts["pairs"]
    assert values == json.loads((tmp_path / "out" / "results.json").read_text())
    names = {str(p.relative_to(tmp_path / "out")) for p in (tmp_path / "out").rglob("*") if p.is_file()}
    assert names - {"labcdp-files.json"} == {
        "chain.toml",
        "report.html",
        "results.xlsx",
        "results.json",
        "figures/twin.png",
    }
    simulated = labcdp("simulate", "out/chain.toml", "-o", "simulated", "--json")
    assert simulated.returncode == 0, simulated.stderr
    rows = json.loads(simulated.stdout)["tables"]["signal"]["rows"]
    assert {row["stage"] for row in rows} >= {"scene", "optics", "sensor"}


def test_a_person_is_reported_the_result_and_a_calibration_from_a_file_is_used(labcdp, tmp_path):
    assert labcdp("calibrate", example_session(), "-o", "results").returncode == 0
    asked = ("--contrast", "200%", "--epsilon", "30%", "--calibration", "results/calibration.json")
    done = labcdp("twin", example_session(), "-o", "out", *asked, *FEW)
    assert done.returncode == 0, done.stderr
    assert "pairs" in done.stdout
    assert "Next: labcdp simulate out/chain.toml" in done.stderr
    values = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [one["role"] for one in values["inputs"]] == ["session", "calibration"]
    facts = {row["item"]: row["value"] for row in values["tables"]["provenance"]["rows"]}
    assert facts["SHA-256 of those of the calibration"] == facts["SHA-256 of frames and readings"]


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


def test_one_dark_frame_is_too_few(fails, session):
    session.supersede(session.frames("dark")[1:], "test")
    assert " s: take at least 2 of each exposure, the noise comes from their difference" in fails("twin", "s")


def test_one_patch_is_too_few(fails):
    names = [patch.name for patch in Session.open(example_session()).configuration.target.patches]
    left_out = [text for name in names[1:] for text in ("--without", name)]
    assert "1 of 1 patches are usable, a calibration needs at least 3" in fails(
        "twin", example_session(), "-o", "out", *left_out
    )


def test_a_session_with_colour_filters_is_refused(fails, session, tmp_path):
    frame = session.load(session.frames("light")[0])
    with Session.create(tmp_path / "colour", session.configuration) as colour:
        colour.add_frame(replace(frame, colour_filter="RG", pixel_format="BayerRG12"), "light")
    assert "twins of colour cameras are not supported" in fails("twin", "colour")


def test_what_cannot_be_read_is_named(fails, tmp_path):
    assert "nowhere" in fails("twin", "nowhere")
    assert "--contrast" in fails("twin", example_session(), "--contrast", "much")
    (tmp_path / "file").write_text("")
    assert "file: not valid JSON" in fails("twin", example_session(), "--calibration", "file")
    assert "file is not a folder" in fails("twin", example_session(), "-o", "file")
