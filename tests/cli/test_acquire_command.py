"""labcdp acquire, as a person runs it."""

import json
import os
import pty
import re
import select
import shlex
import subprocess
import termios
import tomllib

import pytest

from labcdp.session import EventRecord, Session, example_configuration, example_session

from .conftest import SIMULATED, only_line, plan, results_of

#: A meter no driver knows.
ANOTHER = 'model = "Mavo"\nserial = "1"\nscale_half_width_rel = 0.03\nrepeatability_rel = 0.002\ndigits = 1'


@pytest.fixture
def bench(tmp_path):
    """Write a configuration with one patch and one exposure, and with a text replaced."""

    def write(old="", new="", meter=None):
        text = plan("P12", [0.002])
        if meter is not None:
            text = re.sub(r"\[meter\][^\[]*", f"[meter]\n{meter}\n\n", text)
        assert old in text
        (tmp_path / "bench.toml").write_text(text.replace(old, new, 1))
        return tmp_path / "bench.toml"

    return write


def luminances(path):
    with Session.open(path) as session:
        return [record.reading.luminance_cd_m2 for record in session.readings()]


def test_a_recorded_session_in_place_of_devices(labcdp, tmp_path):
    example = example_session()
    done = labcdp("acquire", example / "session.toml", "own", "--replay", example)
    assert done.returncode == 0, done.stderr
    with Session.open(tmp_path / "own") as new, Session.open(example) as old:
        same, recorded = ([one.load(r).metadata() for r in one.frames()] for one in (new, old))
        assert same == recorded
        assert [r.reading for r in new.readings()] == [r.reading for r in old.readings()]
    text = (example / "session.toml").read_text()
    (tmp_path / "once.toml").write_text(text.replace("readings_per_patch = 2", "readings_per_patch = 1"))
    line = only_line(labcdp("acquire", "once.toml", "other", "--replay", example))
    assert "[plan] of the configuration differs from the recording" in line


@pytest.mark.parametrize("clock", [(), ("--virtual-clock",)])
def test_the_template_of_a_plan_is_recorded_on_the_simulated_bench(labcdp, tmp_path, clock):
    """As README and docs say, whatever its [camera] asks for; of one patch and exposure, on a small sensor."""
    assert labcdp("init", "bench", "bench.toml").returncode == 0
    camera = tomllib.loads((tmp_path / "bench.toml").read_text())["camera"]
    table = "\n".join(f"{name} = {json.dumps(value)}" for name, value in camera.items() if name != "lens")
    text = re.sub(r"\[camera\][^\[]*", f"[camera]\n{table}\n\n", plan("P12", [0.002]), count=1)
    (tmp_path / "plan.toml").write_text(text)
    done = labcdp("acquire", "plan.toml", "own", *SIMULATED[:2], *clock)
    assert done.returncode == 0, done.stderr


