"""The simulated bench as a process of its own, and the commands that find, check and read its devices."""

import json
import re
import signal
import subprocess
import sys
from types import SimpleNamespace
from xml.etree import ElementTree
from zipfile import ZipFile

import cv2
import numpy as np
import pytest
import serial

from labcdp.chain import Chain
from labcdp.drivers.simulated.genicam import Address
from labcdp.drivers.simulated.gige_camera import SimulatedDevice, SimulatedGigECamera
from labcdp.session import SessionConfiguration, example_session

from .conftest import results_of, rows_of

STATES = {"good", "notice", "fault", "unknown"}


def say(bench, line):
    bench.stdin.write(line + "\n")
    bench.stdin.flush()
    return bench.stderr.readline().strip()


def checks_of(done):
    """Rows of `labcdp doctor --json` by group and topic, whose counts and exit status fit them."""
    values = results_of(done, status=done.returncode)
    rows = values["tables"]["checks"]["rows"]
    states, groups = [row["state"] for row in rows], {}
    for row in rows:
        groups.setdefault(row["group"], {})[row["topic"]] = row
    counts = {row["state"]: row["count"] for row in values["tables"]["counts"]["rows"]}
    assert counts == {state: states.count(state) for state in STATES}
    assert done.returncode == ("fault" in states)
    return groups


def test_typed_commands_and_faults_befall_the_devices(running_bench):
    bench, told = running_bench
    assert (told["camera"]["address"], told["camera"]["serial"]) == ("127.0.0.1", "SIM-503363706")
    assert told["camera"]["model"].endswith("Manta_G-505B")
    for line, answer in (
        ("status", "Lens open; meter points at P01"),
        ("cover", "Lens covered; meter points at P01"),
        ("uncover", "Lens open; meter points at P01"),
        ("point lower left", "Lens open; meter points at lower left"),
        ("point nowhere", "there is no patch 'nowhere': choose one of P01"),
        ("dance", "Type: cover | uncover | point PATCH | status | quit"),
        ("light -10%", "Lens open; meter points at lower left; light 90.0%, camera at 35.0 degrees"),
        ("temperature +5 C", "Lens open; meter points at lower left; light 90.0%, camera at 40.0 degrees"),
        ("show P07", "Lens open; meter points at P07"),
        ("lose 5", "'lose 5' is not a known fault: write for example 'lose 5% for 20 s'"),
        ("meter ER30", "Lens open"),
    ):
        assert say(bench, line).startswith(answer)
    with serial.Serial(told["meter"]["port"], 4800, bytesize=7, parity="E", stopbits=2, timeout=300) as port:
        port.write(b"MES\r\n")
        assert port.readline() == b"ER30\r\n"
    bench.stdin.write("vanish for 1 h\nquit\n")
    bench.stdin.flush()
    assert bench.wait(300) == 0


@pytest.fixture
def odd_camera(aravis):
    """A camera beside that of the bench, whose names are no UTF-8 and would colour the terminal."""
    device = SimulatedDevice("SIM-2", width=64, height=48)
    flat = SimpleNamespace(state=0, expose=lambda *_: np.full((48, 64), 100, np.uint16))
    with SimulatedGigECamera(device, flat, "127.0.0.2") as served:
        served._registers.write(Address.MODEL, int.from_bytes(b"\xff\x1b[3", "big"))
        served._registers.write(Address.MODEL + 4, int.from_bytes(b"1m\x07\0", "big"))
        yield served


class TestWithABench:
    def test_devices_are_found_checked_and_read(self, labcdp, shared_bench, tmp_path):
        port, camera = shared_bench["meter"]["port"], shared_bench["camera"]["serial"]
        found = results_of(labcdp("devices", "--json"))
        assert [row["serial"] for row in found["tables"]["cameras"]["rows"]] == [camera]
        assert "cameras-unknown" not in {finding["code"] for finding in found["findings"]}

        snapped = results_of(labcdp("snap", "first.tif", "--exposure", "2ms", "--json"))
        assert snapped["configuration"]["exposure_s"] == 0.002
        quantities = {row["quantity"]: row["value"] for row in snapped["tables"]["frame"]["rows"]}
        pixels = cv2.imread(str(tmp_path / "first.tif"), cv2.IMREAD_UNCHANGED)
        assert pixels.shape == (400, 480)
        assert pixels.mean() == pytest.approx(quantities["mean"])
        # Beside it what a viewer shows: sRGB (IEC 61966-2-1) of the share of saturation.
        seen = cv2.imread(str(tmp_path / "first.png"), cv2.IMREAD_UNCHANGED)
        assert (seen.dtype, seen.shape) == (np.uint8, pixels.shape)
        linear = np.where(seen <= 10, seen / 255 / 12.92, ((seen / 255 + 0.055) / 1.055) ** 2.4)
        np.testing.assert_allclose(linear, pixels / 4095, atol=0.005)
        assert labcdp("snap", "first.tif").returncode == 1

        tables = results_of(labcdp("meter", "--meter", port, "-n", "4", "--slow", "--peak", "--json"))["tables"]
        values = [reading["value"] for reading in tables["readings"]["rows"]]
        series = {row["quantity"]: row for row in tables["series"]["rows"]}
        assert series["mean"]["value"] == pytest.approx(sum(values) / 4)
        assert series["mean"]["u_value"] > 0
        assert [reading["peak"] for reading in tables["readings"]["rows"]] == [True] * 4

        groups = checks_of(labcdp("doctor", "--json", "--meter", port, "--stream-test", camera))
        _, of_camera, of_meter = groups
        assert camera in of_camera
        assert groups[of_camera]["controller"]["state"] == "good"
        assert groups[of_camera]["frames"]["cause"].startswith("5 of 5 frames came whole")
        assert of_meter == f"Luminance meter on {port}"
        assert groups[of_meter]["unit"]["state"] == "good"

    def test_a_problem_report_holds_description_features_and_bytes(self, labcdp, shared_bench, tmp_path):
        done = labcdp("doctor", "--meter", shared_bench["meter"]["port"], "--report", "bug.zip")
        assert "Written: bug.zip" in done.stderr
        name = f"camera-{shared_bench['camera']['serial'].replace('-', '_')}"
        with ZipFile(tmp_path / "bug.zip") as archive:
            assert set(archive.namelist()) == {"doctor.json", f"{name}.json", f"{name}.xml", "meter.jsonl"}
            camera = json.loads(archive.read(f"{name}.json"))
            description = ElementTree.fromstring(archive.read(f"{name}.xml"))
            meter = [json.loads(line) for line in archive.read("meter.jsonl").splitlines()]
        assert camera["features"]["DeviceID"] == shared_bench["camera"]["serial"]
        assert camera["not understood"] == []
        assert description.attrib["ModelName"] == "Manta_G-505B"
        assert "MES\r\n" in [entry.get("sent") for entry in meter]
        assert labcdp("doctor", "--report", "bug.zip").returncode == 1

    def test_names_of_any_bytes_end_no_command_and_reach_no_terminal(self, labcdp, shared_bench, odd_camera):
        snaps = [
            ("snap", f"{serial}.tif", "--camera", serial) for serial in (shared_bench["camera"]["serial"], "SIM-2")
        ]
        for command in (("devices",), ("doctor",), *snaps):
            done = labcdp(*command)
            assert "Traceback" not in done.stderr
            assert not {"\x1b[31m", "\x07"} & set(re.findall(r"\x1b\[31m|\x07", done.stdout + done.stderr))
            assert command[0] == "doctor" or done.returncode == 0, done.stderr
        assert {(row["serial"], row["model"]) for row in rows_of(labcdp("devices", "--json"), "cameras")} == {
            (shared_bench["camera"]["serial"], "Manta_G-505B"),
            ("SIM-2", "\ufffd\\x1b[31m\\x07"),
        }


