"""An acquisition can be killed at any moment, and the next one resumes it.

Run as a program, this file is a nursery: for each line on its standard input it forks a process that acquires, so
that one costs milliseconds and not an interpreter's start.
"""

import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest
import xarray

import labcdp
from labcdp.acquire import acquire, remaining
from labcdp.core.clock import SimulatedClock
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.drivers.simulated.in_process import InProcessCamera
from labcdp.drivers.simulated.meter import MeterErrorModel
from labcdp.session import Session, SessionConfiguration, example_session

SHAPE = (400, 480)
PLANNED = {"light": 6, "dark": 6, "readings": 32}


def configuration():
    return SessionConfiguration.load(example_session() / "session.toml")


class Continued:
    """The exposures of a target after the first `n`: a frame has the same noise in whichever run it is taken."""

    def __init__(self, source, n):
        self._source, self._n = source, n

    @property
    def state(self):
        return self._source.state

    def expose(self, exposure_s, gain_db, index):
        return self._source.expose(exposure_s, gain_db, index + self._n)


def simulated_bench():
    devices = replace(BenchDevices.standard(), meter=MeterErrorModel(scale_rel=0.006))
    return SimulatedBench(configuration(), devices, SHAPE, clock=SimulatedClock())


def work(path, bench):
    with (
        Session.open(path, writable=True) as session,
        InProcessCamera(bench.device, Continued(bench._source, len(session.frames())), SimulatedClock()) as camera,
        bench.pty_meter(0) as pty,
        MinoltaLS110(pty.port) as meter,
    ):
        os.write(1, f"begun {os.getpid()}\n".encode())
        acquire(session, camera, meter, bench)


def nurse():
    bench = simulated_bench()
    bench.in_process_camera().open().snap()  # renders what every exposure needs, once and not in each process
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            work(line.rstrip("\n"), bench)
            os.write(1, b"complete\n")
            signal.pause()  # the kill still comes
        _, status = os.waitpid(child, 0)
        os.write(1, f"ended {os.waitstatus_to_exitcode(status)}\n".encode())


def counts(session):
    return {
        "light": len(session.frames("light")),
        "dark": len(session.frames("dark")),
        "readings": len(session.readings()),
    }


def content(path):
    """Every frame and reading of a session, in order."""
    with Session.open(path) as session:
        frames = [(r.role, r.exposure_s, session.load(r).dn.tobytes()) for r in session.frames()]
        return frames, [(r.patch, r.reading.raw) for r in session.readings()]


def results(path):
    return labcdp.Session.open(path).calibrate().evaluate().to_dataset().drop_attrs()


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    path = tmp_path_factory.mktemp("uninterrupted") / "session"
    Session.create(path, configuration()).close()
    work(path, simulated_bench())
    return path


def checks(path):
    """Checks of the journal's whole lines."""
    lines = (path / "journal.jsonl").read_bytes().split(b"\n")
    return [line.rpartition(b'"check": ')[2] for line in lines[:-1]]


def wait_for_lines(path, n):
    """Return once the journal has so many lines or records that the acquisition is complete."""
    while len(lines := (path / "journal.jsonl").read_bytes().splitlines()) < n and b'"complete"' not in lines[-1]:
        time.sleep(0.001)


@pytest.mark.parametrize(
    ("kills", "least_completed", "least_places"), [(12, 1, 8), pytest.param(100, 3, 15, marks=pytest.mark.long)]
)
def test_a_kill_at_any_moment_loses_nothing_and_the_resumed_session_has_the_same_results(
    tmp_path, uninterrupted, kills, least_completed, least_places
):
    rng = random.Random(20261121)
    nursery = subprocess.Popen(
        [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )

    def begin(path):
        nursery.stdin.write(f"{path}\n")
        nursery.stdin.flush()
        return int(nursery.stdout.readline().removeprefix("begun "))

    try:
        completed, caught_at, path = 0, set(), None
        # Where the moments fall is up to the machine: a slow one is killed more often before it completes a session.
        for n_killed in range(5 * kills):
            if n_killed >= kills and completed >= least_completed:
                break
            if path is None:
                path = tmp_path / f"session {completed}"
                Session.create(path, configuration()).close()
            before = checks(path)
            pid = begin(path)
            wait_for_lines(path, len(before) + rng.randrange(20))
            time.sleep(rng.uniform(0, 0.02))
            os.kill(pid, signal.SIGKILL)
            ended = nursery.stdout.readline()
            if ended == "complete\n":
                ended = nursery.stdout.readline()
            assert ended == f"ended {-signal.SIGKILL}\n"
            assert checks(path)[: len(before)] == before
            with Session.open(path) as session:
                assert session.problems() == [] or "a line that is not whole" in session.problems()[0]
                for record in session.frames():
                    session.load(record)
                now = counts(session)
                assert all(now[kind] <= PLANNED[kind] for kind in PLANNED)
                caught_at.add(tuple(now.values()))
                if remaining(session).complete:
                    assert now == PLANNED
                    assert content(path) == content(uninterrupted)
                    completed, path = completed + 1, None
    finally:
        nursery.stdin.close()
        # Its last child, too, if the test failed.
        os.killpg(nursery.pid, signal.SIGKILL)
        nursery.wait()
        nursery.stdout.close()
    # The kills were spread over the whole of an acquisition, and it came to its end in spite of them.
    assert completed >= least_completed
    assert len(caught_at) >= least_places
    xarray.testing.assert_allclose(results(tmp_path / "session 0"), results(uninterrupted), rtol=1e-6, atol=1e-7)


if __name__ == "__main__":
    nurse()
