"""labcdp acquire, as a person runs it."""

import json
import os
import pty
import re
import shlex
import signal
import subprocess
import termios
import time
from contextlib import suppress

import pytest
from jsonschema import Draft202012Validator

from labcdp.report.envelope import schema
from labcdp.session import EventRecord, Session, SessionConfiguration, example_session

SIMULATED = ("--simulated", "--virtual-clock")
#: A meter no driver knows.
ANOTHER = 'model = "Mavo"\nserial = "1"\nscale_half_width_rel = 0.03\nrepeatability_rel = 0.002\ndigits = 1'
ONE_PATCH = re.compile(r'\[\[target\.patch\]\]\nname = "(?!P12)[^[]*\[[^\[]*')


@pytest.fixture
def configuration(tmp_path):
    """Write the example's configuration with one patch and one exposure, and with lines replaced."""

    def write(*changes, meter=None, name="bench.toml"):
        text = (example_session() / "session.toml").read_text()
        text = re.sub(r"\[\[contrast\]\][^\[]*", "", text)
        text = ONE_PATCH.sub("", text)
        text = re.sub(r"exposures_s = .*", "exposures_s = [0.002]", text)
        if meter is not None:
            text = re.sub(r"\[meter\][^\[]*", f"[meter]\n{meter}\n\n", text)
        for old, new in changes:
            assert re.search(old, text), text
            text = re.sub(old, new, text, count=1)
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


def events(path, kind):
    with Session.open(path) as session:
        session.verify()
        return [r.content for r in session.records if isinstance(r, EventRecord) and r.kind == kind]


def test_exposures_are_searched_where_the_plan_has_none(labcdp, configuration, tmp_path):
    done = labcdp("acquire", configuration((r"exposures_s = .*\n", "")), "own", *SIMULATED)
    assert done.returncode == 0, done.stderr
    (found,) = events(tmp_path / "own", "exposures")
    (exposure_s,) = found["exposures_s"]
    assert f"Exposures found: {exposure_s:.3g} s" in done.stderr
    assert "own: 4 frames and 2 readings recorded" in done.stderr
    assert "Next: labcdp calibrate own" in done.stderr
    # Not on a terminal: a line for each exposure that is done.
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("light ")][:1]
    assert re.match(
        r"light [\d.e-]+ s, mean [\d.]+ \(P12\) to [\d.]+ DN \(P12\), saturated 0.00%, noise [\d.]+ DN", line
    )


