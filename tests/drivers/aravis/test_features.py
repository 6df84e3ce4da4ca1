import pytest

from labcdp.drivers.camera import CameraSettingError


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
