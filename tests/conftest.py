"""What all tests share: a network of their own, so that they neither reach nor disturb real cameras."""

import ctypes
import gc
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path

import hypothesis
import numpy as np
import pytest
from jsonschema import Draft202012Validator

_LABCDP = Path(sys.executable).with_name("labcdp")
CHROMIUM = shutil.which("chromium")
_CLONE_NEWNET = 0x40000000
_FORKING = "LABCDP_TESTS_FORKING"
_SLOW_FIRST = {name: place for place, name in enumerate(("cli", "evaluate", "web", "acquire", "drivers"))}

# Tests do not depend on how busy the computer is, and are the same each time; tools/fuzz looks for more.
hypothesis.settings.register_profile(
    "labcdp", deadline=None, derandomize=True, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("labcdp")


def wait_until(condition, what, patience_s=300):
    """Wait for something that another process or thread does."""
    end = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end, f"waited in vain until {what}"
        time.sleep(0.02)


def _may_have_a_network_of_its_own() -> bool:
    return os.geteuid() == 0 and shutil.which("ip") is not None


def pytest_xdist_auto_num_workers() -> int:
    """Two more processes than processors, as many tests wait; one where all would share the simulated camera's port."""
    return (os.cpu_count() or 1) + 2 if _may_have_a_network_of_its_own() else 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest, so that none of them is left to one process at the end."""
    root = Path(__file__).parent
    items.sort(key=lambda item: _SLOW_FIRST.get(item.path.relative_to(root).parts[0], len(_SLOW_FIRST)))


def pytest_collection_finish() -> None:
    """Look no more for garbage in what all tests keep: modules, and the tests themselves."""
    gc.freeze()


def pytest_configure(config: pytest.Config) -> None:
    """Give the test process signals that its children do not inherit as ignored, and a network of its own."""
    _ignore_signals_alone()
    _move_to_own_network()
    if config.getoption("numprocesses", None):
        # One for all test processes, which inherit this; it imports while they collect.
        server = forking_server()
        os.environ[_FORKING] = server.__enter__()
        config.add_cleanup(lambda: server.__exit__(None, None, None))


def _ignore_signals_alone() -> None:
    """Where SIGINT or SIGHUP is ignored, as under nohup, ignore it here but not in the programs that tests start."""
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, lambda _number, _frame: None)


def _move_to_own_network() -> None:
    """Move the test process into a network namespace with nothing but loopback, where that is allowed."""
    # The call moves the calling thread only, and those it will start.
    if _may_have_a_network_of_its_own() and ctypes.CDLL(None, use_errno=True).unshare(_CLONE_NEWNET) == 0:
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
        subprocess.run(["ip", "addr", "add", "127.0.0.2/8", "dev", "lo"], check=True)


@contextmanager
def forking_server(without=()):
    """Start a process that forks for each command, maybe without some libraries; give the path of its socket."""
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/forking"
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(path)
            # Who connects early waits for the imports.
            listening.listen()
            program = [sys.executable, Path(__file__).with_name("forking.py"), str(listening.fileno()), *without]
            process = subprocess.Popen(program, stdin=subprocess.PIPE, pass_fds=[listening.fileno()])
        with process:
            yield path
            process.stdin.close()


@contextmanager
def connected(path):
    """Give the stream of requests to a process that forks for each command; see its file."""
    with (
        socket.socket(socket.AF_UNIX) as connection,
        open("/proc/thread-self/ns/net") as network,
    ):
        connection.connect(path)
        socket.send_fds(connection, [b"n"], [network.fileno()])
        with connection.makefile("rw") as stream:
            yield stream


@pytest.fixture(scope="session")
def forking():
    """Stream of requests to a process that forks for each command, for all tests of this process."""
    server = nullcontext(os.environ[_FORKING]) if _FORKING in os.environ else forking_server()
    with server as path, connected(path) as stream:
        yield stream


class Started:
    """A command that runs, as `subprocess.Popen` has it; with pipes, or with files whose text is there at its end."""

    def __init__(self, forking, folder, arguments, streams, stdin=os.devnull, environment=(), pipes=False):
        self._forking, self._streams, self.returncode = forking, streams, None
        names = {name: str(streams / name) for name in ("stdin", "stdout", "stderr")}
        for name in names if pipes else ():
            os.mkfifo(names[name])
        names["stdin"] = names["stdin"] if pipes else str(stdin)
        words = [str(_LABCDP), *map(str, arguments)]
        self.pid = self._ask(arguments=words, cwd=str(folder), environment=dict(environment), **names)
        if pipes:
            # In the order in which the command opens them, as each waits for the other side.
            self.stdin = Path(names["stdin"]).open("w")  # noqa: SIM115
            self.stdout, self.stderr = (Path(names[name]).open() for name in ("stdout", "stderr"))  # noqa: SIM115

    def _ask(self, **request):
        print(json.dumps(request), file=self._forking, flush=True)
        return json.loads(self._forking.readline())

    def wait(self, timeout_s=900):
        """Exit status; None if it still runs after that time."""
        if self.returncode is None:
            self.returncode = self._ask(process=self.pid, timeout_s=timeout_s)
        return self.returncode

    def poll(self):
        return self.wait(0)

    def send_signal(self, number):
        os.kill(self.pid, number)

    def said(self, name="stderr"):
        """What it wrote into the file, so far."""
        return (self._streams / name).read_text()

    def end(self):
        """End it if it still runs, and close its pipes."""
        if self.poll() is None:
            self.send_signal(signal.SIGKILL)
            self.wait()
        for name in ("stdin", "stdout", "stderr"):
            with suppress(AttributeError, BrokenPipeError):
                getattr(self, name).close()


@pytest.fixture(scope="session")
def start_in(tmp_path_factory, forking):
    """Start a command in a folder, as from a terminal; the caller has to end it."""

    def start(folder, *arguments, **options):
        return Started(forking, folder, arguments, tmp_path_factory.mktemp("streams"), **options)

    return start


@pytest.fixture
def start(tmp_path, start_in):
    """Start a command in an empty folder; it is ended with the test."""
    started = []

    def run(*arguments, **options):
        started.append(start_in(tmp_path, *arguments, **options))
        return started[-1]

    yield run
    for process in started:
        process.end()


@pytest.fixture
def nursery(request):
    """The test's own file as a program: it forks a process for each line that it reads."""
    process = subprocess.Popen(
        [sys.executable, request.path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        bufsize=1,
        start_new_session=True,
    )
    yield process
    process.stdin.close()
    # Its last child, too, if the test failed.
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()


@pytest.fixture(scope="session")
def labcdp_in(tmp_path_factory, start_in):
    """Run the command in a folder, as from a terminal; returns the finished process."""
    return runs_with(start_in, tmp_path_factory)


def runs_with(start_in, tmp_path_factory):
    """Make the function that starts a command in a folder and waits for its end."""

    def run(folder, *arguments, stdin=None, timeout_s=900, environment=()):
        typed = os.devnull
        if stdin is not None:
            typed = tmp_path_factory.mktemp("typed") / "stdin"
            typed.write_text(stdin)
        process = start_in(folder, *arguments, stdin=typed, environment=environment)
        status = process.wait(timeout_s)
        process.end()
        out, err = process.said("stdout"), process.said("stderr")
        if status is None:
            raise subprocess.TimeoutExpired(arguments, timeout_s, out, err)
        return subprocess.CompletedProcess(arguments, status, out, err)

    return run


@pytest.fixture
def labcdp(tmp_path, labcdp_in):
    """Run the command in an empty folder; returns the finished process."""
    return partial(labcdp_in, tmp_path)


def valid(values):
    """Return values, or those of a JSON text, that follow the schema that ships with labcdp."""
    schema = files("labcdp").joinpath("data/schema/result.schema.json").read_text(encoding="utf-8")
    values = json.loads(values) if isinstance(values, str) else values
    Draft202012Validator(json.loads(schema)).validate(values)
    return values


@pytest.fixture(scope="session")
def aravis():
    """Aravis, or skip."""
    gi = pytest.importorskip("gi", reason="PyGObject (python3-gi) is not installed")
    try:
        gi.require_version("Aravis", "0.8")
    except ValueError:
        pytest.skip("Aravis (gir1.2-aravis-0.8) is not installed")
    from gi.repository import Aravis

    return Aravis


@pytest.fixture(scope="session")
def aravis_tools(aravis):
    """Debian's command line programs of Aravis, or skip."""
    for name, package in (("arv-tool-0.8", "aravis-tools-cli"), ("arv-camera-test-0.8", "aravis-tools")):
        if shutil.which(name) is None:
            pytest.skip(f"{name} ({package}) is not installed")


@pytest.fixture(scope="session")
def browser():
    """Chromium without a screen."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def example():
    """The example session: 16 patches on 480 x 400 pixels."""
    from labcdp.session import Session, example_session

    return Session.open(example_session())


@pytest.fixture(scope="session")
def small_configuration(example):
    """Bench of the example session."""
    return example.configuration


@pytest.fixture(scope="session")
def new_frame(example):
    """A frame as those of the example session, of 12 bits, with other pixels."""
    first = example.load(example.frames()[0])
    return lambda dn, frame_id=1, **changes: replace(
        first, dn=np.asarray(dn).astype(np.uint16), frame_id=frame_id, camera_timestamp_ns=frame_id, **changes
    )


@pytest.fixture(scope="session")
def new_reading(example):
    """A reading as those of the example session, with another value."""
    first = example.readings()[0].reading
    return lambda value, **changes: replace(first, value=value, **changes)
