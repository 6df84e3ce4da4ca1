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


def checks_of(done):
    """Rows of `labcdp doctor --json` by group and topic, whose counts and exit status fit them."""
    tables, groups = results_of(done, status=done.returncode)["tables"], {}
    states = [row["state"] for row in tables["checks"]["rows"]]
    for row in tables["checks"]["rows"]:
        groups.setdefault(row["group"], {})[row["topic"]] = row
    counts = {row["state"]: row["count"] for row in tables["counts"]["rows"]}
    assert counts == {state: states.count(state) for state in STATES}
    assert done.returncode == ("fault" in states)
    return groups


def test_devices_that_are_not_there_are_faults_with_remedies(labcdp, aravis):
    assert "no camera was found" in labcdp("devices").stderr
    groups = checks_of(labcdp("doctor", "--json"))
    assert {"Python", "Aravis", "receive buffer", "UDP port 3956"} <= groups["This computer"].keys()
    assert groups["Cameras"]["discovery"]["state"] == "notice"
    assert len(groups) == 2
    meter = ("--meter", "/dev/ttyNONE")
    groups = checks_of(labcdp("doctor", "--json", "--camera", "NONE-1", *meter, "--meter-model", "LS-100"))
    assert groups["Cameras"]["discovery"]["state"] == "fault"
    row = groups["Luminance meter on /dev/ttyNONE"]["serial port /dev/ttyNONE"]
    assert (row["state"], row["cause"]) == ("fault", "there is no /dev/ttyNONE")
    # A person reads the same, also where the terminal does not have the marks.
    done = labcdp("doctor", *meter, environment={"PYTHONIOENCODING": "ascii"})
    lines = done.stdout.splitlines()
    at = lines.index("  XX serial port /dev/ttyNONE: there is no /dev/ttyNONE")
    assert lines[at - 1] == "Luminance meter on /dev/ttyNONE"
    assert lines[at + 1].strip() == row["remedy"]
    counted = sum(line.startswith("  ") and not line.startswith("     ") for line in lines)
    assert sum(int(part.split()[0]) for part in lines[-1].split(", ")) == counted


