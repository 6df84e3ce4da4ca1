import json
import os
import re
import signal
import subprocess
import time
from importlib.metadata import version

import cv2
import pytest
import serial

from labcdp.chain import load
from labcdp.session import Session, SessionConfiguration, example_session

COMMANDS = (
    *("demo", "devices", "doctor", "snap", "meter", "meter-test"),
    *("acquire", "calibrate", "evaluate", "replay", "simulate-bench"),
)


def test_help_names_every_command(labcdp):
    text = labcdp("--help").stdout
    for command in COMMANDS:
        assert command in text
        assert labcdp(command, "--help").returncode == 0
    assert labcdp("--version").stdout == f"labcdp {version('labcdp')}\n"


def test_the_demonstration_runs_from_start_to_report_beside_an_earlier_one(labcdp, tmp_path):
    earlier = tmp_path / "labcdp-demo"
    earlier.mkdir()
    (earlier / "mine.txt").write_text("mine")
    done = labcdp("demo", "--json")
    assert done.returncode == 0, done.stderr
    assert [path.name for path in earlier.iterdir()] == ["mine.txt"]
    result = json.loads(done.stdout)
    assert result["output"] == "labcdp-demo-2"
    folder = tmp_path / "labcdp-demo-2"
    assert {path.name for path in folder.iterdir()} == {
        "session",
        "calibration.json",
        "calibration.html",
        "calibration.xlsx",
        "report.html",
        "results.xlsx",
        "results.json",
        "figures",
    }
    assert len(result["patches"]) == 16
    assert {"upper left", "upper right", "lower left", "lower right"} <= {p["patch"] for p in result["patches"]}
    # The meter's scale error is 0.6 %; what the fit adds must be small beside it.
    assert abs(result["largest_error_rel"] - result["meter_scale_rel"]) < 0.01
    assert result["simulated"] == ["camera Manta_G-505B", "luminance meter LS-110", "target"]
    with Session.open(folder / "session") as session:
        session.verify()
        assert len({r.exposure_s for r in session.frames("light")}) >= 3
        assert session.frames("dark")
    again = labcdp("replay", "labcdp-demo-2/session", "--against", "labcdp-demo-2/results.json")
    assert again.returncode == 0, again.stderr
    assert "Identical to labcdp-demo-2/results.json" in again.stderr


def test_the_shipped_session_replays_without_any_device(labcdp):
    done = labcdp("replay")
    assert done.returncode == 0, done.stderr
    for patch, measured in (("upper right", 76), ("upper left", 358), ("lower right", 34), ("lower left", 414)):
        row = next(line for line in done.stdout.splitlines() if patch in line and "/" not in line)
        assert float(re.findall(r"\d+\.?\d*", row)[0]) == pytest.approx(measured, rel=0.01)
    assert "Simulated: camera Manta_G-505B, luminance meter LS-110, target" in done.stderr


def test_numbers_are_whole_on_a_narrow_terminal(labcdp_path):
    wide = subprocess.run([labcdp_path, "replay"], capture_output=True, text=True).stdout
    for width in (60, 120):
        # Of a dumb terminal no width is believed.
        environment = os.environ | {"COLUMNS": str(width), "FORCE_COLOR": "1", "TERM": "xterm"}
        narrow = subprocess.run([labcdp_path, "replay"], env=environment, capture_output=True, text=True).stdout
        lines = re.sub(r"\x1b\[[0-9;]*m", "", narrow).splitlines()
        assert max(map(len, lines)) <= width
        for cdp in re.findall(r"\d\.\d+ \(\d\.\d+ to \d\.\d+\)", wide):
            assert any(cdp in line for line in lines)
        for cell in re.findall(r"(\d+\.\d+) │", wide):
            assert any(cell in line for line in lines)


def test_the_shipped_session_is_small():
    assert sum(path.stat().st_size for path in example_session().rglob("*")) < 5e6