def test_of_several_that_begin_a_session_at_once_one_gets_it(labcdp_path, tmp_path):
    """The others say so; none undoes what the one has recorded."""
    example = example_session()
    for attempt in range(3):
        command = [labcdp_path, "acquire", example / "session.toml", f"own{attempt}", "--replay", example]
        begun = [
            subprocess.Popen(command, cwd=tmp_path, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            for _ in range(3)
        ]
        done = [(one.communicate(timeout=300)[1], one.returncode) for one in begun]
        # One that begins when another is complete finds nothing left to do.
        assert 0 in {status for _, status in done}, done
        for text, status in done:
            assert status == 0 or f"own{attempt}" in text.splitlines()[-1], text
        with Session.open(tmp_path / f"own{attempt}") as new, Session.open(example) as old:
            assert [r.reading for r in new.readings()] == [r.reading for r in old.readings()]


def test_what_was_refused_is_corrected_in_its_folder_and_done_in_two_runs_in_spite_of_a_fault(labcdp, bench, tmp_path):
    wide = example_configuration().replace("[416, 218, 300, 300]", "[2400, 218, 300, 300]")
    (tmp_path / "wide.toml").write_text(wide)
    for file, options, named in (
        ("wide.toml", ("--simulated",), "reaches x 2700, y 518, the simulated sensor has 2452 x 2056 pixels"),
        (bench("[0.002]", "[1e-9]"), SIMULATED, "1e-09 s"),
    ):
        assert named in only_line(labcdp("acquire", file, "own", *options))
        assert not (tmp_path / "own").exists()
    (tmp_path / "faults.txt").write_text("vanish for 90 s\n")
    done = labcdp("acquire", bench(), "own", *SIMULATED, "--unattended", "--faults", "faults.txt")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("Remaining manual step, ") == 2
    done = labcdp("acquire", bench(), "own", *SIMULATED, "--json")
    tables = results_of(done)["tables"]
    assert [row["value"] for row in tables["recorded"]["rows"]] == [4, 2]
    assert tables["left"]["rows"] == []
    # Simulated time continues after that of the first run.
    with Session.open(tmp_path / "own") as session:
        times = [record.time for record in session.records]
        events = {one.kind: one.content for one in session.records if isinstance(one, EventRecord)}
    assert times == sorted(times)
    assert events["camera lost and back"]["duration_s"] > 60


def test_readings_from_a_file_or_typed_by_hand(labcdp, running_bench, bench, tmp_path):
    readings = [256.0, 256.1, 256.2, 256.3]
    (tmp_path / "readings.csv").write_text("\n".join(["patch,luminance_cd_m2", *(f"P12,{one}" for one in readings)]))
    file = bench(meter=f'entry = "csv"\nfile = "readings.csv"\n{ANOTHER}')
    # A file needs no hand to point it, so only the cap is left.
    done = labcdp("acquire", file, "file", "--unattended")
    assert done.stderr.count("Remaining manual step, ") == 1
    assert labcdp("acquire", file, "file", stdin="\n\n\n").returncode == 0
    assert luminances(tmp_path / "file") == readings[:2]
    # A patch that is measured again takes the next lines of the file.
    assert labcdp("acquire", file, "file", "--retake", "P12", stdin="\n\n\n").returncode == 0
    assert luminances(tmp_path / "file") == readings[2:]
    # Uncover, point, two readings that disagree: repeat; two of which the first has a typing error; cover, keep the
    # frames although the simulated lens is still uncovered, uncover.
    hand = bench(meter=f'entry = "by hand"\n{ANOTHER}')
    done = labcdp("acquire", hand, "hand", stdin="\n\n256\n280\ny\n\n25x\n256\n256,5\n\n\n\n")
    assert done.returncode == 0, done.stderr
    assert luminances(tmp_path / "hand") == [256.0, 256.5]
    # Nobody at the terminal, and a camera that is not there, cost nothing that is recorded.
    ls110 = ("--meter", running_bench[2]["address"])
    assert "no answer from the terminal" in only_line(labcdp("acquire", bench(), "nobody", *ls110, stdin=""))
    assert (tmp_path / "nobody" / "session.toml").exists()
    assert "no camera 'DEV-1'" in only_line(labcdp("acquire", bench(), "new", *ls110, "--camera", "DEV-1"))


def test_live_numbers_and_keys_on_a_terminal_which_is_left_as_it_was(labcdp_path, bench, tmp_path):
    keyboard, terminal = pty.openpty()
    before, shown = termios.tcgetattr(terminal), ""

    def wait_for(pattern):
        nonlocal shown
        while not (found := re.search(pattern, shown)):
            assert select.select([keyboard], [], [], 300)[0], shown
            shown += os.read(keyboard, 4096).decode(errors="replace")
            shown = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown)
        shown = shown[found.end() :]

    def own_terminal():
        import fcntl

        os.setsid()
        fcntl.ioctl(terminal, termios.TIOCSCTTY, 0)

    command = [labcdp_path, "acquire", bench("frames_per_exposure = 2", "frames_per_exposure = 500"), "own", *SIMULATED]
    environment = os.environ | {"COLUMNS": "150", "LINES": "40", "TERM": "xterm"}
    streams = {"stdin": terminal, "stderr": terminal, "cwd": tmp_path, "env": environment}
    try:
        with subprocess.Popen(command, preexec_fn=own_terminal, **streams) as process:
            wait_for(r"P12 +\d+\.\d +0\.00% +\d+\.\d\d +[+-]\d\.\d\d%")
            os.write(keyboard, b"p")
            wait_for("Pausing after this frame: p resumes, q ends")
            os.write(keyboard, b"xp")
            wait_for("Resumed")
            os.write(keyboard, b"q")
            wait_for("labcdp: stopped; recorded data are safe")
        assert process.returncode == 130
        assert termios.tcgetattr(terminal) == before
    finally:
        os.close(keyboard)
        os.close(terminal)
    with Session.open(tmp_path / "own") as session:
        session.verify()


def test_missing_and_damaged_frames_are_recorded_again_by_the_command_that_is_offered(labcdp, bench, tmp_path):
    assert labcdp("acquire", bench(), "my session", *SIMULATED).returncode == 0
    with Session.open(tmp_path / "my session", writable=True) as session:
        session.supersede(session.frames()[1:2], "to be taken again")
    *lost, _, damaged = sorted((tmp_path / "my session" / "frames").iterdir())
    for path in lost:
        path.unlink()
    damaged.write_bytes(damaged.read_bytes()[:-7] + b"garbage")
    offered = only_line(labcdp("calibrate", "my session")).partition("with the options of its devices: labcdp ")[2]
    assert offered == "acquire 'my session/session.toml' 'my session' --replace-damaged"
    done = labcdp(*shlex.split(offered), *SIMULATED)
    assert done.returncode == 0, done.stderr
    with Session.open(tmp_path / "my session") as session:
        session.verify()
        frames = session.frames()
        roles = [(frame.role, frame.number) for frame in frames]
        assert roles == [("dark", 3), ("light", 5), ("light", 6), ("dark", 7)]
        assert len({session.load(frame).dn.tobytes() for frame in frames}) == 4


