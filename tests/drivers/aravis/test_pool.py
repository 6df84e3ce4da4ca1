import gc
import threading

import numpy as np
import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.aravis.frames import BufferPool, Loan, pool_size


@pytest.mark.parametrize("name", ["Mono8", "Mono12Packed"])
def test_frames_outlive_grab_and_camera(camera_on_loopback, name):
    with AravisCamera("127.0.0.1") as camera:
        camera.configure(pixel_format=name)
        kept = list(camera.grab(20))
        copies = [frame.dn.copy() for frame in kept]
        list(camera.grab(20))
    gc.collect()
    assert all((frame.dn == copy).all() for frame, copy in zip(kept, copies, strict=True))


def test_frames_are_not_copied_and_their_buffers_return_from_any_thread(camera, monkeypatch):
    waiting, stop, made, add = [], threading.Event(), [], BufferPool._add
    monkeypatch.setattr(BufferPool, "_add", lambda pool: made.append(add(pool)))

    def drop():
        while not stop.wait(0.001):
            waiting.clear()

    thread = threading.Thread(target=drop)
    thread.start()
    try:
        for frame in camera.grab(60):
            waiting.append(frame)
    finally:
        stop.set()
        thread.join()
    base = frame.dn
    while isinstance(base, np.ndarray):
        base = base.base
    assert isinstance(base, Loan)
    # A busy computer may lose frames of its own; but no buffer is, as few of them serve all frames.
    assert len(made) == pool_size(frame.dn.nbytes, 50, 60) < 60
