"""The frame writer: back-pressure, and errors that come out where frames go in."""

import os
import signal
import threading

import numpy as np
import pytest

from labcdp.acquire.recording import FrameWriter
from labcdp.core.clock import SystemClock
from labcdp.core.errors import SessionError

from ..conftest import wait_until


@pytest.fixture
def frame(new_frame):
    return lambda number: new_frame(np.full((4, 5), number), number)


class Gated:
    """A disk that takes frames when told to; stands for a session."""

    def __init__(self):
        self.open, self.asked = threading.Event(), threading.Event()
        self.frames, self.groups = [], []

    def add_frames(self, group):
        self.asked.set()
        assert self.open.wait(120)
        self.groups.append(len(group))
        self.priority = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
        self.frames += [frame.frame_id for frame, _, _ in group]


@pytest.mark.parametrize("limits", [{"max_frames": 3}, {"max_bytes": 3 * 40}])
def test_a_full_queue_holds_the_camera_up_and_loses_nothing(limits, frame):
    disk, put = Gated(), []

    def produce(writer):
        for n in range(10):
            writer.put(frame(n), "light", None)
            put.append(n)

    with FrameWriter(disk, SystemClock(), **limits) as writer:
        producer = threading.Thread(target=produce, args=(writer,))
        producer.start()
        assert disk.asked.wait(120)
        wait_until(lambda: len(put) == 3, "the queue is full")
        producer.join(0.3)
        # Those being written count: their memory is in use.
        assert put == [0, 1, 2]
        disk.open.set()
        producer.join(120)
    assert put == disk.frames == list(range(10))
    assert max(disk.groups) <= 3
    # Above other programs, where that is permitted.
    assert disk.priority in (-10, os.getpriority(os.PRIO_PROCESS, 0))
    assert writer.throughput.limited_by_disk


def test_a_second_interrupt_does_not_cost_what_waits(frame):
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
def test_an_error_of_the_disk_comes_out_at_the_next_frame_or_at_the_end(example, frame, n_frames):
    def write():
        # Open for reading only.
        with FrameWriter(example, SystemClock()) as writer:
            for n in range(n_frames):
                writer.put(frame(n), "light", None)

    with pytest.raises(SessionError, match=r"is not open for writing"):
        write()