def test_a_night_in_simulated_time_with_faults(labcdp, configuration, tmp_path):
    (tmp_path / "faults.txt").write_text("at 1 min vanish for 90 s\n")
    plan = configuration((r"frames_per_exposure = 2", "frames_per_exposure = 5\ninterval_s = 60.0"))
    done = labcdp("acquire", plan, "own", *SIMULATED, "--faults", "faults.txt", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["tables"]["left"]["rows"] == []
    (gap,) = events(tmp_path / "own", "camera lost and back")
    assert gap["duration_s"] > 60
    assert "the camera was lost for" in done.stderr


def test_a_recorded_session_in_place_of_devices(labcdp, tmp_path):
    example = example_session()
    done = labcdp("acquire", example / "session.toml", "own", "--replay", example)
    assert done.returncode == 0, done.stderr
    with Session.open(tmp_path / "own") as new, Session.open(example) as old:
        assert [r.metadata for r in new.frames()] == [r.metadata for r in old.frames()]
        assert [r.reading for r in new.readings()] == [r.reading for r in old.readings()]


def test_a_recording_is_not_mistaken_for_something_else(labcdp, fails, tmp_path):
    example = example_session()
    assert labcdp("acquire", example / "session.toml", "own", "--replay", example).returncode == 0
    text = (example / "session.toml").read_text()
    (tmp_path / "other.toml").write_text(text.replace("readings_per_patch = 2", "readings_per_patch = 1"))
    line = fails("acquire", "other.toml", "new", "--replay", example)
    assert "[plan] of the configuration differs from the recording" in line
    assert "use the session.toml of the recording" in line
    (tmp_path / "bench.toml").write_text(text)
    wanted = SessionConfiguration.load(tmp_path / "bench.toml")
    with Session.create(tmp_path / "begun", wanted) as begun, Session.open(example) as old:
        begun.add_reading(old.readings()[0].reading, old.readings()[0].patch)
    line = fails("acquire", "bench.toml", "begun", "--replay", example)
    assert "begun already has frames or readings" in line
    with Session.open(tmp_path / "begun") as session:
        assert len(session.readings()) == 1


def test_a_plan_that_was_refused_can_be_corrected_in_its_folder(labcdp, fails, configuration, tmp_path):
    wrong = configuration((r"exposures_s = .*", "exposures_s = [1e-9]"))
    assert "1e-09 s" in fails("acquire", wrong, "own", *SIMULATED)
    done = labcdp("acquire", configuration(), "own", *SIMULATED)
    assert done.returncode == 0, done.stderr
    assert "own: 4 frames and 2 readings recorded" in done.stderr


def test_missing_and_damaged_frames_are_recorded_again_by_the_command_that_is_offered(
    labcdp, fails, configuration, tmp_path
):
    assert labcdp("acquire", configuration(), "my session", *SIMULATED).returncode == 0
    lost, damaged = (tmp_path / "my session" / "frames" / name for name in ("0001_light_2ms.tif", "0004_dark_2ms.tif"))
    lost.unlink()
    damaged.write_bytes(damaged.read_bytes()[:-7] + b"garbage")
    line = fails("calibrate", "my session")
    offered = line.partition("record it again: labcdp ")[2]
    assert offered == "acquire 'my session/session.toml' 'my session' --replace-damaged"
    done = labcdp(*shlex.split(offered), *SIMULATED)
    assert done.returncode == 0, done.stderr
    assert "Recording 2 missing or damaged frames again" in done.stderr
    with Session.open(tmp_path / "my session") as session:
        session.verify()
        assert [(frame.role, frame.number) for frame in session.frames()] == [
            *[("light", 2), ("dark", 3), ("light", 5), ("dark", 6)]
        ]
        assert len({session.load(frame).dn.tobytes() for frame in session.frames()}) == 4
    assert "No frame is missing or damaged" in labcdp(*shlex.split(offered), *SIMULATED).stderr


def test_modes_of_the_configuration_are_set_at_the_meter(labcdp, configuration, tmp_path):
    meter = 'model = "LS-110"\nserial = "1"\nresponse = "slow"\nrtscts = true\ncorrection = "colour"'
    done = labcdp("acquire", configuration(meter=meter), "own", "--simulated", "--transcript", "wire.jsonl")
    assert done.returncode == 0, done.stderr
    header, *wire = [json.loads(line) for line in (tmp_path / "wire.jsonl").read_text().splitlines()]
    assert header["rtscts"]
    # VARI CCF, ABS, SLOW and CONT of the manual.
    sent = [line["sent"] for line in wire if line.get("sent", "").startswith("MDS")]
    assert sent == [f"MDS,{mode}\r\n" for mode in ("01", "04", "07", "09")]


def test_live_numbers_stand_below_the_bars_of_a_terminal(labcdp_path, configuration, tmp_path):
    screen, terminal = pty.openpty()
    shown = b""
    try:
        with subprocess.Popen(
            [labcdp_path, "acquire", configuration(), "own", *SIMULATED],
            cwd=tmp_path,
            stderr=terminal,
            env=os.environ | {"COLUMNS": "150", "LINES": "40", "TERM": "xterm"},
        ) as process:
            os.close(terminal)
            # Reading fails once the other side is closed.
            with suppress(OSError):
                while received := os.read(screen, 4096):
                    shown += received
        assert process.returncode == 0
    finally:
        os.close(screen)
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode())
    assert re.search(r"patch +mean DN +saturated +noise DN +drift", text)
    assert re.search(r"P12 +\d+\.\d +0\.00% +\d+\.\d\d +[+-]\d\.\d\d%", text)
    assert re.search(r"dark 0\.002 s, mean \d+\.\d", text)


def test_unattended_tells_what_is_left(labcdp, configuration, tmp_path):
    bench = configuration()
    done = labcdp("acquire", bench, "own", *SIMULATED, "--unattended")
    assert done.returncode == 0, done.stderr
    assert "own: 2 frames and 0 readings recorded" in done.stderr
    assert "Remaining manual step, point the luminance meter at each patch: readings of P12" in done.stderr
    assert "Remaining manual step, cover the lens: dark frames" in done.stderr
    assert "Resume with the same command without --unattended" in done.stderr
    done = labcdp("acquire", bench, "own", *SIMULATED, "--json")
    result = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(result)
    assert [row["value"] for row in result["tables"]["recorded"]["rows"]] == [4, 2]
    assert result["tables"]["left"]["rows"] == []
    # Simulated time goes on after that of the first run.
    with Session.open(tmp_path / "own") as session:
        times = [record.time for record in session.records]
    assert times == sorted(times)
    assert "Resuming own" in done.stderr


def test_readings_typed_by_hand(labcdp, running_bench, configuration, tmp_path):
    running_bench()
    meter = f'entry = "by hand"\n{ANOTHER}'
    # Uncover, point, two readings that do not go together: again; two of which the first has a slip, cover, be told
    # that nobody has covered the simulated lens, uncover.
    done = labcdp("acquire", configuration(meter=meter), "own", stdin="\n\n256\n280\ny\n\n25x\n256\n256,5\n\n\n\n")
    assert done.returncode == 0, done.stderr
    assert "Luminance shown by Mavo" in done.stderr
    assert "Warning: the 2 readings of patch 'P12' scatter by 6.3%" in done.stderr
    assert "patch 'P12' is 100% as bright as in the light frames: cover the lens" in done.stderr
    assert "Fix it and repeat the readings of P12? [y/N]" in done.stderr
    with Session.open(tmp_path / "own") as session:
        assert [r.reading.luminance_cd_m2 for r in session.readings()] == [256.0, 256.5]
        assert {r.reading.meter.model for r in session.readings()} == {"Mavo"}


