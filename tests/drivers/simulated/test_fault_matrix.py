"""Every fault the simulated bench knows in every state it can meet: recovery or one clear error, and nothing lost.

Camera and meter are on their real protocols. Recovered means that what was asked for was done; the error, where one
is due, is one line of ours. Either way all that was recorded is whole, the devices can be opened again, and no thread,
port or file is left behind.
"""

import os
import time
from collections import Counter
from contextlib import contextmanager
from itertools import product
from pathlib import Path

import pytest

from labcdp.core.errors import LabcdpError
from labcdp.drivers.aravis import gvcp
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.session import Session

SHAPE = (400, 480)
PATIENCE_S = 30.0

CAMERA_FAULTS = {
    "packets lost": "lose 2% for 400 ms",
    "all packets lost": "stall for 400 ms",
    "frozen": "freeze for 400 ms",
    "vanished": "vanish for 400 ms",
    "wrong ids": "wrong ids for 400 ms",
    "wrong size": "wrong size for 400 ms",
    "temperature drifts": "temperature +8 C in 400 ms",
    "light drifts": "light -5% in 400 ms",
    "second controller": "second controller for 400 ms",
}
METER_FAULTS = {
    **{code: f"meter {code}" for code in ("ER00", "ER01", "ER10", "ER11", "ER19", "ER20", "ER30")},
    "answer cut off": "meter truncate 7",
    "answer late": "meter delay 700 ms",
    "garbage": "meter garble",
    "unit changed": "meter unit fL",
    "out of remote mode": "meter drop\nat 0.4 s meter remote",
    "unplugged": "meter unplug for 400 ms",
}
FAULTS = CAMERA_FAULTS | METER_FAULTS
#: Codes after which asking again is no use: the person has to know, as of another size of the frames.
REPORTED = ("ER01", "ER10", "ER11", "ER19", "ER20", "ER30")
STATES = ("idle", "grabbing", "changing a setting", "reading the meter", "closing")
#: Where a fault meets other code than in the other states, which are tried in the long tests.
CASES = [
    *(("frozen", state) for state in ("grabbing", "changing a setting")),
    ("wrong size", "idle"),
    *(("vanished", state) for state in ("grabbing", "closing")),
    *((fault, "grabbing") for fault in ("packets lost", "wrong size", "light drifts", "second controller")),
    *((fault, "reading the meter") for fault in ("ER01", "answer late", "out of remote mode", "unplugged")),
]
OTHERS = [case for case in product(FAULTS, STATES) if case not in CASES]


@pytest.fixture(scope="module")
def bench(aravis, small_configuration):
    """The bench, whose devices are switched on and off for each cell."""
    with SimulatedBench(small_configuration, BenchDevices.standard(), SHAPE) as bench:
        bench.server, bench.pty = bench.gige_camera(), bench.pty_meter(0.05)
        with switched_on(bench), devices(bench) as (camera, meter):  # what is made once stays
            a_frame(camera)
            meter.measure()
        bench.before = at_rest()
        yield bench


@contextmanager
def switched_on(bench):
    with bench.server, bench.pty:
        yield
        bench.run_command("recover")


@contextmanager
def devices(bench):
    """Camera and meter, open; both are closed at the end."""
    camera = AravisCamera(bench.server.address, patience_s=PATIENCE_S)
    meter = MinoltaLS110(bench.pty.port, timeout_s=0.4, attempts=2, patience_s=PATIENCE_S)
    with camera, meter:
        camera.configure(exposure_s=0.002, frame_rate_hz=40)
        yield camera, meter


def left_behind():
    """Threads, sockets and files of this process."""
    kinds = Counter()
    for entry in Path("/proc/self/fd").iterdir():
        try:
            kinds[os.readlink(entry).split(":")[0]] += 1
        except OSError:
            continue
    return len(list(Path("/proc/self/task").iterdir())), kinds["socket"], kinds.total()


