import os
import subprocess
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from labcdp.core.errors import InputError
from labcdp.core.frame import CameraIdentity
from labcdp.drivers.aravis import stream
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.aravis.connection import Connection
from labcdp.drivers.aravis.library import CameraInfo, choose, discover
from labcdp.drivers.aravis.link import connect
from labcdp.drivers.camera import CameraError, CameraNotFoundError, CameraSettingError
from labcdp.drivers.camera_settings import FRAME_ALLOWANCE_S, CameraSettings
from labcdp.drivers.computer import overload
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera

from ..conftest import SMALL, Ramp, features, opened


def test_opens_by_serial_number_or_model_or_as_the_only_one(camera_on_loopback):
    names = ("Allied Vision Technologies", "Manta_G-505B", "SIM-1")
    for selector in (None, *names[1:]):
        with AravisCamera(selector) as camera:
            assert camera.identity == CameraIdentity(*names, simulated=True)
    assert discover() == [CameraInfo(*names, "127.0.0.1", "GigEVision", "-".join(names))]
    with pytest.raises(CameraNotFoundError, match=r"no camera 'DEV-9' .* answers; found: .*serial SIM-1.*check power"):
        AravisCamera("DEV-9").open()
    two = [CameraInfo("V", "M", serial, f"10.0.0.{serial}", "GigEVision") for serial in ("1", "2")]
    with pytest.raises(CameraNotFoundError, match=r"more than one camera 'M' .*give a serial number"):
        choose(two, "M")


def test_another_camera_at_the_same_address_is_refused(camera_on_loopback):
    (info,) = discover()
    with pytest.raises(CameraNotFoundError, match=r"has serial number SIM-1, not SIM-2: two cameras share the address"):
        connect(replace(info, serial="SIM-2"))


def test_frames_carry_pixels_and_all_metadata_in_each_format(camera):
    frames = {}
    for name in ("Mono8", "Mono12", "Mono12Packed", "Mono16"):
        camera.configure(exposure_s=0.002, gain_db=3.5, pixel_format=name)
        frames[name] = camera.snap()
    frame = frames["Mono12"]
    assert (frame.shape, frame.dn[0, :2].tolist()) == ((48, 64), [2000, 35])
    np.testing.assert_array_equal(frame.dn[1], np.arange(64))
    np.testing.assert_array_equal(frames["Mono12Packed"].dn[1:], frame.dn[1:])
    # A 12-bit sensor drops its last four bits in an 8-bit format.
    np.testing.assert_array_equal(frames["Mono8"].dn[1:], frame.dn[1:] >> 4)
    assert (frame.exposure_s, frame.gain_db, frame.temperature_c) == (0.002, 3.5, 31.5)
    assert (frame.bit_depth, frame.saturation_dn, frame.pixel_format, frame.colour_filter) == (12, 4095, "Mono12", None)
    # The register is in units of its own, and no DN.
    assert {(one.black_level_dn, one.black_level_register) for one in frames.values()} == {(None, 7)}


def test_every_frame_is_taken_after_the_last_change_and_none_changes_under_a_grab(camera):
    for exposure_us in range(1000, 1005):
        applied = camera.configure(exposure_s=exposure_us * 1e-6)
        frame = camera.snap()
        assert frame.dn[0, 0] == exposure_us
        assert frame.exposure_s == applied.exposure_s == pytest.approx(exposure_us * 1e-6, rel=1e-9)
    frames = camera.grab(20)
    next(frames)
    with pytest.raises(CameraError, match=r"still grabbing: finish that loop, .* before a change of settings"):
        camera.configure(exposure_s=0.003)
    with pytest.raises(CameraError, match=r"still grabbing.* before another grab"):
        camera.snap()
    frames.close()
    camera.configure(exposure_s=0.003)
    assert camera.snap().dn[0, 0] == 3000


def test_impossible_times_are_refused(camera):
    for wrong_s in (-1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match=r"timeout_s is .*: give 0 to 86400 seconds"):
            camera.snap(wrong_s)
        with pytest.raises(InputError, match=r"patience_s is .*: give 0 or more seconds"):
            AravisCamera("127.0.0.1", patience_s=wrong_s)


def test_opening_resets_what_another_program_left(camera_on_loopback):
    left = {"ReverseX": True, "ReverseY": True, "LUTEnable": True, "ExposureMode": "TriggerWidth"}
    left |= dict.fromkeys(("BlackLevelAuto", "GainAuto", "ExposureAuto"), "Continuous")
    part = {"Width": 32, "Height": 24, "OffsetX": 16, "OffsetY": 12, "TriggerMode": "On"}
    with AravisCamera("127.0.0.1") as camera:
        upright = camera.snap().dn
        for name, value in left.items():
            assert camera.set_feature(name, value) == value
        # The first row carries what differs from frame to frame.
        np.testing.assert_array_equal(camera.snap().dn[:-1], upright[1:][::-1, ::-1])
        for name, value in part.items():
            camera.set_feature(name, value)
    with AravisCamera("127.0.0.1") as camera:
        now = {name: camera.feature(name) for name in left}
        np.testing.assert_array_equal(camera.snap().dn[1:], upright[1:])
    right = {"ReverseX": False, "ReverseY": False, "LUTEnable": False, "ExposureMode": "Timed"}
    assert now == right | dict.fromkeys(("BlackLevelAuto", "GainAuto", "ExposureAuto"), "Off")


