"""The frame writer: everything in order, back-pressure, and errors that come out where frames go in."""

import signal
import threading

import numpy as np
import pytest

from labcdp.acquire.recording import FrameWriter
from labcdp.core.clock import SystemClock
from labcdp.core.errors import SessionError
from labcdp.session import EventRecord, FrameRecord, Session

from .conftest import new_frame


def frame(number):
    return new_frame(np.full((4, 5), number), number)


class Gated:
    """A disk that takes frames when told to; stands for a session."""

    def __init__(self):
        self.open = threading.Event()
        self.asked = threading.Event()
        self.frames, self.groups = [], []

    def add_frames(self, group):
        self.asked.set()
        assert self.open.wait(120)
        self.groups.append(len(group))
        self.frames += [frame.frame_id for frame, _, _ in group]


@pytest.fixture
def session(tmp_path, small_configuration):
    with Session.create(tmp_path / "s", small_configuration) as opened:
        yield opened


def test_frames_and_events_are_recorded_in_order(session):
    with FrameWriter(session, SystemClock()) as writer:
        for n in range(40):
            writer.put(frame(n), "light" if n < 30 else "dark", "P01" if n < 30 else None)
            if n % 10 == 0:
                writer.put_event("mark", {"n": n})
    recorded = [
        r.metadata["frame_id"] if isinstance(r, FrameRecord) else ("mark", r.content["n"])
        for r in session.records
        if isinstance(r, FrameRecord) or (isinstance(r, EventRecord) and r.kind == "mark")
    ]
    assert recorded == [x for n in range(40) for x in ((n, ("mark", n)) if n % 10 == 0 else (n,))]
    assert [(r.role, r.patch) for r in session.frames()] == [("light", "P01")] * 30 + [("dark", None)] * 10
    assert all((session.load(r).dn == r.metadata["frame_id"]).all() for r in session.frames())
    session.verify()
    assert writer.throughput.frames == 40


@pytest.mark.parametrize("limits", [{"max_frames": 3}, {"max_bytes": 3 * 40}])
def test_a_full_queue_holds_the_camera_up_and_loses_nothing(limits):
    disk = Gated()
    n_put = 0

    def count(writer):
        nonlocal n_put
        for n in range(10):
            writer.put(frame(n), "light", None)
            n_put += 1

    with FrameWriter(disk, SystemClock(), **limits) as writer:
        producer = threading.Thread(target=count, args=(writer,))
        producer.start()
        assert disk.asked.wait(120)
        producer.join(0.3)
        # Those being written count: their memory is in use.
        assert n_put == 3
        disk.open.set()
        producer.join(10)
        assert n_put == 10
    assert disk.frames == list(range(10))
    assert max(disk.groups) <= 3
    assert writer.throughput.waited_s >= 0.3
    assert writer.throughput.limited_by_disk


def test_a_second_interrupt_does_not_cost_what_waits():
    disk = Gated()

    def interrupt_again():
        # Ctrl-C, while the first one is being unwound; the disk is slow.
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        threading.Timer(0.5, disk.open.set).start()

    def interrupted():
        with FrameWriter(disk, SystemClock()) as writer:
            for n in range(5):
                writer.put(frame(n), "light", None)
            threading.Timer(0.2, interrupt_again).start()
            raise KeyboardInterrupt

    # Whatever these tests were started with.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            interrupted()
    finally:
        signal.signal(signal.SIGINT, before)
    assert disk.frames == list(range(5))


@pytest.mark.parametrize("n_frames", [1, 1000])
def test_an_error_of_the_disk_comes_out_at_the_next_frame_or_at_the_end(session, n_frames):
    session.close()

    def write():
        with FrameWriter(session, SystemClock()) as writer:
            for n in range(n_frames):
                writer.put(frame(n), "light", None)

    with pytest.raises(SessionError, match=r"is not open for writing"):
        write()
    assert not any(thread.name == "labcdp frame writer" for thread in threading.enumerate())
