"""The simulated bench as a process of its own, and the commands that find, check and read its devices."""

import json
import re
import signal
from types import SimpleNamespace
from zipfile import ZipFile

import cv2
import numpy as np
import pytest
import tifffile

from labcdp.chain import Chain
from labcdp.drivers.simulated.bench import SimulatedBench, SimulatedDevices
from labcdp.drivers.simulated.control import free_loopback_address
from labcdp.drivers.simulated.genicam import RegisterAddress
from labcdp.drivers.simulated.gige_camera import SimulatedDevice, SimulatedGigECamera
from labcdp.session import EventRecord, Session, SessionConfiguration, example_configuration, example_session

from .conftest import SMALL_BENCH, plan, results_of, rows_of


def checks_of(done):
    """Rows of `labcdp doctor --json` by group and topic, whose exit status fits them."""
    groups, rows = {}, results_of(done, status=done.returncode)["tables"]["checks"]["rows"]
    for row in rows:
        groups.setdefault(row["group"], {})[row["topic"]] = row
    assert done.returncode == ("fault" in [row["state"] for row in rows])
    return groups


def test_devices_that_are_not_there_are_faults_with_remedies(labcdp, aravis):
    groups = checks_of(labcdp("doctor", "--json"))
    assert groups["Cameras"]["discovery"]["state"] == "notice"
    asked = ("--camera", "NONE-1", "--meter", "/dev/ttyNONE", "--meter-model", "LS-100")
    groups = checks_of(labcdp("doctor", "--json", *asked))
    assert groups["Cameras"]["discovery"]["state"] == "fault"
    row = groups["Luminance meter on /dev/ttyNONE"]["serial port /dev/ttyNONE"]
    assert (row["state"], row["cause"]) == ("fault", "there is no /dev/ttyNONE")
    # A person reads the same, also where the terminal does not have the marks.
    done = labcdp("doctor", *asked, environment={"PYTHONIOENCODING": "ascii"})
    assert "XX serial port /dev/ttyNONE: there is no /dev/ttyNONE" in done.stdout
    assert row["remedy"] in done.stdout


