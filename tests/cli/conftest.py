import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

_PROGRESS = re.compile(r"\d+/\d+ +\d:\d\d:\d\d|then press Enter|exists: going on with it|^labcdp: simulated")
_LABCDP = Path(sys.executable).with_name("labcdp")


@pytest.fixture
def labcdp_path():
    """The command's file."""
    return _LABCDP


@pytest.fixture
def labcdp(tmp_path):
    """Run the command in an empty folder; returns the finished process."""

    def run(*arguments, stdin=None):
        return subprocess.run(
            [_LABCDP, *map(str, arguments)], cwd=tmp_path, input=stdin, capture_output=True, text=True, timeout=120
        )

    return run


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
        return process, json.loads(text)

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()
