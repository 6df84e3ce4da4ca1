"""An acquisition can be killed at any moment, and the next one resumes it.

Run as a program, this file is a nursery: for each line on its standard input it forks a process that acquires, so
that one costs milliseconds and not an interpreter's start.
"""

import os
import random
import signal
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
#: Light frames, dark frames and readings.
PLANNED = (6, 6, 32)


def configuration():
    return SessionConfiguration.load(example_session() / "session.toml")


class Continued:
    """The exposures of a target after the first `n`: a frame has the same noise in whichever run it is taken."""

    def __init__(self, source, n):
        self._source, self._n, self.state = source, n, source.state

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


def content(session):
    """Every frame and reading of a session, in order."""
    frames = [(r.role, r.exposure_s, session.load(r).dn.tobytes()) for r in session.frames()]
    return frames, [(r.patch, r.reading.raw) for r in session.readings()]


def results(session):
    return labcdp.Session.open(session.path).calibrate().evaluate().to_dataset().drop_attrs()


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    path = tmp_path_factory.mktemp("uninterrupted") / "session"
    Session.create(path, configuration()).close()
    work(path, simulated_bench())
    return Session.open(path)


def checks(path):
    """Checks of the journal's whole lines."""
    return [line.rpartition(b'"check": ')[2] for line in (path / "journal.jsonl").read_bytes().split(b"\n")[:-1]]


def wait_for_lines(path, n):
    """Return once the journal has so many lines or records that the acquisition is complete."""
    while len(lines := (path / "journal.jsonl").read_bytes().splitlines()) < n and b'"complete"' not in lines[-1]:
        time.sleep(0.001)


@pytest.mark.parametrize(
    ("kills", "least_completed", "least_places"), [(12, 1, 8), pytest.param(100, 3, 15, marks=pytest.mark.long)]
)
def test_a_kill_at_any_moment_loses_nothing_and_the_resumed_session_has_the_same_results(
    tmp_path, uninterrupted, nursery, kills, least_completed, least_places
):
    rng = random.Random(20261121)
    completed, caught_at, path = [], set(), None
    # Where the moments fall is up to the machine: a slow one is killed more often before it completes a session.
    for n_killed in range(5 * kills):
        if n_killed >= kills and len(completed) >= least_completed:
            break
        if path is None:
            path = tmp_path / f"session {len(completed)}"
            Session.create(path, configuration()).close()
        before = checks(path)
        print(path, file=nursery.stdin)
        pid = int(nursery.stdout.readline().removeprefix("begun "))
        wait_for_lines(path, len(before) + rng.randrange(20))
        time.sleep(rng.uniform(0, 0.02))
        os.kill(pid, signal.SIGKILL)
        ended = nursery.stdout.readline()
        if ended == "complete\n":
            ended = nursery.stdout.readline()
        assert ended == f"ended {-signal.SIGKILL}\n"
        assert checks(path)[: len(before)] == before
        session = Session.open(path)
        assert session.problems() == [] or "a line that is not whole" in session.problems()[0]
        now = len(session.frames("light")), len(session.frames("dark")), len(session.readings())
        assert all(n <= planned for n, planned in zip(now, PLANNED, strict=True))
        caught_at.add(now)
        if remaining(session).complete:
            assert now == PLANNED
            assert content(session) == content(uninterrupted)
            completed.append(session)
            path = None
    # The kills were spread over the whole of an acquisition, and it came to its end in spite of them.
    assert len(completed) >= least_completed
    assert len(caught_at) >= least_places
    xarray.testing.assert_allclose(results(completed[0]), results(uninterrupted), rtol=1e-6, atol=1e-7)


if __name__ == "__main__":
    nurse()