def test_a_session_between_two_programs(labcdp, start, running_bench):
    """The bench in one process, the person's acquisition in another, with nothing but the protocols between."""
    bench, told = running_bench
    configuration = SessionConfiguration.load(example_session() / "session.toml")
    names = [patch.name for patch in configuration.target.patches]
    asked = []
    acquisition = start(
        "acquire", example_session() / "session.toml", "two", "--meter", told["meter"]["port"], pipes=True
    )
    for line in acquisition.stderr:
        if "then press Enter" not in line:
            continue
        asked.append(line.strip())
        patch = re.search("patch (.*), then", line)
        act = "cover" if "Cover the lens" in line else "uncover" if "Uncover" in line else f"point {patch[1]}"
        assert "meter points at" in say(bench, act)
        acquisition.stdin.write("\n")
        acquisition.stdin.flush()
    assert acquisition.wait() == 0
    assert len(asked) == 2 + len(names) + 1
    # What the simulated chain is made of, read with a meter that shows 0.6 % too much.
    true = Chain.load("manta-g505").camera().conversion(temperature_c=35.0).responsivity_dn_s_cd_m2
    rows = rows_of(labcdp("calibrate", "two", "--json"), "calibration")
    fitted = next(row["value"] for row in rows if row["quantity"] == "responsivity R")
    assert fitted == pytest.approx(true / 1.006, rel=0.002)
    # Without a terminal the bench continues, until a signal.
    bench.stdin.close()
    assert labcdp("meter", "--meter", told["meter"]["port"], "-n", "3").returncode == 0
    assert bench.poll() is None
    bench.send_signal(signal.SIGTERM)
    assert bench.wait(300) == 0


def test_devices_that_are_not_there_are_faults_with_remedies(labcdp, aravis):
    assert "no camera was found" in labcdp("devices").stderr
    groups = checks_of(labcdp("doctor", "--json"))
    assert {"Python", "Aravis", "receive buffer", "UDP port 3956"} <= groups["This computer"].keys()
    assert groups["Cameras"]["discovery"]["state"] == "notice"
    assert len(groups) == 2
    groups = checks_of(
        labcdp("doctor", "--json", "--camera", "NONE-1", "--meter", "/dev/ttyNONE", "--meter-model", "LS-100")
    )
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
    assert (done.returncode, done.stderr) == (1, "")
    rows = {row["topic"]: row for row in json.loads(done.stdout)["tables"]["checks"]["rows"]}
    assert (rows["Aravis"]["state"], rows["discovery"]["state"]) == ("fault", "unknown")
    assert rows["receive buffer"]


def test_a_person_reads_marks_causes_remedies_and_counts_on_a_terminal_without_the_marks(labcdp):
    done = labcdp("doctor", "--meter", "/dev/ttyNONE", environment={"PYTHONIOENCODING": "ascii"})
    lines = done.stdout.splitlines()
    assert done.returncode == 1
    at = lines.index("  XX serial port /dev/ttyNONE: there is no /dev/ttyNONE")
    assert lines[at - 1] == "Luminance meter on /dev/ttyNONE"
    assert lines[at + 1].startswith("       plug the adapter in")
    counted = sum(line.startswith("  ") and not line.startswith("     ") for line in lines)
    assert sum(int(part.split()[0]) for part in lines[-1].split(", ")) == counted
    assert re.match(r"(1 fault|[2-9] faults), (1 notice|\d+ notices), \d+ unknown, \d+ good$", lines[-1])
