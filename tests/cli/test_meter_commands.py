"""`labcdp meter` and `labcdp meter-test`."""

import json
import subprocess
import sys
from contextlib import contextmanager

import pytest

from labcdp.drivers.meter import MeterError
from labcdp.drivers.minolta_ls import MinoltaLS110
from labcdp.drivers.simulated.meter import Fault, MeterErrorModel, PtyMeter, SimulatedLS
from labcdp.drivers.wire_transcript import read_transcript


@contextmanager
def meter_port(luminance_cd_m2=83.02, **options):
    engine = SimulatedLS(lambda: luminance_cd_m2, errors=MeterErrorModel(repeatability_rel=0.002, seed=3), **options)
    with PtyMeter(engine, response_time_s=0) as port:
        yield port


def test_readings_are_listed_with_mean_and_scatter(labcdp):
    with meter_port() as port:
        done = labcdp("meter", "--port", port.port, "-n", "3")
    assert done.returncode == 0, done.stderr
    for words in ("mean", "scatter (standard deviation)", "random uncertainty of the mean (k = 1)", "1.15%"):
        assert words in done.stdout
    assert sum("cd/m2" in line and line.strip("│ ")[0].isdigit() for line in done.stdout.splitlines()) == 3


def test_readings_as_json(labcdp):
    with meter_port() as port:
        result = json.loads(labcdp("meter", "--port", port.port, "-n", "4", "--slow", "--peak", "--json").stdout)
    values = [reading["value"] for reading in result["readings"]]
    assert len(values) == 4
    assert result["mean_cd_m2"] == pytest.approx(sum(values) / 4)
    assert result["scatter_rel"] == pytest.approx(result["scatter_cd_m2"] / result["mean_cd_m2"])
    assert 0 < result["standard_uncertainty_random_cd_m2"] < 1
    assert all(reading["peak"] for reading in result["readings"])


def test_one_reading_has_no_scatter(labcdp):
    with meter_port() as port:
        assert "unknown from one reading" in labcdp("meter", "--port", port.port, "-n", "1").stdout
        assert json.loads(labcdp("meter", "--port", port.port, "-n", "1", "--json").stdout)["scatter_cd_m2"] is None


def test_foot_lamberts_are_noticed(labcdp):
    with meter_port(342.62591, unit="fL") as port:
        done = labcdp("meter", "--port", port.port, "-n", "1")
    assert "the meter is set to fL" in done.stderr
    assert "fL" in done.stdout


def test_mistakes_are_one_line(fails, tmp_path):
    assert "model is 'LS-150': give LS-110 or LS-100" in fails("meter", "--port", "/dev/null", "--model", "LS-150")
    assert "there is no such serial port" in fails("meter", "--port", "/dev/no-such-port")
    assert "no.jsonl cannot be read" in fails("meter-test", "no.jsonl", "test.py")
    (tmp_path / "bad.jsonl").write_text("{}\n")
    assert "bad.jsonl, line 1: it is not the header" in fails("meter-test", "bad.jsonl", "test.py")


@pytest.fixture
def recorded(tmp_path):
    """A transcript with readings and faults."""
    path = tmp_path / "night.jsonl"
    with meter_port() as port, MinoltaLS110(port.port, timeout_s=0.4, transcript=path) as meter:
        port.inject(Fault(), Fault(reply=b"ER10\r\n"), Fault(n_bytes=7), Fault(reply=b"\xff" * 30 + b'"""\r\n'))
        for _ in range(5):
            try:
                meter.measure()
            except MeterError:
                continue
    return path


def run_ruff(*arguments):
    return subprocess.run([sys.executable, "-m", "ruff", *map(str, arguments)], capture_output=True, text=True)


def test_a_transcript_becomes_a_test_that_passes_and_is_clean(labcdp, recorded, tmp_path, request):
    done = labcdp("meter-test", "night.jsonl", "test_night.py")
    assert done.returncode == 0, done.stderr
    assert "test_night.py: 6 calls of the driver, 3 of them end in an error as recorded" in done.stderr
    test = tmp_path / "test_night.py"
    settings = request.config.rootpath / "pyproject.toml"
    for arguments in (
        ("check", "--isolated", test),
        ("check", "--config", settings, test),
        ("format", "--check", "--config", settings, test),
    ):
        checked = run_ruff(*arguments)
        assert checked.returncode == 0, checked.stdout + checked.stderr
    recorded.unlink()
    done = run_pytest(test)
    assert done.returncode == 0, done.stdout


def test_tests_fail_when_the_driver_reads_or_sends_something_else(labcdp, recorded, tmp_path):
    assert labcdp("meter-test", "night.jsonl", "night.py").returncode == 0
    text = (tmp_path / "night.py").read_text()
    for name, old, new in (("reads", '"value": ', '"value": 1'), ("sends", '"sent": "MDS,06', '"sent": "MDS,07')):
        assert old in text
        (tmp_path / f"test_{name}.py").write_text(text.replace(old, new, 1))
    done = run_pytest(tmp_path)
    assert done.returncode == 1
    assert "2 failed" in done.stdout
    assert "WireMismatchError: command 3 is b'MDS,06\\r\\n', the transcript has b'MDS,07\\r\\n'" in done.stdout


def test_a_torn_transcript_is_used_as_far_as_it_goes(labcdp, recorded):
    text = recorded.read_text()
    recorded.write_text(text[:-4])
    n_whole = len(text.splitlines()) - 2
    assert len(read_transcript(recorded).entries) == n_whole
    done = labcdp("meter-test", "night.jsonl", "test_night.py")
    assert done.returncode == 0, done.stderr
    assert "was not written to its end and is left out" in done.stderr
    assert "6 calls of the driver, 4 of them end in an error" in done.stderr


def run_pytest(path):
    """Run test files as somebody else would, without this project's settings."""
    folder = path if path.is_dir() else path.parent
    arguments = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", folder, path]
    return subprocess.run(arguments, cwd=folder, capture_output=True, text=True, timeout=60)
