import gc

import pytest

from labcdp.drivers.aravis.camera import AravisCamera


@pytest.mark.parametrize("name", ["Mono8", "Mono12Packed"])
def test_frames_outlive_grab_and_camera(camera_on_loopback, name):
    with AravisCamera("127.0.0.1") as camera:
        camera.configure(pixel_format=name)
        kept = list(camera.grab(20))
        copies = [frame.dn.copy() for frame in kept]
        list(camera.grab(20))
    gc.collect()
    assert all((frame.dn == copy).all() for frame, copy in zip(kept, copies, strict=True))
