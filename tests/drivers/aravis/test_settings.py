from dataclasses import astuple

import numpy as np
import pytest

from labcdp.core.frame import Readout
from labcdp.drivers.camera import CameraSettingError, FrameTimeoutError
from labcdp.drivers.camera_settings import FREE_RUN, SOFTWARE_TRIGGER, Region, Trigger


@pytest.mark.parametrize("camera", ["prosilica", "sfnc"], indirect=True)
def test_all_settings_at_once_are_applied_and_reported(camera):
    wanted = {"exposure_s": 0.002, "gain_db": 3.5, "pixel_format": "Mono8", "region": Region(4, 6, 16, 12)}
    wanted |= {"binning": (2, 2), "black_level": 20, "frame_rate_hz": 40, "trigger": Trigger("Line1", "FallingEdge")}
    settings = camera.configure(**wanted)
    assert settings == camera.settings
    applied = {name: getattr(settings, name) for name in wanted}
    assert applied == wanted | {"frame_rate_hz": pytest.approx(40)}


def test_region_binning_mirror_and_black_level_reach_the_pixels_and_the_readout(camera):
    whole = camera.snap()
    camera.configure(region=Region(10, 20, 30, 8))
    part = camera.snap()
    np.testing.assert_array_equal(part.dn, whole.dn[20:28, 10:40])
    assert (part.readout, part.readout.sensor_size) == (Readout(10, 20), (64, 48))
    assert whole.dn[part.readout.window_in(part.shape, whole.readout, whole.shape)].shape == part.shape
    # Binning alone shows the whole sensor.
    assert astuple(camera.configure(binning=(2, 4)).region) == (0, 0, 32, 12)
    camera.configure(region=Region(3, 1, 16, 8), black_level=27)
    camera.set_feature("ReverseX", True)
    binned = camera.snap()
    assert binned.readout == Readout(3, 1, binning=(2, 4), mirrored=(True, False))
    # Columns 6 and 7 of the ramp average to 6.5, rounded up; black level raised from 7 to 27.
    np.testing.assert_array_equal(binned.dn, np.tile(np.arange(3, 19)[::-1] * 2 + 1 + 20, (8, 1)))


def test_what_the_camera_does_not_take_is_refused_and_nothing_changed(camera):
    before = camera.configure(exposure_s=0.004, region=Region(2, 4, 32, 16), binning=(1, 2))
    for wrong in (
        *({"region": region} for region in (Region(0, 0, 65, 48), Region(60, 0, 8, 8), Region(0, -1, 8, 8))),
        *({"binning": (9, 1)}, {"frame_rate_hz": 5000}, {"trigger": Trigger("Line7")}, {"exposure": 0.01}),
    ):
        with pytest.raises(CameraSettingError):
            camera.configure(**({"exposure_s": 0.008, "pixel_format": "Mono8"} | wrong))
        assert camera.settings == before, wrong


def test_a_software_trigger_is_sent_for_each_frame_and_silence_of_a_line_is_named(camera):
    camera.configure(trigger=SOFTWARE_TRIGGER, exposure_s=0.3)
    frames = list(camera.grab(3))
    assert np.diff([frame.frame_id for frame in frames]).tolist() == [1, 1]
    # Each begins with its trigger, and is not there sooner than its exposure has passed.
    assert (frames[-1].timestamp - frames[0].timestamp).total_seconds() >= 2 * 0.29
    camera.configure(trigger=Trigger("Line1"), exposure_s=0.001)
    silence = (
        r"no frame came from .* within 0\.2 s, although it answers: it waits for an edge on Line1; check that line"
    )
    with pytest.raises(FrameTimeoutError, match=silence):
        camera.snap(timeout_s=0.2)
    camera.configure(trigger=FREE_RUN)
    assert len(list(camera.grab(3))) == 3


def test_features_are_read_and_written_by_name_in_their_type(camera):
    values = [camera.feature(name) for name in ("DeviceTemperature", "SensorWidth", "PixelFormat", "ReverseX")]
    assert [(type(value), value) for value in values] == [(float, 31.5), (int, 64), (str, "Mono12"), (bool, False)]
    assert camera.set_feature("ExposureTimeAbs", 1234) == 1234.0
    assert camera.settings.exposure_s == pytest.approx(1234e-6)
    assert camera.set_feature("PixelFormat", "Mono8") == "Mono8"
    assert camera.set_feature("Height", 24) == 24
    assert camera.snap().shape == (24, 64)


def test_wrong_values_and_names_are_refused(camera):
    before = camera.features()
    for name, value in (
        *(("ExposureTimeAbs", 1e9), ("ExposureTimeAbs", True), ("Width", 8.0), ("PixelFormat", "RGB8")),
        *(("DeviceTemperature", 20.0), ("ExposureTime", 5.0)),
    ):
        with pytest.raises(CameraSettingError, match=name):
            camera.set_feature(name, value)
        assert camera.features() == before, name