def at_rest():
    """What there is when nothing has changed for a second: threads that have been told to end may take a moment."""
    seen, since_s = left_behind(), time.monotonic()
    until_s = since_s + 30
    while time.monotonic() < min(since_s + 1, until_s):
        time.sleep(0.05)
        if (now := left_behind()) != seen:
            seen, since_s = now, time.monotonic()
    return seen


def more_than(before):
    """What there is beyond what was there before, after a moment for threads to end."""
    until_s = time.monotonic() + 120
    while (more := [max(now - then, 0) for now, then in zip(left_behind(), before, strict=True)]) != [0, 0, 0]:
        if time.monotonic() > until_s:
            break
        time.sleep(0.05)
    return dict(zip(("threads", "sockets", "files"), more, strict=True))


def a_frame(camera):
    """One whole frame; a busy computer may lose some of its own."""
    return next(camera.grab(1, on_refused=lambda _error: None))


def begin(bench, fault):
    """Let it begin now, not when a thread gets to it."""
    now, *later = fault.splitlines()
    bench.run_command(now)
    for line in later:
        bench.schedule(line)


def wait_for_release(address):
    """Wait until no program controls the camera."""
    until_s = time.monotonic() + 120
    while (answer := gvcp.read_register(address, gvcp.CONTROL_CHANNEL_PRIVILEGE)) is None or answer.register:
        assert time.monotonic() < until_s
        time.sleep(0.02)


def act(state, bench, fault, camera, meter, session):
    """Be in a state, let the fault happen, and go on to a frame and a reading."""
    patch = bench.pointed_at
    if state == "grabbing":
        for number, frame in enumerate(camera.grab(6, on_refused=lambda _error: None)):
            session.add_frame(frame)
            if number == 1:
                begin(bench, fault)
    else:
        begin(bench, fault)
        if state == "idle":
            time.sleep(0.2)
            # While the other program has control, the camera is refused instead of waited for.
            if "second controller" in fault:
                wait_for_release(bench.server.address)
        elif state == "changing a setting":
            camera.configure(exposure_s=0.004)
        elif state == "reading the meter":
            session.add_reading(meter.measure(), patch)
        else:
            camera.close()
            meter.close()
            return
    session.add_frame(a_frame(camera))
    session.add_reading(meter.measure(), patch)


def cell(bench, fault, state, path, configuration):
    """Let it happen, and return how it ended and what had been recorded."""
    with Session.create(path, configuration) as session, devices(bench) as (camera, meter):
        session.add_frame(a_frame(camera))
        session.add_reading(meter.measure(), bench.pointed_at)
        error = None
        # Frames of another size are reported where they begin with the stream, however long that takes to open.
        told = "wrong size" if fault == "wrong size" and state != "grabbing" else FAULTS[fault]
        try:
            act(state, bench, told, camera, meter, session)
        except LabcdpError as reported:
            error = reported
        camera.close()
        meter.close()
        bench.run_command("recover")
        if error is not None:
            assert len(str(error).splitlines()) == 1
            assert ": " in str(error), "an error says what to do"
        return "recovered" if error is None else "one clear error", len(session.frames()), len(session.readings())


@pytest.mark.parametrize(
    ("fault", "state"), [*CASES, *(pytest.param(*case, marks=pytest.mark.long) for case in OTHERS)]
)
def test_a_fault_in_a_state_ends_in_recovery_or_one_clear_error(bench, fault, state, small_configuration, tmp_path):
    with switched_on(bench):
        outcome, frames, readings = cell(bench, fault, state, tmp_path / "session", small_configuration)
        with devices(bench) as (camera, meter):
            assert a_frame(camera).shape == SHAPE
            assert meter.measure().luminance_cd_m2 > 0
    wants_a_person = fault in REPORTED or (fault == "wrong size" and state != "grabbing")
    assert outcome == ("one clear error" if wants_a_person and state != "closing" else "recovered")
    with Session.open(tmp_path / "session") as session:
        session.verify()
        assert (len(session.frames()), len(session.readings())) == (frames, readings)
    assert more_than(bench.before) == {"threads": 0, "sockets": 0, "files": 0}
