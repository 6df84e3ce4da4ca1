"""What becomes of a camera that is lost, taken, or sends what it should not."""

import threading
from dataclasses import replace

import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera import CameraSettingError
from labcdp.drivers.camera_settings import Region

from ..conftest import SMALL, features


@pytest.fixture
def trouble(camera_on_loopback):
    """Begin a trouble that lasts some seconds."""
    timers = []

    def begin(fault, duration_s):
        camera_on_loopback.set_faults({fault: 0})
        timers.append(threading.Timer(duration_s, camera_on_loopback.set_faults, [{}]))
        timers[-1].start()

    yield begin
    for timer in timers:
        timer.join()


def test_settings_of_another_program_are_restored_after_a_power_cut(camera_on_loopback, trouble):
    """A camera keeps settings until it is switched off, and a program that reads them relies on them."""
    with AravisCamera("127.0.0.1") as earlier:
        earlier.configure(pixel_format="Mono8", gain_db=6.0, black_level=50)
    with AravisCamera("127.0.0.1", patience_s=60) as camera:
        before = camera.configure(binning=(2, 2), region=Region(4, 2, 16, 12))
        camera.set_feature("ExposureTimeAbs", 3000)
        everything = camera.features()
        frames = camera.grab(6)
        taken = [next(frames)]
        trouble("vanish", 1.0)
        taken.extend(frames)
        assert len(camera.gaps) == 1
        assert camera.settings == replace(before, exposure_s=0.003)
        assert camera.features() == everything
    assert (before.pixel_format, before.gain_db, before.black_level) == ("Mono8", 6.0, 50)
    assert {(one.shape, one.pixel_format, one.gain_db, one.bit_depth) for one in taken} == {((12, 16), "Mono8", 6.0, 8)}


def test_a_camera_that_comes_back_with_another_setting_is_refused(camera_on_loopback, trouble):
    with AravisCamera("127.0.0.1") as earlier:
        earlier.configure(black_level=50)
    with AravisCamera("127.0.0.1", patience_s=60) as camera:
        frames = camera.grab(20)
        next(frames)
        # A replaced or reset device: what it had is out of its range now.
        other = {"register": "BLACK_LEVEL", "unit": "DN", "steps": 1, "range": [8, 9]}
        camera_on_loopback.device = replace(SMALL, features=features(BlackLevel=other))
        trouble("vanish", 1.0)
        with pytest.raises(CameraSettingError, match=r"has other settings than before.*BlackLevel = 7.0, not 50.0"):
            list(frames)


def test_a_short_silence_is_bridged(camera_on_loopback, trouble):
    """0.8 s without an answer: Aravis' own requests are repeated for 2.5 s and succeed."""
    with AravisCamera("127.0.0.1") as camera:
        frames = camera.grab(30, on_refused=lambda _: None)  # the silence may begin within a frame
        next(frames)
        trouble("freeze", 0.8)
        assert len(list(frames)) == 29
        assert camera.gaps == ()
