from dataclasses import astuple, replace

import numpy as np
import pytest

from labcdp.core.frame import Readout
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera import CameraSettingError, FrameTimeoutError
from labcdp.drivers.camera_settings import FREE_RUN, SOFTWARE_TRIGGER, Region, Trigger
from labcdp.drivers.simulated.genicam import standard_features
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera

from ..conftest import SMALL, Ramp


@pytest.fixture(params=["prosilica", "sfnc"])
def camera(aravis, request):
    with (
        SimulatedGigECamera(replace(SMALL, features=standard_features(request.param)), Ramp()),
        AravisCamera("127.0.0.1") as camera,
    ):
        yield camera


def test_all_settings_at_once_are_applied_and_reported(camera):
    settings = camera.configure(
        exposure_s=0.002,
        gain_db=3.5,
        pixel_format="Mono8",
        region=Region(4, 6, 16, 12),
        binning=(2, 2),
        black_level=20,
        frame_rate_hz=40,
        trigger=Trigger("Line1", "FallingEdge"),
    )
    assert settings == camera.settings
    assert (settings.exposure_s, settings.gain_db, settings.pixel_format) == (0.002, 3.5, "Mono8")
    assert astuple(settings.region) == (4, 6, 16, 12)
    assert (settings.readout.binning, settings.black_level) == ((2, 2), 20)
    assert settings.frame_rate_hz == pytest.approx(40)
    assert settings.trigger == Trigger("Line1", "FallingEdge")


def test_a_region_shows_that_part_of_the_sensor(camera):
    whole = camera.snap()
    camera.configure(region=Region(10, 20, 30, 8))
    part = camera.snap()
    np.testing.assert_array_equal(part.dn, whole.dn[20:28, 10:40])
    assert (part.readout, part.readout.sensor_size) == (Readout(10, 20), (64, 48))
    assert whole.dn[part.readout.window_in(part.shape, whole.readout, whole.shape)].shape == part.shape


def test_frames_know_how_the_sensor_is_read_out(camera):
    camera.configure(binning=(2, 1))
    camera.set_feature("ReverseY", True)
    assert camera.snap().readout == Readout(0, 0, binning=(2, 1), mirrored=(False, True))


def test_binning_alone_shows_the_whole_sensor(camera):
    camera.configure(region=Region(10, 20, 30, 8))
    settings = camera.configure(binning=(2, 4))
    assert astuple(settings.region) == (0, 0, 32, 12)
    assert camera.snap().shape == (12, 32)
    assert camera.configure(binning=(1, 1)).width == 64


def test_what_the_camera_does_not_take_is_refused_and_nothing_changed(camera):
    before = camera.configure(exposure_s=0.004, region=Region(2, 4, 32, 16), binning=(1, 2))
    for settings, message in (
        ({"region": Region(0, 0, 65, 48)}, r"width is 65: the camera takes 1 to 64"),
        ({"region": Region(60, 0, 8, 8)}, r"x is 60: the camera takes 0 to 56"),
        ({"region": Region(0, -1, 8, 8)}, r"y is -1: the camera takes 0 to 16"),
        ({"binning": (9, 1)}, r"binning of columns is 9: the camera takes 1 to 4"),
        ({"black_level": 300}, r"black_level is 300: the camera takes 0 to 255"),
        ({"frame_rate_hz": 5000}, r"frame_rate_hz is 5000 Hz: the camera takes .* to 1000 Hz"),
        ({"exposure": 0.01}, r"exposure is no setting: give pixel_format, binning"),
        ({"trigger": Trigger("Line7")}, r"no trigger source 'Line7': choose one of Line1, Software"),
    ):
        with pytest.raises(CameraSettingError, match=r"SIM-1, simulated\): .*" + message):
            camera.configure(**({"exposure_s": 0.008, "pixel_format": "Mono8"} | settings))
        assert camera.settings == before, settings


def test_a_software_trigger_is_sent_for_each_frame(camera):
    camera.configure(trigger=SOFTWARE_TRIGGER, exposure_s=0.001)
    ids = [frame.frame_id for frame in camera.grab(4)]
    assert np.diff(ids).tolist() == [1, 1, 1]
    camera.configure(trigger=FREE_RUN)
    assert len(list(camera.grab(3))) == 3


def test_silence_of_a_trigger_line_is_named(camera):
    camera.configure(trigger=Trigger("Line1"), exposure_s=0.001)
    message = (
        r"no frame came from .* within 0\.5 s, although it answers: it waits for an edge on Line1; check that line"
    )
    with pytest.raises(FrameTimeoutError, match=message):
        camera.snap(timeout_s=0.5)
