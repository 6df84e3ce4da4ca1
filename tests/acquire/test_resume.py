"""An acquisition that ends after any record, with whatever a kill leaves, is resumed and has the same data.

A session that is killed at each call of the system is tested with sessions.
"""

import shutil
from dataclasses import replace

import pytest
import xarray

import labcdp
from labcdp.acquire import acquire, remaining
from labcdp.core.clock import SimulatedClock
from labcdp.drivers.simulated.bench import SimulatedBench, SimulatedDevices
from labcdp.drivers.simulated.meter import MeterErrorModel
from labcdp.session import Session

from .conftest import SHAPE


@pytest.fixture(scope="module")
def bench(small_configuration):
    devices = replace(SimulatedDevices.standard(), meter=MeterErrorModel(0.006, 0.001, seed=2))
    with SimulatedBench(small_configuration, devices, SHAPE, clock=SimulatedClock()) as bench:
        yield bench


def resumed(path, bench):
    """The session, complete."""
    with Session.open(path, writable=True) as session:
        with bench.in_process_camera() as camera, bench.in_process_meter(0) as meter:
            acquire(session, camera, meter, bench, bench=bench)
        assert remaining(session).complete
        session.verify()
    return Session.open(path)


def content(session):
    """Every frame and reading of a session, in order."""
    frames = [(r.role, r.exposure_s, session.load(r).dn.tobytes()) for r in session.frames()]
    return frames, [(r.patch, r.reading.raw) for r in session.readings()]


def results(session):
    return labcdp.Session.open(session.path).calibrate().evaluate().to_dataset().drop_attrs()


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory, small_configuration, bench):
    path = tmp_path_factory.mktemp("uninterrupted") / "session"
    Session.create(path, small_configuration).close()
    return resumed(path, bench)


@pytest.mark.parametrize("step", [pytest.param(1, marks=pytest.mark.long), 7])
def test_an_acquisition_that_ends_after_any_record_is_resumed_with_the_same_data(tmp_path, uninterrupted, bench, step):
    lines = (uninterrupted.path / "journal.jsonl").read_bytes().splitlines(keepends=True)
    assert len(lines) > 44
    for n in range(2, len(lines), step):
        # Half of the next line is there, and files of frames that are not in the journal.
        path = shutil.copytree(uninterrupted.path, tmp_path / str(n))
        (path / "journal.jsonl").write_bytes(b"".join(lines[:n]) + lines[n][: len(lines[n]) // 2])
        session = resumed(path, bench)
        assert (path / "journal.jsonl").read_bytes().startswith(b"".join(lines[:n]))
        assert content(session) == content(uninterrupted)
    xarray.testing.assert_allclose(results(session), results(uninterrupted), rtol=1e-6, atol=1e-7)
