import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

_PROGRESS = re.compile(r"\d+/\d+ +\d:\d\d:\d\d|then press Enter|^Resuming |^labcdp: simulated")
_LABCDP = Path(sys.executable).with_name("labcdp")


@pytest.fixture
def labcdp_path():
    """The command's file."""
    return _LABCDP


@pytest.fixture
def fails(labcdp):
    """Run the command, which must fail with one line; returns the line."""

    def run(*arguments, stdin=None):
        done = labcdp(*arguments, stdin=stdin)
        assert done.returncode == 1, done
        assert "Traceback" not in done.stderr
        # Bars of work done before the mistake could be seen, and what a person was asked, may stand before it.
        lines = [line for line in done.stderr.splitlines() if not _PROGRESS.search(line)]
        assert len(lines) == 1, done.stderr
        assert lines[0].startswith("labcdp: ")
        return lines[0]

    return run


@pytest.fixture
def running_bench(aravis):
    """`labcdp simulate-bench` with a small target; yields its process and what it printed."""
    from labcdp.report.envelope import schema
    from labcdp.session import example_session

    started = []

    def start():
        process = subprocess.Popen(
            [_LABCDP, "simulate-bench", example_session() / "session.toml", "--response-s", "0", "--json"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        text = ""
        while not text.endswith("\n}\n"):
            line = process.stdout.readline()
            assert line, process.stderr.read()
            text += line
        values = json.loads(text)
        Draft202012Validator(schema()).validate(values)
        camera, meter = values["tables"]["devices"]["rows"]
        return process, {"camera": camera, "meter": {"port": meter["address"]}}

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()
