"""What a tired person does: each gets one clear line, exit status 1, and costs nothing recorded."""

import os
import shutil
import subprocess
import sys

import pytest

from labcdp.session import example_configuration, example_session


@pytest.fixture
def own(tmp_path):
    """A copy of the example session."""
    shutil.copytree(example_session(), tmp_path / "own")
    return tmp_path / "own"


def test_camera_absent(fails, tmp_path, aravis):
    line = fails("acquire", example_session() / "session.toml", "new", "--meter", "/dev/null", "--camera", "DEV-1")
    assert "no camera 'DEV-1'" in line
    assert "check power, cable" in line


def test_no_meter_port(fails):
    line = fails("acquire", example_session() / "session.toml", "new")
    assert "no serial port for the meter: give --meter, or meter.port" in line


def test_no_answer_at_the_terminal_keeps_the_session(fails, running_bench, tmp_path):
    _, told = running_bench()
    line = fails("acquire", example_session() / "session.toml", "new", "--meter", told["meter"]["port"], stdin="")
    assert "no answer from the terminal" in line
    assert (tmp_path / "new" / "session.toml").exists()


def test_a_region_outside_the_sensor(fails, tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(example_configuration().replace("[416, 218, 300, 300]", "[2400, 218, 300, 300]"))
    line = fails("acquire", path, "new", "--simulated")
    assert "patch 'P01' reaches x 2700, y 518, the simulated sensor has 2452 x 2056 pixels: move it inside" in line


@pytest.mark.parametrize("command", ["calibrate", "evaluate", "evaluate --recalibrate"])
@pytest.mark.parametrize("what", ["missing", "truncated", "altered"])
def test_a_damaged_frame_is_named(fails, labcdp, own, command, what):
    if command == "evaluate":
        assert labcdp("calibrate", own).returncode == 0
    frame = next(iter(sorted((own / "frames").iterdir())))
    data = frame.read_bytes()
    if what == "missing":
        frame.unlink()
    else:
        frame.write_bytes(data[:1000] if what == "truncated" else data[:-1] + bytes([data[-1] ^ 1]))
    assert frame.name in fails(*command.split(), own)


@pytest.mark.parametrize("command", ["characterise", "twin"])
def test_no_folder_is_left_without_results(fails, own, tmp_path, command):
    frame = next(iter(sorted((own / "frames").iterdir())))
    frame.unlink()
    assert frame.name in fails(command, own)
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == ["own"]


def test_not_a_session(fails, tmp_path):
    (tmp_path / "empty").mkdir()
    assert "empty is not a session" in fails("calibrate", "empty")
    assert "none" in fails("calibrate", "none")


def test_evaluate_before_calibrate(fails, own, tmp_path):
    assert "run 'labcdp calibrate" in fails("evaluate", own)
    assert not (tmp_path / "own-evaluate").exists()


def test_a_calibration_that_is_none(fails, own, tmp_path):
    (tmp_path / "c.json").write_text("{}")
    assert "c.json" in fails("evaluate", own, "--calibration", "c.json")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--contrast", "10"), "--contrast is '10': give a percentage such as 1000%"),
        (("--contrast", "-5%"), "--contrast is '-5%': give contrasts above 0%"),
        (("--epsilon", "0%"), "--epsilon is '0%': give a percentage above 0%"),
        (("--epsilon", "150%"), "--epsilon is '150%': give a percentage above 0%, up to 100%"),
        (("--pair", "P02:P01"), "--pair needs a contrast"),
        (("--contrast", "5%", "--pair", "P02"), "give two names separated by a colon"),
        (("--contrast", "5%", "--pair", "P02:P77"), "there is no 'P77'"),
        (("--without", "P77"), "no patch 'P77' to leave out"),
    ],
)
def test_options_of_evaluate(fails, labcdp, own, arguments, words):
    assert labcdp("calibrate", own).returncode == 0
    assert words in fails("evaluate", own, *arguments)


def test_a_full_device_behind_the_output(labcdp_path):
    with open("/dev/full", "w") as full:
        done = subprocess.run([labcdp_path, "presets", "thesis-2018"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stderr == "labcdp: the output cannot be written (No space left on device): free some disk space\n"


def test_a_terminal_without_the_characters(labcdp_path, tmp_path):
    done = subprocess.run(
        [labcdp_path, "evaluate", "--recalibrate"],
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0
    assert "(cd/m?)" in done.stdout


def test_output_that_cannot_be_made(fails, own, tmp_path):
    (tmp_path / "file").write_text("x")
    assert "file/results lies in a file" in fails("calibrate", own, "--output", "file/results")


@pytest.mark.parametrize(
    "arguments", [["info", ""], ["image", "a.png", "--output", ""], ["image", "a.png", "--output="]]
)
def test_an_empty_argument_is_not_the_current_folder(fails, arguments):
    assert "is empty: give a value, or leave it out" in fails(*arguments)


def test_a_pipe_is_not_taken_for_a_preset(fails, tmp_path):
    os.mkfifo(tmp_path / "chain")
    assert "it is a pipe, not a file" in fails("simulate", "chain")


def test_digits_are_those_of_ascii(fails):
    line = fails("simulate", "manta-g505", "--contrast", "\u0665\u0660%")
    assert "give a number with a percent sign" in line


def test_an_error_of_the_system_is_not_one_of_the_output(labcdp_path, tmp_path):
    code = (
        "import errno, sys; from labcdp.cli import main; from labcdp.drivers.aravis import library;"
        "library.discover = lambda: (_ for _ in ()).throw(OSError(errno.ENETUNREACH, 'Network is unreachable'));"
        "sys.argv = ['labcdp', 'devices']; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 1
    line = "labcdp: the system refuses (Network is unreachable): check network, devices and limits, then repeat\n"
    assert done.stderr == line
