import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera import CameraSettingError


@pytest.fixture
def camera(camera_on_loopback):
    with AravisCamera("127.0.0.1") as camera:
        yield camera


def test_features_are_read_by_name_in_their_type(camera):
    assert camera.feature("DeviceTemperature") == 31.5
    assert camera.feature("SensorWidth") == 64
    assert type(camera.feature("SensorWidth")) is int
    assert camera.feature("PixelFormat") == "Mono12"
    assert camera.feature("DeviceModelName") == "Manta_G-505B"


def test_features_are_written_and_what_came_of_it_returned(camera):
    assert camera.set_feature("ExposureTimeAbs", 1234) == 1234.0
    assert camera.settings.exposure_s == pytest.approx(1234e-6)
    assert camera.set_feature("PixelFormat", "Mono8") == "Mono8"
    assert camera.set_feature("Height", 24) == 24
    assert camera.snap().shape == (24, 64)


def test_wrong_values_and_names_are_refused(camera):
    before = camera.features()
    for name, value, message in (
        ("ExposureTimeAbs", 1e9, r"ExposureTimeAbs is 1e\+09: the camera takes 21 to 6e\+07"),
        ("ExposureTimeAbs", "long", r"ExposureTimeAbs takes a number, not 'long'"),
        ("ExposureTimeAbs", True, r"ExposureTimeAbs takes a number, not True"),
        ("Width", 65, r"Width is 65: the camera takes 1 to 64"),
        ("Width", 8.0, r"Width takes a whole number, not 8\.0"),
        ("PixelFormat", "RGB8", r"PixelFormat has no value 'RGB8': choose one of Mono8, Mono12"),
        ("PixelFormat", 3, r"PixelFormat has no value 3: choose one of"),
        ("DeviceTemperature", 20.0, r"DeviceTemperature cannot be written: it is read-only"),
        ("AcquisitionStop", 1, r"AcquisitionStop has no value that could be written: it is a command"),
        ("ExposureTime", 5.0, r"no feature 'ExposureTime' now: did you mean ExposureTimeAbs"),
        ("Qqq", 5.0, r"no feature 'Qqq' now: features\(\) lists"),
    ):
        with pytest.raises(CameraSettingError, match=message):
            camera.set_feature(name, value)
        assert camera.features() == before, name