def test_a_session_in_its_steps_on_the_simulated_bench(labcdp, tmp_path):
    assert labcdp("acquire", example_session() / "session.toml", "own").returncode == 1  # no port for the meter
    done = labcdp("acquire", example_session() / "session.toml", "own", "--simulated")
    # The bench simulates the whole sensor; the patches of the small target lie on it as well.
    assert done.returncode == 0, done.stderr
    assert "own: 12 frames and 32 readings recorded" in done.stderr
    assert labcdp("calibrate", "own").returncode == 0
    done = labcdp("evaluate", "own", "--contrast", "1000%", "--epsilon", "40%", "--json")
    assert done.returncode == 0, done.stderr
    for row in json.loads(done.stdout)["contrasts"]:
        assert row["interval"] == pytest.approx([6, 14])
    assert (tmp_path / "own-results" / "report.html").exists()


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
            if "Put the cap" in line:
                bench.stdin.write("cover\n")
            elif "Take the cap" in line:
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
    true = load("manta-g505").camera().conversion(temperature_c=35.0).responsivity_dn_s_cd_m2
    fitted = json.loads(done.stdout)["responsivity_dn_s_cd_m2"]
    assert fitted == pytest.approx(true / 1.006, rel=0.002)


def test_an_interrupted_acquisition_goes_on(labcdp, labcdp_path, tmp_path):
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
    assert "labcdp: stopped; what was recorded is safe, and the same command goes on with it" in said
    with Session.open(tmp_path / "own") as session:
        session.verify()
        recorded = len(session.frames())
    assert 2 <= recorded < 12
    done = labcdp(*command[1:])
    assert done.returncode == 0, done.stderr
    assert "own exists: going on with it" in done.stderr
    assert "own: 12 frames and 32 readings recorded" in done.stderr


def test_simulate_bench_obeys_and_ends(running_bench):
    bench, told = running_bench()
    assert told["camera"] == {"address": "127.0.0.1", "serial": "SIM-503363706", "model": "Manta_G-505B"}
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
    with serial.Serial(told["meter"]["port"], 4800, bytesize=7, parity="E", stopbits=2, timeout=2) as port:
        port.write(b"MES\r\n")
        assert port.readline().startswith(b"OK00,")
    bench.stdin.write("quit\n")
    bench.stdin.flush()
    assert bench.wait(10) == 0


def test_simulate_bench_goes_on_without_a_terminal_until_a_signal(running_bench):
    bench, _ = running_bench()
    bench.stdin.close()
    with pytest.raises(subprocess.TimeoutExpired):
        bench.wait(1.5)
    bench.send_signal(signal.SIGTERM)
    assert bench.wait(10) == 0
    bench.stdin = None


def test_devices_lists_camera_and_problem_free(labcdp, running_bench):
    running_bench()
    found = json.loads(labcdp("devices", "--json").stdout)
    assert [c["serial"] for c in found["cameras"]] == ["SIM-503363706"]
    assert found["problem"] is None


def test_snap_takes_a_frame_to_look_at(labcdp, running_bench, tmp_path):
    running_bench()
    done = labcdp("snap", "first.tif", "--exposure-s", "0.002", "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["exposure_s"] == 0.002
    pixels = cv2.imread(str(tmp_path / "first.tif"), cv2.IMREAD_UNCHANGED)
    assert pixels.shape == (2056, 2452)
    assert pixels.mean() == pytest.approx(told["mean_dn"])


def test_lines_typed_at_once_are_all_obeyed(running_bench):
    bench, _ = running_bench()
    bench.stdin.write("point P03\ncover\nstatus\nquit\n")
    bench.stdin.flush()
    assert bench.wait(10) == 0
    assert [line.strip() for line in bench.stderr] == [
        "Lens open; meter points at P03",
        "Lens covered; meter points at P03",
        "Lens covered; meter points at P03",
    ]


def test_devices_says_so_when_nothing_is_there(labcdp, aravis):
    assert "No camera answers" in labcdp("devices").stdout
