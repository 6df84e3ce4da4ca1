import gc
import threading
import tracemalloc

import numpy as np
import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.aravis.frames import Loan, pool_size
from labcdp.drivers.simulated.gige_camera import SimulatedDevice, SimulatedGigECamera

from ..conftest import Ramp


@pytest.mark.parametrize("name", ["Mono8", "Mono12Packed"])
def test_frames_outlive_grab_and_camera(camera_on_loopback, name):
    with AravisCamera("127.0.0.1") as camera:
        camera.configure(pixel_format=name)
        kept = list(camera.grab(20))
        copies = [frame.dn.copy() for frame in kept]
        list(camera.grab(20))
    gc.collect()
    assert all((frame.dn == copy).all() for frame, copy in zip(kept, copies, strict=True))


def test_frames_dropped_in_another_thread_return_their_buffers(camera):
    waiting, stop, places = [], threading.Event(), []

    def drop():
        while not stop.wait(0.001):
            waiting.clear()

    thread = threading.Thread(target=drop)
    thread.start()
    try:
        for frame in camera.grab(60):
            places.append(frame.dn.ctypes.data)
            waiting.append(frame)
    finally:
        stop.set()
        thread.join()
    # A busy computer may lose frames of its own; but no buffer is, as few of them serve all frames.
    assert len(places) == 60 > len(set(places))


@pytest.mark.parametrize(("name", "n"), [("Mono8", 120), pytest.param("Mono16", 300, marks=pytest.mark.long)])
def test_memory_is_flat_and_frames_are_not_copied(aravis, name, n):
    device = SimulatedDevice("SIM-1", width=256, height=256, frame_rate_hz=200)
    with SimulatedGigECamera(device, Ramp((256, 256))), AravisCamera("127.0.0.1") as camera:
        camera.configure(pixel_format=name, exposure_s=100e-6)
        places = set()
        tracemalloc.start()
        try:
            for number, frame in enumerate(camera.grab(n, on_refused=lambda _error: None)):
                places.add(frame.dn.ctypes.data)
                if number == n // 3:
                    before, _ = tracemalloc.get_traced_memory()
            after, _ = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
    # NumPy's allocations are traced. The simulated camera renders two frames ahead, in three steps each.
    assert after - before < 6 * 2 * 256 * 256
    base = frame.dn
    while isinstance(base, np.ndarray):
        base = base.base
    assert isinstance(base, Loan)
    assert len(places) <= pool_size(frame.dn.nbytes, 200, n)
