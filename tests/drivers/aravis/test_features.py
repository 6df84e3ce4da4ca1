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
    for name, value, message in (
        ("ExposureTimeAbs", 1e9, r"ExposureTimeAbs is 1e\+09: the camera takes 21 to 6e\+07"),
        ("ExposureTimeAbs", True, r"ExposureTimeAbs takes a number, not True"),
        ("Width", 8.0, r"Width takes a whole number, not 8\.0"),
        ("PixelFormat", "RGB8", r"PixelFormat has no value 'RGB8': choose one of Mono8, Mono12"),
        ("DeviceTemperature", 20.0, r"DeviceTemperature cannot be written: it is read-only"),
        ("ExposureTime", 5.0, r"no feature 'ExposureTime' now: did you mean ExposureTimeAbs"),
    ):
        with pytest.raises(CameraSettingError, match=message):
            camera.set_feature(name, value)
        assert camera.features() == before, name
