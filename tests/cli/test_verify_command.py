"""labcdp verify and labcdp history, as a person runs them."""

import json
import re
from dataclasses import replace

import pytest

from labcdp.acquire import acquire
from labcdp.calibration import ColourCalibration, load, save
from labcdp.clock import SimulatedClock
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.evaluate import calibrate_session, observe_session
from labcdp.frame import PLANES
from labcdp.session import Session, SessionConfiguration, example_session

SIMULATED = ("--simulated", "--simulated-time")
OTHER_PATCHES = re.compile(r'\[\[target\.patch\]\]\nname = "(?!P01|P04|P07|P12|upper right|lower right)[^[]*\[[^\[]*')


def plan():
    text = re.sub(r"\[\[contrast\]\][^\[]*", "", (example_session() / "session.toml").read_text())
    text = re.sub(r"exposures_s = .*", "exposures_s = [0.002, 0.032]", text)
    return OTHER_PATCHES.sub("", text)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A session on the bench that --simulated opens."""
    configuration, clock = SessionConfiguration.from_toml(plan(), "plan"), SimulatedClock()
    path = tmp_path_factory.mktemp("recorded") / "session"
    bench = SimulatedBench(configuration, BenchDevices.standard(), clock=clock)
    with (
        Session.create(path, configuration, clock=clock) as session,
        bench,
        bench.in_process_camera() as camera,
        bench.in_process_meter() as meter,
    ):
        acquire(session, camera, meter, bench, clock=clock)
    return path


@pytest.fixture(scope="module")
def saved(recorded):
    """Its calibration."""
    path = recorded.with_name("calibration.json")
    with Session.open(recorded) as session:
        save(calibrate_session(observe_session(session)), path)
    return path


@pytest.fixture
def bench(tmp_path):
    """Write the configuration of the example, with lines replaced."""

    def write(*changes):
        text = plan()
        for old, new in changes:
            assert re.search(old, text), text
            text = re.sub(old, new, text, count=1)
        (tmp_path / "bench.toml").write_text(text)
        return "bench.toml"

    return write


def test_a_recorded_session(labcdp, saved, recorded):
    done = labcdp("verify", saved, recorded, "--output", "out")
    assert done.returncode == 0, done.stderr
    assert "is still valid" in done.stderr
    assert "Patches measured again" in done.stdout
    assert "Saved: out/verification.json" in done.stderr
    done = labcdp("verify", saved, recorded, "--output", "out", "--patch", "P01", "--patch", "P07", "--json")
    values = json.loads(done.stdout)
    assert values["verdict"] == "valid"
    assert [row["patch"] for row in values["patches"]] == ["P01", "P07"]
    assert values["same_meter"] is True


def test_measuring_again_on_the_same_bench(labcdp, saved, bench, tmp_path):
    done = labcdp("verify", saved, bench(), "own", *SIMULATED, "--json")
    assert done.returncode == 0, done.stderr
    assert "Measuring" in done.stderr
    values = json.loads(done.stdout)
    assert values["verdict"] == "valid"
    assert len(values["patches"]) == 3
    assert (tmp_path / "own-results" / "verification.json").exists()
    with Session.open(tmp_path / "own") as session:
        session.verify()
        assert len(session.frames("dark")) >= 2
    # What is complete is not measured again.
    again = labcdp("verify", saved, "bench.toml", "own", *SIMULATED, "--json")
    assert json.loads(again.stdout)["patches"] == values["patches"]


def test_a_lens_that_lets_less_light_through(labcdp, saved, bench):
    dirty = bench((r"(\[lens\][^\[]*f_number = 2.6)", r"\1\ntransmittance = 0.85"))
    done = labcdp("verify", saved, dirty, "own", *SIMULATED)
    assert done.returncode == 3, done.stderr
    assert "is no longer valid: the camera has drifted by -5.6 %" in done.stderr
    assert "calibrate again" in done.stderr


def test_a_camera_that_is_warmer(labcdp, saved, bench, tmp_path):
    (tmp_path / "faults.txt").write_text("temperature +40 C\n")
    done = labcdp("verify", saved, bench(), "own", *SIMULATED, "--faults", "faults.txt", "--json")
    assert done.returncode in (0, 3), done.stderr
    values = json.loads(done.stdout)
    assert values["verdict"] != "valid"
    left_out = next(text for text in values["findings"] if "patch 'P01' is not brighter than the dark" in text)
    assert "75.0 degC, the dark frames at 35.0 to 35.0 degC" in left_out


def test_history_of_calibrations_and_verifications(labcdp, saved, recorded, tmp_path):
    assert labcdp("verify", saved, recorded, "--output", "all/2026").returncode == 0
    (tmp_path / "all" / "calibration.json").write_bytes(saved.read_bytes())
    (tmp_path / "all" / "other.json").write_text("{}")
    done = labcdp("history", "all", "-o", "history.html")
    assert done.returncode == 0, done.stderr
    assert "verification: valid" in done.stdout
    assert "Written: history.html" in done.stderr
    text = (tmp_path / "history.html").read_text()
    assert "data:image/png;base64," in text
    assert "Simulated" in text
    done = labcdp("history", "all/calibration.json", "all/2026/verification.json", "--json", "-o", "history.png")
    (one,) = json.loads(done.stdout)["cameras"]
    assert sorted(point["kind"] for point in one["points"]) == ["calibration", "verification"]
    assert (tmp_path / "history.png").read_bytes().startswith(b"\x89PNG")
    assert labcdp("history", "all", "-o", "history.xlsx").returncode == 0


def test_a_picture_of_two_cameras(fails, saved, tmp_path):
    calibration = load(saved)
    lens = replace(calibration.lens, f_number=4.0)
    save(replace(calibration, lens=lens), tmp_path / "other.json")
    line = fails("history", saved, "other.json", "-o", "history.png")
    assert "a picture shows one camera and setting, these are 2" in line
    assert "f/2.6" in line
    assert "f/4" in line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("{saved}", "bench.toml", "own", "x", "--simulated"), "3 paths after the calibration are too many"),
        (("{saved}", "bench.toml"), "bench.toml is a file: give the folder of a session"),
        (("{saved}", "none"), "none is not a session"),
        (("bench.toml", "none"), "bench.toml is not valid JSON"),
        (("{saved}", "{session}", "--simulated"), "a recorded session needs no devices"),
        (("{saved}", "{session}", "--patch", "none"), "there is no patch 'none' to verify with: choose from P01"),
        (("{saved}", "bench.toml", "own", "--simulated", "--patch", "none"), "there is no patch 'none' to verify with"),
        (("{saved}", "bench.toml", "own"), "no serial port for the meter"),
    ],
)
def test_refusals_of_verify(fails, saved, recorded, bench, arguments, words):
    bench()
    given = [text.format(saved=saved, session=recorded) for text in arguments]
    assert words in fails("verify", *given)


def test_the_simulated_bench_has_no_colour_filters(fails, saved, bench, tmp_path):
    mono = load(saved)
    planes = tuple(replace(mono, state=replace(mono.state, plane=plane)) for plane in PLANES)
    nothing = ((0.0,) * 4,) * 4
    residuals, low_high = mono.residuals, mono.range_cd_m2
    save(
        ColourCalibration(planes, (0.25,) * 4, nothing, 0.0, 0.0, low_high, residuals, (), (), (), None, None, ()),
        tmp_path / "colour.json",
    )
    line = fails("verify", "colour.json", bench(), "own", *SIMULATED)
    assert "the camera of the simulated bench has no colour filters, the calibration's has: measure with that" in line
    assert not (tmp_path / "own").exists()


def test_another_lens_is_refused(fails, saved, bench):
    line = fails("verify", saved, bench((r"(\[lens\][^\[]*f_number =) 2.6", r"\1 4.0")), "own", *SIMULATED)
    assert "the calibration is for the lens" in line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("{saved}", "-o", "history.pdf"), "--output is history.pdf: give a file that ends in .html, .png or .xlsx"),
        (("none.json",), "none.json cannot be read"),
        (("empty",), "empty holds no calibration"),
    ],
)
def test_refusals_of_history(fails, saved, tmp_path, arguments, words):
    (tmp_path / "empty").mkdir()
    assert words in fails("history", *(text.format(saved=saved) for text in arguments))


def test_a_broken_file_of_a_history_is_named_and_the_rest_is_shown(labcdp, saved, tmp_path):
    (tmp_path / "all").mkdir()
    (tmp_path / "all" / "calibration.json").write_bytes(saved.read_bytes())
    (tmp_path / "all" / "calibration-2.json").write_bytes(saved.read_bytes()[:500])
    (tmp_path / "all" / "calibration-3.json").write_text(
        saved.read_text().replace("LED", "led", 1).replace("D65", "D66")
    )
    done = labcdp("history", "all", "--json")
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)["cameras"][0]["points"]) == 1
    assert "Left out: calibration all/calibration-2.json is not valid JSON" in done.stderr
    assert "Left out: calibration all/calibration-3.json was changed after it was written" in done.stderr


def test_the_calibration_s_own_session_verifies_nothing(labcdp, saved, recorded):
    done = labcdp("verify", saved, recorded, "--output", "own", "--json")
    texts = json.loads(done.stdout)["findings"]
    assert any("the calibration was made of this very session" in text for text in texts)
