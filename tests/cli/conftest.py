import json
import os
import re
import signal
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


@pytest.fixture(scope="session")
def forking():
    """Process that forks for each command; see its file."""
    program = [sys.executable, Path(__file__).with_name("forking.py")]
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.stdin.close()


@pytest.fixture
def labcdp(tmp_path, tmp_path_factory, forking):
    """Run the command in an empty folder; returns the finished process."""

    def run(*arguments, stdin=None, timeout_s=120):
        words, streams = [str(_LABCDP), *map(str, arguments)], tmp_path_factory.mktemp("streams")
        if stdin is not None:
            (streams / "stdin").write_text(stdin)
        request = {name: str(streams / name) for name in ("stdin", "stdout", "stderr")}
        request |= {"stdin": os.devnull} if stdin is None else {}
        request |= {"arguments": words, "cwd": str(tmp_path), "timeout_s": timeout_s}
        print(json.dumps(request), file=forking.stdin, flush=True)
        status = json.loads(forking.stdout.readline())
        out, err = ((streams / name).read_text() for name in ("stdout", "stderr"))
        if status is None:
            raise subprocess.TimeoutExpired(words, timeout_s, out, err)
        return subprocess.CompletedProcess(words, status, out, err)

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


@pytest.fixture(scope="session", autouse=True)
def hangup_ends():
    """Commands inherit whether a hangup is ignored, as it is where the tests are started by nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)
