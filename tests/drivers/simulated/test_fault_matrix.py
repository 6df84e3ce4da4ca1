"""Every fault the simulated bench knows in every state it can meet: recovery or one clear error, and nothing lost.

Camera and meter are on their real protocols. Recovered means that what was asked for was done; the error, where one
is due, is one line of ours. Either way all that was recorded is whole, the devices can be opened again, and no thread,
port or file is left behind.
"""

import os
import time
from contextlib import contextmanager
from itertools import product

import pytest

from labcdp.core.errors import LabcdpError
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.minolta.ls import MinoltaLS110
from labcdp.drivers.simulated.bench import SimulatedBench, SimulatedDevices
from labcdp.session import Session

from ...conftest import wait_until

SHAPE = (400, 480)
PATIENCE_S = 30.0

CODES = ("ER00", "ER01", "ER10", "ER11", "ER19", "ER20", "ER30")
FAULTS = (
    *(f"{fault} for 400 ms" for fault in ("lose 2%", "stall", "freeze", "vanish", "wrong ids", "wrong size")),
    *(f"{fault} for 400 ms" for fault in ("wrong exposure", "resend wrong", "path 1500 bytes")),
    *("temperature +8 C in 400 ms", "light -5% in 400 ms"),
    *(f"meter {fault}" for fault in (*CODES, "truncate 7", "delay 700 ms", "garble", "unit fL", "unplug for 400 ms")),
    "meter drop\nat 0.4 s meter remote",
)
#: Codes after which asking again is no use: the person has to know, as of another size of the frames.
REPORTED = tuple(f"meter {code}" for code in CODES if code != "ER00")
STATES = ("idle", "grabbing", "changing a setting", "reading the meter", "closing")
#: Where a fault meets other code than in the other states, which are tried in the long tests.
SHORT = {
    "idle": ("wrong size",),
    "grabbing": ("freeze", "vanish", "lose", "wrong size", "light"),
    "changing a setting": ("freeze",),
    "reading the meter": ("meter ER01", "meter delay", "meter drop", "meter unplug"),
    "closing": ("vanish",),
}
CASES = [(fault, state) for fault, state in product(FAULTS, STATES) if fault.startswith(SHORT[state])]
OTHERS = [case for case in product(FAULTS, STATES) if case not in CASES]


@pytest.fixture(scope="module")
def bench(aravis, small_configuration):
    """The bench, whose devices are switched on and off for each cell."""
    with SimulatedBench(small_configuration, SimulatedDevices.standard(), SHAPE) as bench:
        bench.server, bench.pty = bench.gige_camera(), bench.pty_meter(0.05)
        with bench.server, bench.pty, devices(bench) as (camera, meter):  # what is made once stays
            a_frame(camera)
            meter.measure()
        time.sleep(1)  # threads that have been told to end
        bench.before = left_behind()
        yield bench


@contextmanager
def devices(bench):
    """Camera and meter, open; both are closed at the end."""
    camera = AravisCamera(bench.server.address, patience_s=PATIENCE_S)
    meter = MinoltaLS110(bench.pty.port, timeout_s=0.4, attempts=2, patience_s=PATIENCE_S)
    with camera, meter:
        camera.configure(exposure_s=0.002, frame_rate_hz=40)
        yield camera, meter


def left_behind():
    """Number of threads and files of this process."""
    return len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd"))


def a_frame(camera):
    """One whole frame; a busy computer may lose some of its own."""
    return next(camera.grab(1, on_refused=lambda _error: None))


def begin(bench, fault):
    """Let it begin now, not when a thread gets to it."""
    now, *later = fault.splitlines()
    bench.run_command(now)
    bench.schedule("\n".join(later))


def act(state, bench, fault, camera, meter, session):
    """Be in a state, let the fault happen, and go on to a frame and a reading."""
    patch = bench.pointed_at
    if state == "grabbing":
        for number, frame in enumerate(camera.grab(20, on_refused=lambda _error: None)):
            session.add_frame(frame)
            if number == 1:
                begin(bench, fault)
        if fault.startswith("wrong size"):
            bench.run_command("recover")  # a stream that a busy computer opens too early would be refused
    else:
        begin(bench, fault)
    if state == "idle":
        time.sleep(0.2)
    elif state == "changing a setting":
        camera.configure(exposure_s=0.004)
    elif state == "reading the meter":
        session.add_reading(meter.measure(), patch)
    if state != "closing":
        session.add_frame(a_frame(camera))
        session.add_reading(meter.measure(), patch)


@pytest.mark.parametrize(
    ("fault", "state"), [*CASES, *(pytest.param(*case, marks=pytest.mark.long) for case in OTHERS)]
)
def test_a_fault_in_a_state_ends_in_recovery_or_one_clear_error(bench, fault, state, small_configuration, tmp_path):
    wrong_size = fault.startswith("wrong size") and state != "grabbing"
    wants_a_person = fault in REPORTED or wrong_size
    # Frames of another size are reported where they begin with the stream, however long that takes to open.
    lasting = "wrong size" if wrong_size else fault
    with bench.server, bench.pty:
        with Session.create(tmp_path / "session", small_configuration) as session:
            error = None
            with devices(bench) as (camera, meter):
                session.add_frame(a_frame(camera))
                session.add_reading(meter.measure(), bench.pointed_at)
                try:
                    act(state, bench, lasting, camera, meter, session)
                except LabcdpError as reported:
                    error = str(reported)
            recorded = len(session.frames()), len(session.readings())
        bench.run_command("recover")
        with devices(bench) as (camera, meter):
            assert a_frame(camera).shape == SHAPE
            assert meter.measure().luminance_cd_m2 > 0
        bench.run_command("recover")
    assert (error is not None) == (wants_a_person and state != "closing"), error
    assert error is None or (len(error.splitlines()) == 1 and ": " in error)
    with Session.open(tmp_path / "session") as session:
        session.verify()
        assert (len(session.frames()), len(session.readings())) == recorded
    wait_until(lambda: all(now <= then for now, then in zip(left_behind(), bench.before, strict=True)), "all ended")