def test_readings_from_a_file_continue_where_they_were(labcdp, running_bench, configuration, tmp_path):
    running_bench()
    (tmp_path / "readings.csv").write_text("patch,luminance_cd_m2\nP12,256.0\nP12,256.1\n")
    bench = configuration(meter=f'entry = "csv"\nfile = "readings.csv"\n{ANOTHER}')
    # A file needs no hand to point it, so only the cap is left.
    done = labcdp("acquire", bench, "own", "--unattended")
    assert done.returncode == 0, done.stderr
    assert "own: 2 frames and 2 readings recorded" in done.stderr
    assert "Remaining manual step, cover the lens: dark frames" in done.stderr
    done = labcdp("acquire", bench, "own", stdin="\n\n\n")
    assert done.returncode == 0, done.stderr
    with Session.open(tmp_path / "own") as session:
        assert [r.reading.luminance_cd_m2 for r in session.readings()] == [256.0, 256.1]


def long_acquisition(labcdp_path, configuration, tmp_path, **options):
    plan = configuration((r"frames_per_exposure = 2", "frames_per_exposure = 500"))
    return subprocess.Popen(
        [labcdp_path, "acquire", plan, "own", *SIMULATED], cwd=tmp_path, stderr=subprocess.PIPE, text=True, **options
    )


def wait_for_frames(process, tmp_path, n=2):
    frames = tmp_path / "own" / "frames"
    until = time.monotonic() + 300
    while not (frames.is_dir() and len(list(frames.glob("*.tif"))) >= n):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < until
        time.sleep(0.02)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGHUP, 129)])
def test_a_signal_ends_it_with_all_that_was_taken(labcdp_path, configuration, tmp_path, number, status):
    with long_acquisition(labcdp_path, configuration, tmp_path) as process:
        wait_for_frames(process, tmp_path)
        process.send_signal(number)
        said = process.stderr.read()
    assert process.returncode == status
    assert said.count("labcdp: stopped; recorded data are safe, and the same command resumes") == 1
    assert "Traceback" not in said
    with Session.open(tmp_path / "own") as session:
        session.verify()
        assert session.unrecorded() == []
        assert len(session.frames()) >= 2


def test_keys_pause_and_end_it_and_the_terminal_is_left_as_it_was(labcdp_path, configuration, tmp_path):
    keyboard, terminal = pty.openpty()
    try:
        before = termios.tcgetattr(terminal)
        with long_acquisition(
            labcdp_path, configuration, tmp_path, stdin=terminal, preexec_fn=lambda: _own_terminal(terminal)
        ) as process:
            told = iter(process.stderr)
            assert any("Keys: p pauses or resumes, q ends" in line for line in told)
            wait_for_frames(process, tmp_path)
            os.write(keyboard, b"p")
            assert any("Pausing after this frame: p resumes, q ends" in line for line in told)
            os.write(keyboard, b"x")
            os.write(keyboard, b"p")
            assert any("Resumed" in line for line in told)
            os.write(keyboard, b"q")
            said = "".join(told)
        assert process.returncode == 130
        assert "Ending after this frame" in said
        assert "labcdp: stopped; recorded data are safe" in said
        assert termios.tcgetattr(terminal) == before
    finally:
        os.close(keyboard)
        os.close(terminal)
    with Session.open(tmp_path / "own") as session:
        session.verify()


def _own_terminal(terminal):
    import fcntl

    os.setsid()
    fcntl.ioctl(terminal, termios.TIOCSCTTY, 0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--virtual-clock",), "--virtual-clock requires --simulated: give both or neither"),
        (("--faults", "f.txt"), "--faults requires --simulated"),
        (("--speed", "2"), "--speed requires --replay"),
        (("--simulated", "--replay", "x"), "--simulated cannot be combined with --replay: leave one out"),
        (("--simulated", "--meter", "/dev/ttyS0"), "--meter cannot be combined with --simulated"),
        (("--replay", "x", "--camera", "DEV-1"), "--camera cannot be combined with --replay"),
        ((*SIMULATED, "--transcript", "t.txt"), "--transcript cannot be combined with --virtual-clock"),
        (("--simulated", "--lens", "off"), "--lens is 'off': give 'uncovered' or 'covered'"),
        (("--simulated", "--lens", "covered"), "--lens requires --unattended"),
        ((), "no serial port for the meter: give --meter, or meter.port"),
    ],
)
def test_options_that_do_not_go_together(fails, configuration, tmp_path, options, words):
    assert words in fails("acquire", configuration(), "own", *options)
    assert not (tmp_path / "own").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((*SIMULATED, "--faults", "none.txt"), "none.txt cannot be read"),
        (("--replay", "none"), "none is not a session"),
    ],
)
def test_files_that_cannot_be_read(fails, configuration, options, words):
    assert words in fails("acquire", configuration(), "own", *options)
