import gc

import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.aravis.frames import BufferPool, pool_size


@pytest.mark.parametrize("name", ["Mono8", "Mono12Packed"])
def test_frames_outlive_grab_and_camera(camera_on_loopback, name):
    with AravisCamera("127.0.0.1") as camera:
        camera.configure(pixel_format=name)
        kept = list(camera.grab(20))
        copies = [frame.dn.copy() for frame in kept]
        list(camera.grab(20))
    gc.collect()
    assert all((frame.dn == copy).all() for frame, copy in zip(kept, copies, strict=True))


def test_few_buffers_serve_many_frames(camera, monkeypatch):
    """A busy computer may lose frames of its own, but no buffer is."""
    made, add = [], BufferPool._add
    monkeypatch.setattr(BufferPool, "_add", lambda pool: made.append(add(pool)))
    for frame in camera.grab(60):
        last = frame
    assert len(made) == pool_size(last.dn.nbytes, 50, 60) < 60