#: Groups of features that a camera need not have.
_OPTIONAL = [
    ("DeviceVendorName", "DeviceModelName", "DeviceManufacturerInfo", "DeviceID"),
    ("SensorWidth", "SensorHeight"),
    ("OffsetX", "OffsetY", "ReverseX", "ReverseY"),
    ("AcquisitionFrameRateAbs", "ExposureAuto", "ExposureMode"),
    ("TriggerSelector", "TriggerMode", "TriggerSource", "TriggerActivation", "TriggerSoftware"),
    ("BinningHorizontal", "BinningVertical", "BinningHorizontalMode", "BinningVerticalMode"),
    ("Gain", "GainAuto", "BlackLevel", "Gamma", "ExposureAuto", "DeviceTemperature"),
]


@pytest.mark.parametrize(
    "missing",
    [tuple(dict.fromkeys(chain(*_OPTIONAL))), *(pytest.param(one, marks=pytest.mark.long) for one in _OPTIONAL)],
)
def test_opens_and_grabs_without_features_that_a_camera_need_not_have(aravis, missing):
    size = {f"{of}Max": {"register": f"SENSOR_{of.upper()}", "access": "RO"} for of in ("Width", "Height")}
    with opened(features=features(*missing, **size)) as camera:
        assert not set(missing) & set(camera.features())
        assert camera.snap().shape == (48, 64)


def test_an_opening_that_fails_releases_the_camera(camera_on_loopback, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(Connection, "remember_settings", lambda self: 1 / 0)
        with pytest.raises(ZeroDivisionError) as error:
            AravisCamera("127.0.0.1").open()
    # Even while the traceback keeps all that was made.
    assert error.tb is not None
    with AravisCamera("127.0.0.1") as camera:
        assert camera.snap().shape == (48, 64)


def test_each_frame_has_the_temperature_of_its_time(aravis, monkeypatch):
    monkeypatch.setattr(stream, "_TEMPERATURE_EVERY_S", 0.0)
    warming = iter(range(200, 1200))
    served = SimulatedGigECamera(SMALL, Ramp(), temperature=lambda: next(warming) / 10)
    with served, AravisCamera("127.0.0.1") as camera:
        seen = [frame.temperature_c for frame in camera.grab(20)]
    assert seen == sorted(seen)
    assert len(set(seen)) > 5


def test_a_busy_computer_gets_more_time(monkeypatch):
    settings = CameraSettings(2.0, 0.0, "Mono12", 64, 48, frame_rate_hz=0.5)
    for load, factor in ((0.1, 1), (5.0 * os.cpu_count(), 5)):
        monkeypatch.setattr("os.getloadavg", lambda load=load: (load, 0.0, 0.0))
        assert settings.longest_wait_s(None, overload()) == 2.0 + 2.0 + factor * FRAME_ALLOWANCE_S
    assert settings.longest_wait_s(0.5, overload()) == 2.5


def test_the_thread_that_receives_has_priority_where_that_is_permitted(camera):
    own = os.getpriority(os.PRIO_PROCESS, 0)
    permitted = subprocess.run(["nice", "-n", "-1", "true"], capture_output=True, text=True).stderr == ""
    frames = camera.grab(2)
    next(frames)
    threads = {int(path.name): (path / "comm").read_text().strip() for path in Path("/proc/self/task").iterdir()}
    priorities = {os.getpriority(os.PRIO_PROCESS, n) for n, name in threads.items() if name == "arv_gv_stream"}
    frames.close()
    assert priorities == {-10 if permitted else own}
    assert os.getpriority(os.PRIO_PROCESS, 0) == own


def test_what_changes_the_dn_and_cannot_be_switched_off_is_refused(aravis):
    gamma = {"register": 0x150, "unit": "", "steps": 100, "range": [0.25, 4], "value": 45, "access": "RO"}
    with pytest.raises(CameraSettingError, match=r"Gamma is 0\.45"), opened(features=features(Gamma=gamma)):
        pass


def test_a_camera_without_exposure_time_says_so(aravis):
    missing = pytest.raises(CameraSettingError, match="the camera has none of ExposureTime, ExposureTimeAbs, Exp")
    with opened(features=features("ExposureTimeAbs")) as camera, missing:
        camera.snap()


def test_a_camera_that_is_not_on_a_network_is_opened_by_serial_number(aravis):
    """Aravis' own fake camera, whose name for opening is not its serial number, as with USB3 Vision."""
    aravis.enable_interface("Fake")
    try:
        (info,) = discover()
        assert (info.protocol, info.serial, info.device_id) == ("Fake", "1", "Fake_1")
        with AravisCamera("1") as camera:
            assert camera.identity.simulated
            assert camera.snap().shape == (camera.settings.height, camera.settings.width)
    finally:
        aravis.disable_interface("Fake")