def test_a_machine_without_aravis(tmp_path):
    """PyGObject hidden from the command, as in a virtual environment that does not see Debian's."""
    code = (
        "import sys; sys.modules['gi'] = None; sys.argv = ['labcdp', 'doctor', '--json'];"
        "from labcdp.cli import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stderr) == (1, "")
    groups = checks_of(done)
    assert groups["This computer"]["Aravis"]["state"] == "fault"
    assert groups["Cameras"]["discovery"]["state"] == "unknown"


def test_devices_are_found_checked_and_read(labcdp, running_bench, tmp_path):
    _, camera, meter = running_bench
    assert (camera["address"], camera["serial"]) == ("127.0.0.1", "SIM-503363706")
    found = results_of(labcdp("devices", "--json"))
    assert [row["serial"] for row in found["tables"]["cameras"]["rows"]] == [camera["serial"]]
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

    port = ("--meter", meter["address"])
    tables = results_of(labcdp("meter", *port, "-n", "4", "--slow", "--peak", "--json"))["tables"]
    mean = next(row for row in tables["series"]["rows"] if row["quantity"] == "mean")
    assert mean["value"] == pytest.approx(np.mean([reading["value"] for reading in tables["readings"]["rows"]]))
    assert mean["u_value"] > 0
    assert [reading["peak"] for reading in tables["readings"]["rows"]] == [True] * 4

    done = labcdp("doctor", "--json", *port, "--stream-test", camera["serial"], "--report", "bug.zip")
    groups = checks_of(done)
    _, of_camera, of_meter = groups
    assert camera["serial"] in of_camera
    assert groups[of_camera]["controller"]["state"] == "good"
    assert groups[of_camera]["frames"]["cause"].startswith("5 of 5 frames came whole")
    assert groups[of_meter]["unit"]["state"] == "good"
    # The problem report holds description, features and bytes.
    name = f"camera-{camera['serial'].replace('-', '_')}"
    with ZipFile(tmp_path / "bug.zip") as archive:
        assert set(archive.namelist()) == {"doctor.json", f"{name}.json", f"{name}.xml", "meter.jsonl"}
        features = json.loads(archive.read(f"{name}.json"))
        description = ElementTree.fromstring(archive.read(f"{name}.xml"))
        sent = [json.loads(line).get("sent") for line in archive.read("meter.jsonl").splitlines()]
    assert (features["features"]["DeviceID"], features["not understood"]) == (camera["serial"], [])
    assert description.attrib["ModelName"] == "Manta_G-505B"
    assert "MES\r\n" in sent
    for again in (("snap", "first.tif"), ("doctor", "--report", "bug.zip")):
        assert labcdp(*again).returncode == 1


@pytest.fixture
def odd_camera(aravis):
    """A camera beside that of the bench, whose names are no UTF-8 and would colour the terminal."""
    device = SimulatedDevice("SIM-2", width=64, height=48)
    flat = SimpleNamespace(state=0, expose=lambda *_: np.full((48, 64), 100, np.uint16))
    with SimulatedGigECamera(device, flat, "127.0.0.2") as served:
        served._registers.write(Address.MODEL, int.from_bytes(b"\xff\x1b[3", "big"))
        served._registers.write(Address.MODEL + 4, int.from_bytes(b"1m\x07\0", "big"))
        yield served


def test_names_of_any_bytes_end_no_command_and_reach_no_terminal(labcdp, running_bench, odd_camera):
    serial_number = running_bench[1]["serial"]
    for command in (("devices",), ("doctor",), ("snap", "a.tif", "--camera", "SIM-2")):
        done = labcdp(*command)
        assert "Traceback" not in done.stderr
        assert re.search(r"\x1b\[31m|\x07", done.stdout + done.stderr) is None
        assert command[0] == "doctor" or done.returncode == 0, done.stderr
    models = {row["serial"]: row["model"] for row in rows_of(labcdp("devices", "--json"), "cameras")}
    assert models == {serial_number: "Manta_G-505B", "SIM-2": "\ufffd\\x1b[31m\\x07"}


def test_a_session_between_two_programs_and_what_is_typed_at_the_bench(labcdp, start, running_bench):
    """The bench in one process, the person's acquisition in another, with nothing but the protocols between."""
    bench, _, meter = running_bench

    def say(line):
        bench.stdin.write(line + "\n")
        bench.stdin.flush()
        return bench.stderr.readline().strip()

    plan = example_session() / "session.toml"
    acquisition, asked = start("acquire", plan, "two", "--meter", meter["address"], pipes=True), 0
    for line in acquisition.stderr:
        if "then press Enter" not in line:
            continue
        patch = re.search("patch (.*), then", line)
        act = "cover" if "Cover the lens" in line else "uncover" if "Uncover" in line else f"point {patch[1]}"
        assert "meter points at" in say(act)
        acquisition.stdin.write("\n")
        acquisition.stdin.flush()
        asked += 1
    assert acquisition.wait() == 0
    assert asked == 3 + len(SessionConfiguration.load(plan).target.patches)
    # What the simulated chain is made of, read with a meter that shows 0.6 % too much.
    true = Chain.load("manta-g505").camera().conversion(temperature_c=35.0).responsivity_dn_s_cd_m2
    rows = rows_of(labcdp("calibrate", "two", "--json"), "calibration")
    fitted = next(row["value"] for row in rows if row["quantity"] == "responsivity R")
    assert fitted == pytest.approx(true / 1.006, rel=0.002)

    for line, answer in (
        ("show P07", "Lens open; meter points at P07"),
        ("point nowhere", "there is no patch 'nowhere': choose one of P01"),
        ("dance", "Type: cover | uncover | point PATCH | status | quit"),
        ("light -10%", "Lens open; meter points at P07; light 90.0%, camera at 35.0 degrees"),
        ("temperature +5 C", "Lens open; meter points at P07; light 90.0%, camera at 40.0 degrees"),
        ("lose 5", "'lose 5' is not a known fault: write for example 'lose 5% for 20 s'"),
        ("meter ER30", "Lens open"),
    ):
        assert say(line).startswith(answer)
    with serial.Serial(meter["address"], 4800, bytesize=7, parity="E", stopbits=2, timeout=300) as port:
        port.write(b"MES\r\n")
        assert port.readline() == b"ER30\r\n"
    # Without a terminal the bench continues, until a signal.
    bench.stdin.close()
    assert labcdp("meter", "--meter", meter["address"], "-n", "3").returncode == 0
    assert bench.poll() is None
    bench.send_signal(signal.SIGTERM)
    assert bench.wait(300) == 0
