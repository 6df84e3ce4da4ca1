import gc
import threading
import tracemalloc
import weakref

import numpy as np
import pytest

from labcdp.drivers.aravis_camera import AravisCamera
from labcdp.drivers.aravis_pool import BufferPool, pool_size
from labcdp.drivers.simulated.camera import SimulatedDevice, SimulatedGigECamera

from .conftest import Ramp


class Queue:
    """What a pool needs of a stream: it takes buffers, and gives them in turn."""

    def __init__(self):
        self.buffers = []

    def push_buffer(self, buffer):
        self.buffers.append(buffer)

    def get_n_buffers(self):
        return (len(self.buffers), 0)


@pytest.fixture
def queue(aravis):
    return Queue()


def test_pool_bridges_half_a_second_within_its_memory():
    assert pool_size(5_000_000, 15.0) == 8
    assert pool_size(5_000_000, 5.0) == 6
    assert pool_size(4_000_000, 200.0) == 32
    assert pool_size(100_000_000, 15.0) == 6
    assert pool_size(5_000_000, None) == 6


def test_a_buffer_comes_back_with_the_last_view(queue):
    pool = BufferPool(queue, 8, 12)
    buffer = queue.buffers.pop(0)
    lent = pool.lend(buffer, "<u2", (2, 3))
    view = lent[1:]
    del lent
    assert len(queue.buffers) == 7
    del view
    assert len(queue.buffers) == 8
    assert queue.buffers[-1] is buffer


def test_lent_memory_is_the_buffers_own_and_read_only(queue):
    pool = BufferPool(queue, 8, 12)
    buffer = queue.buffers.pop(0)
    _, memory = queue.labcdp_memory[hash(buffer)]
    lent = pool.lend(buffer, "|u1", (12,))
    assert np.shares_memory(lent, memory)
    with pytest.raises(ValueError, match="WRITEABLE"):
        lent.flags.writeable = True


def test_pool_grows_while_frames_are_kept_and_shrinks_again(queue):
    pool = BufferPool(queue, 8, 12)
    kept = [pool.lend(queue.buffers.pop(0), "|u1", (12,)) for _ in range(100)]
    assert len(queue.buffers) >= 4
    assert len({array.ctypes.data for array in kept}) == 100
    kept.clear()
    assert len(queue.buffers) == 8


def test_what_comes_back_after_the_end_is_freed(queue):
    pool = BufferPool(queue, 8, 12)
    buffer = queue.buffers.pop(0)
    gone = weakref.ref(queue.labcdp_memory[hash(buffer)][1])
    lent = pool.lend(buffer, "|u1", (12,))
    pool.close()
    assert gone() is not None
    n = len(queue.buffers)
    del lent
    assert gone() is None
    assert len(queue.buffers) == n


@pytest.mark.parametrize("name", ["Mono8", "Mono12", "Mono12Packed"])
def test_frames_outlive_grab_and_camera(camera_on_loopback, name):
    with AravisCamera("127.0.0.1") as camera:
        camera.configure(pixel_format=name)
        kept = list(camera.grab(30))
        copies = [frame.dn.copy() for frame in kept]
        list(camera.grab(30))
    gc.collect()
    assert all((frame.dn == copy).all() for frame, copy in zip(kept, copies, strict=True))


def test_dropping_frames_in_another_thread_loses_none(camera_on_loopback):
    waiting, stop = [], threading.Event()

    def drop():
        while not stop.wait(0.001):
            waiting.clear()

    thread = threading.Thread(target=drop)
    thread.start()
    try:
        with AravisCamera("127.0.0.1") as camera:
            for frame in camera.grab(60):
                waiting.append(frame)
            statistics = camera.statistics
    finally:
        stop.set()
        thread.join()
    assert (statistics.failed, statistics.underruns) == (0, 0)
    assert statistics.completed >= 60


@pytest.mark.parametrize("name", ["Mono8", "Mono16"])
def test_memory_is_flat_and_frames_are_not_copied(aravis, name):
    device = SimulatedDevice("SIM-1", width=256, height=256, frame_rate_hz=500)
    with SimulatedGigECamera(device, Ramp((256, 256))), AravisCamera("127.0.0.1") as camera:
        camera.configure(pixel_format=name, exposure_s=100e-6)
        places = set()
        tracemalloc.start()
        try:
            for number, frame in enumerate(camera.grab(300, on_refused=lambda _error: None)):
                places.add(frame.dn.ctypes.data)
                if number == 100:
                    before, _ = tracemalloc.get_traced_memory()
                    tracemalloc.reset_peak()
            after, peak = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
    # NumPy's allocations are traced: neither a frame is left behind, nor one copied on the way.
    frame_bytes = frame.dn.nbytes
    assert after - before < frame_bytes
    assert peak - before < frame_bytes
    assert len(places) <= pool_size(frame_bytes, 500)