def test_devices_are_found_checked_and_read(labcdp, running_bench, tmp_path):
    _, camera, meter = running_bench
    found = results_of(labcdp("devices", "--json"))
    assert [row["serial"] for row in found["tables"]["cameras"]["rows"]] == [camera["serial"]]

    snapped = results_of(labcdp("snap", "first.tif", "--exposure", "2ms", "--json"))
    quantities = {row["quantity"]: row["value"] for row in snapped["tables"]["frame"]["rows"]}
    pixels = cv2.imread(str(tmp_path / "first.tif"), cv2.IMREAD_UNCHANGED)
    assert pixels.shape == (400, 480)
    assert pixels.mean() == pytest.approx(quantities["mean"])
    # Beside it what a viewer shows: sRGB (IEC 61966-2-1) of the share of saturation.
    seen = cv2.imread(str(tmp_path / "first.png"), cv2.IMREAD_UNCHANGED)
    assert (seen.dtype, seen.shape) == (np.uint8, pixels.shape)
    linear = np.where(seen <= 10, seen / 255 / 12.92, ((seen / 255 + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(linear, pixels / 4095, atol=0.005)

    # A snapshot has the camera's features beside its metadata, and reads like any other frame.
    with tifffile.TiffFile(tmp_path / "first.tif") as tiff:
        noted = json.loads(tiff.pages.first.description)
    assert noted["features"]["DeviceID"] == camera["serial"]
    port = ("--meter", meter["address"])
    tables = results_of(labcdp("meter", *port, "-n", "4", "--json"))["tables"]
    mean = next(row for row in tables["series"]["rows"] if row["quantity"] == "mean")
    assert mean["value"] == pytest.approx(np.mean([reading["value"] for reading in tables["readings"]["rows"]]))

    # At its address it is found also where no broadcast reaches it, as snap finds it.
    (tmp_path / "fast.toml").write_text(
        example_configuration().replace("frame_rate_hz = 11.0", "frame_rate_hz = 500.0")
    )
    done = labcdp("doctor", "--json", "--camera", camera["address"], "--plan", "fast.toml")
    (of_plan,) = [row for row in rows_of(done, "checks") if row["topic"] == "plan"]
    assert (of_plan["state"], "frame_rate_hz = " in of_plan["remedy"]) == ("notice", True)

    done = labcdp("doctor", "--json", *port, "--stream-test", camera["serial"], "--report", "bug.zip")
    groups = checks_of(done)
    _, of_camera, of_meter = groups
    assert groups[of_camera]["frames"]["cause"].startswith("5 of 5 frames ")
    assert groups[of_meter]["unit"]["state"] == "good"
    # The problem report holds description, features and bytes.
    with ZipFile(tmp_path / "bug.zip") as archive:
        name = f"camera-{camera['serial'].replace('-', '_')}"
        assert set(archive.namelist()) == {"doctor.json", f"{name}.json", f"{name}.xml", "meter.jsonl"}
        assert json.loads(archive.read(f"{name}.json"))["features"]["DeviceID"] == camera["serial"]
        assert b"MES\\r\\n" in archive.read("meter.jsonl")
    for again in (("snap", "first.tif"), ("doctor", "--report", "bug.zip")):
        assert labcdp(*again).returncode == 1


@pytest.fixture
def odd_camera(aravis):
    """A camera beside that of the bench, whose names are no UTF-8 and would colour the terminal."""
    device = SimulatedDevice("SIM-2", width=64, height=48)
    flat = SimpleNamespace(state=0, next_key=lambda: (0,), expose=lambda *_: np.full((48, 64), 100, np.uint16))
    with SimulatedGigECamera(device, flat, "127.0.0.2") as served:
        served._registers.write(RegisterAddress.MODEL, int.from_bytes(b"\xff\x1b[3", "big"))
        served._registers.write(RegisterAddress.MODEL + 4, int.from_bytes(b"1m\x07\0", "big"))
        yield served


def say(line, bench):
    """Type a line at a running bench; returns what it answers."""
    print(line, file=bench.stdin, flush=True)
    return bench.stderr.readline().strip()


def test_snap_takes_a_frame_again_that_does_not_come_whole(start, running_bench):
    configuration = SessionConfiguration.from_toml(example_configuration(), "the demonstration's configuration")
    address = free_loopback_address()
    with (
        SimulatedBench(configuration, SimulatedDevices.standard(seed=5)) as bench,
        bench.gige_camera(address),
    ):
        bench.run_command("lose 50%")
        snap = start("snap", "again.tif", "--exposure", "500ms", "--camera", address, pipes=True)
        assert "is incomplete" in next(line for line in snap.stderr if line.endswith("taking it again\n"))
        bench.run_command("recover")
        assert snap.wait() == 0


def test_a_second_bench_has_a_camera_of_its_own(labcdp, start, running_bench, tmp_path):
    target = example_session() / "session.toml"
    other = start("simulate-bench", target, "--simulated-bench", SMALL_BENCH, pipes=True)
    assert "127.0.0.2" in next(line for line in other.stdout if "camera" in line)
    found = rows_of(labcdp("devices", "--json"), "cameras")
    assert len({row["serial"] for row in found}) == len({row["address"] for row in found}) == 2
    print("quit", file=other.stdin, flush=True)
    assert other.wait() == 0
    # Also that of an acquisition, which is resumed with it although the other address is not used.
    (tmp_path / "plan.toml").write_text(plan("P12", [0.002]))
    for more in ((), ("--virtual-clock", "--retake", "P12")):
        done = labcdp("acquire", "plan.toml", "own", "--simulated-bench", SMALL_BENCH, *more)
        assert done.returncode == 0, done.stderr
    events = [r for r in Session.open(tmp_path / "own").records if isinstance(r, EventRecord)]
    (own,) = {event.content["camera"]["serial"] for event in events if event.kind == "devices"}
    assert own in {row["serial"] for row in found} - {running_bench[1]["serial"]}


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
    plan = example_session() / "session.toml"
    acquisition, asked = start("acquire", plan, "two", "--meter", meter["address"], pipes=True), 0
    is_marked = False
    for line in acquisition.stderr:
        is_marked |= line == "Simulated data, not a measurement\n"
        if "then press Enter" not in line:
            continue
        patch = re.search("patch (.*), then", line)
        act = "cover" if "Cover the lens" in line else "uncover" if "Uncover" in line else f"point {patch[1]}"
        assert "meter points at" in say(act, bench)
        acquisition.stdin.write("\n")
        acquisition.stdin.flush()
        asked += 1
    assert is_marked
    assert acquisition.wait() == 0
    assert asked == 3 + len(SessionConfiguration.load(plan).target.patches)
    # What the simulated chain is made of, read with a meter that shows 0.6 % too much.
    true = Chain.load("manta-g505").camera().responsivity_dn_s_cd_m2()
    rows = rows_of(labcdp("calibrate", "two", "--json"), "calibration")
    fitted = next(row["value"] for row in rows if row["quantity"] == "responsivity R")
    assert fitted == pytest.approx(true / 1.006, rel=0.002)

    assert say("lose 5%", bench).startswith("Type: cover | uncover")
    # Without a terminal the bench continues, until a signal.
    bench.stdin.close()
    assert labcdp("meter", "--meter", meter["address"], "-n", "3").returncode == 0
    assert bench.poll() is None
    bench.send_signal(signal.SIGTERM)
    assert bench.wait(300) == 0