#: A bench of one's own.
OWN = """
seed = 5
camera = { vendor = "Basler", model = "acA2440-20gm", serial = "40012345", naming = "sfnc" }
sensor = { width = 700, height = 400, black_level_dn = 32.0, k_dn_per_e = 0.3 }
meter = { scale_rel = 0.05, repeatability_rel = 0.0 }
"""


def test_a_rehearsal_on_a_bench_of_ones_own(labcdp, tmp_path):
    (tmp_path / "plan.toml").write_text(plan("P12", [0.002]).replace('model = "Manta_G-505B"\n', ""))
    (tmp_path / "own.toml").write_text(OWN)
    region = {"name": "P12", "kind": "polygon", "corners": [[600, 300], [640, 300], [640, 340], [600, 340]]}
    regions = {"format": "labcdp regions", "version": 1, "regions": [region]}
    (tmp_path / "regions.json").write_text(json.dumps(regions))
    command = ("acquire", "plan.toml", "own", "--simulated-bench", "own.toml", "--virtual-clock")
    done = labcdp(*command, "--rehearse", "--roi", "regions.json", stdin="\n" * 4)
    assert done.returncode == 0, done.stderr

    with Session.open(tmp_path / "own") as session:
        (devices,) = [r.content for r in session.records if isinstance(r, EventRecord) and r.kind == "devices"]
        camera = {"vendor": "Basler", "model": "acA2440-20gm", "serial": "40012345", "simulated": True}
        assert devices["camera"] == camera
        (patch,) = session.configuration.target.patches
        assert patch.region().bounds == (600, 300, 640, 340)
        shown = float(f"{1.05 * patch.nominal_luminance_cd_m2:.4g}")
        assert {r.reading.luminance_cd_m2 for r in session.readings()} == {shown}
        light, dark = (session.load(session.frames(role)[0]).dn for role in ("light", "dark"))
        assert abs(dark.mean() - 32) < 0.1
        # One operator did it all: the lens was open for one, and covered for the other.
        assert light.mean() > dark.mean() + 1

    again = ("acquire", "own/session.toml", "own", "--virtual-clock", "--retake", "P12", "--simulated")
    assert "another simulated bench" in only_line(labcdp(*again))


@pytest.mark.parametrize(
    ("entry", "typed"),
    [
        # The lens is opened, the meter pointed and its readings typed, the lens is covered and opened again.
        ('entry = "by hand"', "\n\n250\n250,5 cd/m2\n\n\n"),
        # Nothing but the lens.
        ('entry = "csv"\nfile = "readings.csv"', "\n\n\n"),
    ],
)
def test_a_meter_without_an_interface_is_rehearsed_with_the_questions_of_the_real_run(
    labcdp, bench, tmp_path, entry, typed
):
    bench('serial = "simulated"', "", meter=f"{ANOTHER}\n{entry}")
    done = labcdp("acquire", "bench.toml", "s", *SIMULATED, "--rehearse", stdin=typed)
    assert done.returncode == 0, done.stderr
    with Session.open(tmp_path / "s") as session:
        readings = [record.reading for record in session.readings()]
        (patch,) = session.configuration.target.patches
        assert session.configuration.lens.serial is None
    assert {(one.meter.model, one.meter.serial, one.meter.simulated) for one in readings} == {("Mavo", "1", True)}
    assert {(one.scale_half_width_rel, one.repeatability_rel) for one in readings} == {(0.03, 0.002)}
    asked = re.findall(r"The simulated meter shows (\S+) cd/m2", done.stderr)
    # Of a scale error of 0.6 % and a scatter of 0.2 %.
    shown = pytest.approx(1.006 * patch.nominal_luminance_cd_m2, rel=0.01)
    if "by hand" in entry:
        assert "Point the luminance meter" in done.stderr
        assert [one.luminance_cd_m2 for one in readings] == [250.0, 250.5]
        assert list(map(float, asked)) == [shown, shown]
    else:
        assert "Point the luminance meter" not in done.stderr
        assert [one.luminance_cd_m2 for one in readings] == [shown] * len(readings)
    # Without a person, the bench reads its display itself.
    assert labcdp("acquire", "bench.toml", "t", *SIMULATED, "--simulated").returncode == 0
    assert luminances(tmp_path / "t") == [shown, shown]
