import json
import re
import signal
import subprocess
import time
from importlib.metadata import version
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import serial
import typer
from jsonschema import Draft202012Validator

from labcdp.chain import Chain
from labcdp.cli.app import app
from labcdp.drivers.simulated.gige.camera import SimulatedDevice, SimulatedGigECamera
from labcdp.drivers.simulated.gige.genicam import Address
from labcdp.report.envelope import schema
from labcdp.session import Session, SessionConfiguration, example_session

COMMANDS = (
    *(
        "demo",
        "init",
        "info",
        "doctor",
        "devices",
        "snap",
        "meter",
        "bench",
        "acquire",
        "import",
        "simulate-bench",
        "calibrate",
    ),
    *("evaluate", "luminance", "verify", "history", "characterise", "twin", "rois", "image", "image-map", "video"),
    *("presets", "simulate", "sweep", "reproduce"),
)


def test_help_names_every_command_and_each_has_json(labcdp):
    text = labcdp("--help").stdout
    commands = typer.main.get_command(app).commands
    assert set(commands) == set(COMMANDS)
    for name, command in commands.items():
        assert name in text
        assert "--json" in {option for parameter in command.params for option in parameter.opts}, name
    assert labcdp("--version").stdout == f"labcdp {version('labcdp')}\n"


def test_the_demonstration_runs_from_start_to_report(labcdp, tmp_path):
    done = labcdp("demo", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(result)
    assert result == json.loads((tmp_path / "labcdp-demo" / "results.json").read_text(encoding="utf-8"))
    assert {finding["severity"] for finding in result["findings"]} == {"info"}
    folder = tmp_path / "labcdp-demo"
    assert {path.name for path in folder.iterdir()} == {
        "labcdp-files.json",
        "session",
        "calibration.json",
        "calibration.html",
        "calibration.xlsx",
        "report.html",
        "results.xlsx",
        "results.json",
        "figures",
    }
    rows = result["tables"]["simulation"]["rows"]
    assert len(rows) == 16
    assert {"upper left", "upper right", "lower left", "lower right"} <= {row["patch"] for row in rows}
    # The meter's scale error is 0.6 %; what the fit adds must be small beside it.
    assert all(abs(row["error_rel"] - 0.006) < 0.01 for row in rows)
    assert (result["simulated"], result["seed"]) == (True, 0)
    with Session.open(folder / "session") as session:
        session.verify()
        assert len({r.exposure_s for r in session.frames("light")}) >= 3
        assert session.frames("dark")


def test_the_shipped_session_replays_without_any_device(labcdp):
    done = labcdp("evaluate", "--recalibrate")
    assert done.returncode == 0, done.stderr
    for patch, measured in (("upper right", 76), ("upper left", 358), ("lower right", 34), ("lower left", 414)):
        row = next(line for line in done.stdout.splitlines() if patch in line and "/" not in line)
        assert float(re.findall(r"\d+\.?\d*", row)[0]) == pytest.approx(measured, rel=0.01)
    assert "Simulated data, not a measurement" in done.stderr
    assert "warning:" not in done.stderr


def test_the_same_again_is_identical_with_whole_numbers_on_a_narrow_terminal(labcdp, tmp_path):
    wide = labcdp("evaluate", "--recalibrate", "--output", "wide").stdout
    # Of a dumb terminal no width is believed.
    terminal = {"COLUMNS": "60", "FORCE_COLOR": "1", "TERM": "xterm"}
    again = ("evaluate", "--recalibrate", "--output", "narrow", "--against", "wide/results.json")
    done = labcdp(*again, environment=terminal)
    assert done.returncode == 0, done.stderr
    assert "Identical to wide/results.json" in " ".join(re.sub(r"\x1b\[[0-9;]*m", "", done.stderr).split())
    lines = re.sub(r"\x1b\[[0-9;]*m", "", done.stdout).splitlines()
    assert max(map(len, lines)) <= 60
    for cdp in re.findall(r"\d\.\d+ \(\d\.\d+ to \d\.\d+\)", wide):
        assert any(cdp in line for line in lines)
    for cell in re.findall(r"(\d+\.\d+) │", wide):
        assert any(cell in line for line in lines)


def test_a_session_between_two_programs(labcdp, labcdp_path, running_bench, tmp_path):
    """The bench in one process, the person's acquisition in another, with nothing but the protocols between."""
    bench, told = running_bench()
    configuration = SessionConfiguration.load(example_session() / "session.toml")
    names = [patch.name for patch in configuration.target.patches]
    asked = []
    with subprocess.Popen(
        [labcdp_path, "acquire", example_session() / "session.toml", "two", "--meter", told["meter"]["port"]],
        cwd=tmp_path,
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as acquisition:
        for line in acquisition.stderr:
            if "then press Enter" not in line:
                continue
            asked.append(line.strip())
            if "Cover the lens" in line:
                bench.stdin.write("cover\n")
            elif "Uncover the lens" in line:
                bench.stdin.write("uncover\n")
            else:
                bench.stdin.write(f"point {re.search('patch (.*), then', line)[1]}\n")
            bench.stdin.flush()
            assert "meter points at" in bench.stderr.readline()
            acquisition.stdin.write("\n")
            acquisition.stdin.flush()
    assert acquisition.returncode == 0
    assert len(asked) == 2 + len(names) + 1
    done = labcdp("calibrate", "two", "--json")
    assert done.returncode == 0, done.stderr
    # What the simulated chain is made of, read with a meter that shows 0.6 % too much.
    true = Chain.load("manta-g505").camera().conversion(temperature_c=35.0).responsivity_dn_s_cd_m2
    rows = json.loads(done.stdout)["tables"]["calibration"]["rows"]
    fitted = next(row["value"] for row in rows if row["quantity"] == "responsivity R")
    assert fitted == pytest.approx(true / 1.006, rel=0.002)


def test_an_interrupted_acquisition_is_resumed(labcdp, labcdp_path, tmp_path):
    command = [labcdp_path, "acquire", example_session() / "session.toml", "own", "--simulated"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as acquisition:
        frames = tmp_path / "own" / "frames"
        # Once the third file is there, the journal has the first two.
        while not (frames.is_dir() and len(list(frames.glob("*.tif"))) >= 3):
            assert acquisition.poll() is None
            time.sleep(0.02)
        acquisition.send_signal(signal.SIGINT)
        said = acquisition.stderr.read()
    assert acquisition.returncode == 130
    assert "labcdp: stopped; recorded data are safe, and the same command resumes" in said
    with Session.open(tmp_path / "own") as session:
        session.verify()
        recorded = len(session.frames())
    assert 2 <= recorded < 12
    done = labcdp(*command[1:])
    assert done.returncode == 0, done.stderr
    assert "Resuming own" in done.stderr
    assert "own: 12 frames and 32 readings recorded" in done.stderr


def test_simulate_bench_runs_commands_and_ends(running_bench):
    bench, told = running_bench()
    assert (told["camera"]["address"], told["camera"]["serial"]) == ("127.0.0.1", "SIM-503363706")
    assert told["camera"]["model"].endswith("Manta_G-505B")
    for line, answer in (
        ("status", "Lens open; meter points at P01"),
        ("cover", "Lens covered; meter points at P01"),
        ("point lower left", "Lens covered; meter points at lower left"),
        ("point nowhere", "there is no patch 'nowhere': choose one of P01"),
        ("dance", "Type: cover | uncover | point PATCH | status | quit"),
    ):
        bench.stdin.write(line + "\n")
        bench.stdin.flush()
        assert bench.stderr.readline().strip().startswith(answer)
    with serial.Serial(told["meter"]["port"], 4800, bytesize=7, parity="E", stopbits=2, timeout=300) as port:
        port.write(b"MES\r\n")
        assert port.readline().startswith(b"OK00,")
    bench.stdin.write("quit\n")
    bench.stdin.flush()
    assert bench.wait(300) == 0


def test_simulate_bench_continues_without_a_terminal_until_a_signal(running_bench):
    bench, _ = running_bench()
    bench.stdin.close()
    with pytest.raises(subprocess.TimeoutExpired):
        bench.wait(1.5)
    bench.send_signal(signal.SIGTERM)
    assert bench.wait(300) == 0
    bench.stdin = None


def test_devices_lists_camera_and_problem_free(labcdp, running_bench):
    running_bench()
    found = json.loads(labcdp("devices", "--json").stdout)
    Draft202012Validator(schema()).validate(found)
    assert [row["serial"] for row in found["tables"]["cameras"]["rows"]] == ["SIM-503363706"]
    assert "cameras-unknown" not in {finding["code"] for finding in found["findings"]}


def test_snap_takes_a_frame_to_look_at(labcdp, running_bench, tmp_path):
    running_bench()
    done = labcdp("snap", "first.tif", "--exposure", "2ms", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(result)
    assert result["configuration"]["exposure_s"] == 0.002
    told = {row["quantity"]: row["value"] for row in result["tables"]["frame"]["rows"]}
    pixels = cv2.imread(str(tmp_path / "first.tif"), cv2.IMREAD_UNCHANGED)
    assert pixels.shape == (2056, 2452)
    assert pixels.mean() == pytest.approx(told["mean"])
    # Beside it what a viewer shows: sRGB (IEC 61966-2-1) of the share of saturation.
    seen = cv2.imread(str(tmp_path / "first.png"), cv2.IMREAD_UNCHANGED)
    assert (seen.dtype, seen.shape) == (np.uint8, pixels.shape)
    linear = np.where(seen <= 10, seen / 255 / 12.92, ((seen / 255 + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(linear, pixels / 4095, atol=0.005)
    again = labcdp("snap", "first.tif")
    assert again.returncode == 1
    assert "exists" in again.stderr


def test_devices_says_so_when_nothing_is_there(labcdp, aravis):
    assert "no camera was found" in labcdp("devices").stderr


@pytest.fixture
def odd_camera(aravis):
    """A camera beside that of the bench, whose names are no UTF-8 and would colour the terminal."""
    device = SimulatedDevice("SIM-2", width=64, height=48)
    flat = SimpleNamespace(state=0, expose=lambda *_: np.full((48, 64), 100, np.uint16))
    with SimulatedGigECamera(device, flat, "127.0.0.2") as served:
        served._registers.write(Address.MODEL, int.from_bytes(b"\xff\x1b[3", "big"))
        served._registers.write(Address.MODEL + 4, int.from_bytes(b"1m\x07\0", "big"))
        yield served


def test_names_of_any_bytes_end_no_command_and_reach_no_terminal(labcdp, running_bench, odd_camera, tmp_path):
    _, told = running_bench()
    snaps = [("snap", f"{serial}.tif", "--camera", serial) for serial in (told["camera"]["serial"], "SIM-2")]
    for command in (("devices",), ("doctor",), *snaps):
        done = labcdp(*command)
        assert "Traceback" not in done.stderr
        assert "\x1b[31m" not in done.stdout + done.stderr
        assert "\x07" not in done.stdout + done.stderr
        if command[0] != "doctor":
            assert done.returncode == 0, done.stderr
    rows = json.loads(labcdp("devices", "--json").stdout)["tables"]["cameras"]["rows"]
    assert {(row["serial"], row["model"]) for row in rows} == {
        (told["camera"]["serial"], "Manta_G-505B"),
        ("SIM-2", "\ufffd\\x1b[31m\\x07"),
    }
