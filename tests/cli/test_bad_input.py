"""What a tired person does: each gets one clear line, exit status 1, and costs nothing recorded."""

import os
import shutil
import subprocess

import pytest

from labcdp.session import example_configuration, example_session


@pytest.fixture
def own(tmp_path):
    """A copy of the example session."""
    shutil.copytree(example_session(), tmp_path / "own")
    return tmp_path / "own"


def configuration(tmp_path, change):
    path = tmp_path / "bench.toml"
    text = (example_session() / "session.toml").read_text()
    assert change[0] in text
    path.write_text(text.replace(*change, 1))
    return path


def test_camera_absent(fails, tmp_path, aravis):
    line = fails("acquire", example_session() / "session.toml", "new", "--meter", "/dev/null", "--camera", "DEV-1")
    assert "no camera 'DEV-1'" in line
    assert "check power, cable" in line


def test_meter_absent(fails, running_bench):
    running_bench()
    line = fails("acquire", example_session() / "session.toml", "new", "--meter", "/dev/ttyNONE")
    assert "/dev/ttyNONE" in line


def test_no_meter_port(fails):
    line = fails("acquire", example_session() / "session.toml", "new")
    assert "no serial port for the meter: give --meter, or meter.port" in line


def test_nobody_at_the_terminal_keeps_the_session(fails, running_bench, tmp_path):
    _, told = running_bench()
    line = fails("acquire", example_session() / "session.toml", "new", "--meter", told["meter"]["port"], stdin="")
    assert "nobody answers at the terminal" in line
    assert (tmp_path / "new" / "session.toml").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("gain_db", "gain"), ("plan.gain", "gain_db")),
        (("f_number = 2.6", "f_number = -2.6"), ("lens.f_number", "-2.6", "above 0")),
        (("[plan]", "[plan"), ("not valid TOML", "line")),
        (('model = "LS-110"', 'model = "LS-120"'), ("meter has model 'LS-120'", "LS-110")),
    ],
)
def test_configuration_mistakes(fails, tmp_path, change, words):
    line = fails("acquire", configuration(tmp_path, change), "new", "--simulated")
    assert "bench.toml" in line
    for word in words:
        assert word in line
    assert not (tmp_path / "new").exists()


def test_missing_configuration(fails):
    assert "none.toml: cannot be read" in fails("acquire", "none.toml", "new", "--simulated")


def test_a_region_outside_the_sensor(fails, tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(example_configuration().replace("[416, 218, 300, 300]", "[2400, 218, 300, 300]"))
    line = fails("acquire", path, "new", "--simulated")
    assert "patch 'P01' reaches x 2700, y 518, the simulated sensor has 2452 x 2056 pixels: move it inside" in line


def test_another_configuration_for_a_begun_session(fails, own, tmp_path):
    line = fails("acquire", configuration(tmp_path, ("f_number = 2.6", "f_number = 4.0")), own, "--simulated")
    assert "was begun with another configuration" in line


@pytest.mark.parametrize("command", ["calibrate", "evaluate", "replay"])
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
    assert frame.name in fails(command, own)


@pytest.mark.parametrize("command", ["characterise", "twin"])
def test_no_folder_is_left_without_results(fails, own, tmp_path, command):
    frame = next(iter(sorted((own / "frames").iterdir())))
    frame.unlink()
    assert frame.name in fails(command, own)
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == ["own"]


def test_a_journal_edited_by_hand(fails, own):
    journal = own / "journal.jsonl"
    journal.write_text(journal.read_text().replace('"role": "dark"', '"role": "light"', 1))
    assert "journal.jsonl" in fails("replay", own)


def test_not_a_session(fails, tmp_path):
    (tmp_path / "empty").mkdir()
    assert "empty is not a session" in fails("calibrate", "empty")
    assert "none" in fails("calibrate", "none")


def test_evaluate_before_calibrate(fails, own, tmp_path):
    assert "run 'labcdp calibrate" in fails("evaluate", own)
    assert not (tmp_path / "own-results").exists()


def test_a_calibration_that_is_none(fails, own, tmp_path):
    (tmp_path / "c.json").write_text("{}")
    assert "c.json" in fails("evaluate", own, "--calibration", "c.json")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--contrast", "10"), "--contrast is '10': give a number with a percent sign"),
        (("--contrast", "-5%"), "--contrast is -5%"),
        (("--epsilon", "0%"), "--epsilon is 0%"),
        (("--epsilon", "150%"), "--epsilon is 150%: give a value above 0%, up to 100%"),
        (("--pair", "P02:P01"), "--pair needs a contrast"),
        (("--contrast", "5%", "--pair", "P02"), "give BRIGHT:DARK"),
        (("--contrast", "5%", "--pair", "P02:P77"), "no patch 'P77'"),
        (("--without", "P77"), "no patch 'P77' to leave out"),
    ],
)
def test_options_of_evaluate(fails, labcdp, own, arguments, words):
    assert labcdp("calibrate", own).returncode == 0
    assert words in fails("evaluate", own, *arguments)


def test_too_few_patches(fails, own):
    names = [f"P{n:02d}" for n in range(1, 13)] + ["upper left", "upper right"]
    line = fails("calibrate", own, *(word for name in names for word in ("--without", name)))
    assert "2 of 2 patches are usable, a calibration needs at least 3" in line


def test_replay_against_other_results(fails, tmp_path):
    (tmp_path / "r.json").write_text('{"session": "another"}')
    assert "the replay differs from r.json in" in fails("replay", "--against", "r.json")
    assert "cannot be read as JSON" in fails("replay", "--against", "none.json")


def test_results_that_are_no_results(fails, tmp_path):
    (tmp_path / "l.json").write_text("[]")
    assert "l.json holds no results" in fails("replay", "--against", "l.json")


def test_camera_busy(fails, running_bench, aravis):
    from labcdp.drivers.aravis_camera import AravisCamera

    _, told = running_bench()
    with AravisCamera("127.0.0.1"):
        line = fails("acquire", example_session() / "session.toml", "new", "--meter", told["meter"]["port"])
    assert "SIM-503363706 at 127.0.0.1 is controlled by another program: close that program" in line


def test_a_region_outside_the_cameras_image(fails, running_bench, tmp_path):
    _, told = running_bench()
    path = tmp_path / "bench.toml"
    path.write_text(example_configuration().replace("[416, 218, 300, 300]", "[2400, 218, 300, 300]"))
    line = fails("acquire", path, "new", "--meter", told["meter"]["port"])
    assert (
        "region 'P01' spans x 2400 to 2700, y 218 to 518, but the image is 2452 x 2056 pixels: move it inside" in line
    )


def test_the_current_folder_is_no_new_session(fails):
    assert "the current folder cannot become a session" in fails(
        "acquire", example_session() / "session.toml", ".", "--simulated"
    )


def test_a_full_device_behind_the_output(labcdp_path):
    with open("/dev/full", "w") as full:
        done = subprocess.run([labcdp_path, "acquire", "--example"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stderr == "labcdp: the output cannot be written (No space left on device): make room where it goes\n"


def test_a_terminal_without_the_characters(labcdp_path):
    done = subprocess.run(
        [labcdp_path, "replay"], env=os.environ | {"PYTHONIOENCODING": "ascii"}, capture_output=True, text=True
    )
    assert done.returncode == 0
    assert "measured (cd/m?)" in done.stdout


def test_output_that_cannot_be_made(fails, own, tmp_path):
    (tmp_path / "file").write_text("x")
    assert "file/results cannot be made" in fails("calibrate", own, "--output", "file/results")
