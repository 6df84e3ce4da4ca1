"""labcdp doctor, as a person runs it."""

import json
import os
import re
import subprocess
import sys
from xml.etree import ElementTree
from zipfile import ZipFile

import pytest
from jsonschema import Draft202012Validator

from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.report.envelope import schema

STATES = {"good", "notice", "fault", "unknown"}


@pytest.fixture
def checked(labcdp):
    """Run the command with --json; returns its exit status and its findings by group."""

    def run(*arguments):
        done = labcdp("doctor", "--json", *arguments)
        assert "Traceback" not in done.stderr
        result = json.loads(done.stdout)
        Draft202012Validator(schema()).validate(result)
        groups, rows = {}, result["tables"]["checks"]["rows"]
        for row in rows:
            groups.setdefault(row["group"], {})[row["topic"]] = row
        states = [row["state"] for row in rows]
        counts = {row["state"]: row["count"] for row in result["tables"]["counts"]["rows"]}
        assert counts == {state: states.count(state) for state in STATES}
        assert done.returncode == (1 if "fault" in states else 0)
        return done.returncode, groups

    return run


def test_without_devices_the_computer_is_checked(checked, aravis):
    _, groups = checked()
    assert {"Python", "Aravis", "receive buffer", "UDP port 3956"} <= groups["This computer"].keys()
    assert groups["Cameras"]["discovery"]["state"] == "notice"
    assert groups["Cameras"]["discovery"]["cause"].startswith("no camera answers")
    assert len(groups) == 2


def test_camera_and_meter_of_the_simulated_bench(checked, running_bench):
    _, told = running_bench()
    with MinoltaLS110(told["meter"]["port"]) as meter:
        meter.measure()
    _, groups = checked("--meter", told["meter"]["port"], "--stream-test", told["camera"]["serial"])
    _, camera, meter = groups
    assert told["camera"]["serial"] in camera
    assert groups[camera]["controller"]["state"] == "good"
    assert groups[camera]["frames"]["cause"].startswith("5 of 5 frames came whole")
    assert meter == f"Luminance meter on {told['meter']['port']}"
    assert groups[meter]["unit"]["state"] == "good"
    # The bench has the port, and is named.
    assert groups["This computer"]["UDP port 3956"]["state"] == "notice"


def test_a_problem_report_holds_description_features_and_bytes(labcdp, running_bench, tmp_path):
    _, told = running_bench()
    done = labcdp("doctor", "--meter", told["meter"]["port"], "--report", "bug.zip")
    assert "Written: bug.zip" in done.stderr
    serial = told["camera"]["serial"].replace("-", "_")
    with ZipFile(tmp_path / "bug.zip") as archive:
        assert set(archive.namelist()) == {
            "doctor.json",
            f"camera-{serial}.json",
            f"camera-{serial}.xml",
            "meter.jsonl",
        }
        camera = json.loads(archive.read(f"camera-{serial}.json"))
        description = ElementTree.fromstring(archive.read(f"camera-{serial}.xml"))
        meter = [json.loads(line) for line in archive.read("meter.jsonl").splitlines()]
        Draft202012Validator(schema()).validate(json.loads(archive.read("doctor.json")))
    assert camera["features"]["DeviceID"] == told["camera"]["serial"]
    assert camera["not understood"] == []
    assert description.attrib["ModelName"] == "Manta_G-505B"
    assert "MES\r\n" in [entry.get("sent") for entry in meter]
    assert labcdp("doctor", "--report", "bug.zip").returncode == 1


def test_every_camera_is_checked_without_being_named(checked, running_bench):
    _, told = running_bench()
    _, groups = checked()
    assert [name for name in groups if told["camera"]["serial"] in name]


def test_devices_that_are_not_there_are_faults_with_remedies(checked, aravis):
    status, groups = checked("--camera", "NONE-1", "--meter", "/dev/ttyNONE", "--meter-model", "LS-100")
    assert status == 1
    assert groups["Cameras"]["discovery"]["state"] == "fault"
    row = groups["Luminance meter on /dev/ttyNONE"]["serial port /dev/ttyNONE"]
    assert (row["state"], row["cause"]) == ("fault", "there is no /dev/ttyNONE")
    assert row["remedy"].startswith("plug the adapter in")


def test_a_machine_without_aravis(tmp_path):
    """PyGObject hidden from the command, as in a virtual environment that does not see Debian's."""
    code = (
        "import sys; sys.modules['gi'] = None; sys.argv = ['labcdp', 'doctor', '--json'];"
        "from labcdp.cli import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode == 1
    assert done.stderr == ""
    rows = {row["topic"]: row for row in json.loads(done.stdout)["tables"]["checks"]["rows"]}
    assert rows["Aravis"]["state"] == "fault"
    assert rows["discovery"]["state"] == "unknown"
    assert rows["receive buffer"]


@pytest.mark.parametrize(("encoding", "mark"), [("utf-8", "✗"), ("ascii", "XX")])
def test_a_person_reads_marks_causes_remedies_and_counts(labcdp_path, tmp_path, encoding, mark):
    done = subprocess.run(
        [labcdp_path, "doctor", "--meter", "/dev/ttyNONE"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONIOENCODING": encoding},
        capture_output=True,
        timeout=600,
    )
    lines = done.stdout.decode(encoding).splitlines()
    assert done.returncode == 1
    assert lines[0] == "This computer"
    at = lines.index(f"  {mark:<3}serial port /dev/ttyNONE: there is no /dev/ttyNONE")
    assert lines[at - 1] == "Luminance meter on /dev/ttyNONE"
    assert lines[at + 1].startswith("       plug the adapter in")
    counted = sum(line.startswith("  ") and not line.startswith("     ") for line in lines)
    assert sum(int(part.split()[0]) for part in lines[-1].split(", ")) == counted
    assert re.match(r"(1 fault|[2-9] faults), (1 notice|\d+ notices), \d+ unknown, \d+ good$", lines[-1])
