import json
import os
import re
import resource
import shutil
import signal
import subprocess
from importlib.metadata import version

import cv2
import numpy as np
import pytest

from labcdp.cli.app import unwinding
from labcdp.cli.commands import all_commands
from labcdp.cli.start import demonstrate
from labcdp.drivers.simulated import SimulatedBenchFile
from labcdp.output import ResultsFolder

from ..conftest import wait_until
from .conftest import SMALL_BENCH


def test_help_lists_all_commands_and_each_prints_json(labcdp):
    listed = labcdp("--help").stdout
    for name, command in all_commands().items():
        assert name in listed
        assert "--json" in {option for parameter in command.params for option in parameter.opts}, name
    assert labcdp("--version").stdout == f"labcdp {version('labcdp')}\n"


def test_the_demonstration_finds_what_was_simulated(small_configuration, tmp_path):
    with ResultsFolder(tmp_path / "small", "demo") as results:
        demonstrate(small_configuration, SimulatedBenchFile.load(SMALL_BENCH), results)
    result = json.loads((tmp_path / "small/results.json").read_text(encoding="utf-8"))
    assert {finding["severity"] for finding in result["findings"]} == {"info"}
    rows = result["tables"]["simulation"]["rows"]
    assert len(rows) == 16
    # The meter's scale error is 0.6 %; what the fit adds must be small beside it.
    assert all(abs(row["error_rel"] - 0.006) < 0.01 for row in rows)


def test_the_shipped_session_gives_the_same_again_with_whole_numbers_on_a_narrow_terminal(labcdp):
    done = labcdp("evaluate", "--recalibrate", "--output", "wide")
    assert done.returncode == 0, done.stderr
    assert "Simulated data, not a measurement" in done.stderr
    assert "warning:" not in done.stderr
    wide = done.stdout
    # Of a dumb terminal no width is believed.
    # Sums of several threads have another order.
    terminal = {"COLUMNS": "60", "FORCE_COLOR": "1", "TERM": "xterm", "OMP_NUM_THREADS": "2"}
    again = ("evaluate", "--recalibrate", "--output", "narrow", "--against", "wide/results.json")
    done = labcdp(*again, environment=terminal)
    out, err = (re.sub(r"\x1b\[[0-9;]*m", "", text) for text in (done.stdout, done.stderr))
    assert "Agrees with wide/results.json" in " ".join(err.split())
    assert max(map(len, out.splitlines())) <= 60
    for number in re.findall(r"\d\.\d+ \(\d\.\d+ to \d\.\d+\)|(?<= )\d+\.\d+(?= │)", wide):
        assert any(number in line for line in out.splitlines())


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_command_that_is_stopped_leaves_nothing_half_done(start, tmp_path, number, status):
    rng = np.random.default_rng(0)
    cv2.imwrite(str(tmp_path / "a.png"), rng.integers(0, 65536, (3000, 4000), dtype=np.uint16))
    for _ in range(10):
        process = start("image", "a.png", "--neighbours", "-o", "out/deep")
        wait_until(lambda: any(tmp_path.glob("out/deep/.labcdp-*")), "it writes")
        process.send_signal(number)
        if process.wait() != 0:
            break
        # On a busy computer it may be done before the signal is sent.
        shutil.rmtree(tmp_path / "out")
    assert process.returncode == status
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
    said = process.said().splitlines()
    assert said[-1] == "labcdp: stopped; the same command starts again from the beginning"
    assert "Traceback (most recent call last):" not in said


def test_signals_that_nohup_ignores_are_ignored_and_forked_processes_end():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with unwinding():
            os.kill(os.getpid(), signal.SIGHUP)
            child = os.fork()
            if child == 0:
                os.kill(os.getpid(), signal.SIGTERM)
                os._exit(0)
            assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGTERM
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def limited(*limits):
    """Set limits of resources in a child process."""
    return lambda: [resource.setrlimit(kind, (value, value)) for kind, value in limits]


@pytest.mark.parametrize(
    ("closed", "environment", "limits", "status"),
    [
        ("<&-", {}, (), 0),
        ("<&- >&- 2>&-", {}, (), 0),
        ("", {"MPLBACKEND": "nonsense"}, (), 0),
        ("", {"LC_ALL": "C", "PYTHONIOENCODING": "ascii"}, (), 0),
        ("", {}, ((resource.RLIMIT_AS, 300 * 2**20),), 1),
    ],
)
def test_a_command_runs_with_closed_streams_odd_settings_or_says_what_limits_it(
    labcdp_path, inputs, tmp_path, closed, environment, limits, status
):
    command = f'exec "$0" image {inputs}/a.png --roi {inputs}/rois.json -o out {closed}'
    done = subprocess.run(
        ["sh", "-c", command, labcdp_path], cwd=tmp_path, env=os.environ | environment, capture_output=True,
        text=True, check=False, preexec_fn=limited(*limits),
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    if status == 0:
        assert json.loads((tmp_path / "out/results.json").read_text())["kind"] == "image"
    else:
        assert done.stderr.splitlines()[-1].startswith("labcdp: ")
        assert "memory" in done.stderr
