import gc
import os
import threading
from dataclasses import replace
from ipaddress import IPv4Interface
from itertools import chain, repeat

import numpy as np
import pytest

from labcdp.core.frame import CameraIdentity
from labcdp.drivers import camera_settings
from labcdp.drivers.aravis import stream
from labcdp.drivers.aravis import transport as aravis_transport
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.aravis.library import CameraInfo, choose, discover
from labcdp.drivers.aravis.link import connect
from labcdp.drivers.camera import CameraError, CameraNotFoundError, CameraSettingError, FrameTimeoutError
from labcdp.drivers.camera_settings import Region, Trigger
from labcdp.drivers.network import Interface
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera

from ..conftest import SMALL, Ramp, features, opened


def test_opens_by_serial_number_or_model_or_as_the_only_one(camera_on_loopback):
    names = ("Allied Vision Technologies", "Manta_G-505B", "SIM-1")
    for selector in (None, *names[1:]):
        with AravisCamera(selector) as camera:
            assert camera.identity == CameraIdentity(*names, simulated=True)
    with pytest.raises(CameraNotFoundError, match=r"no camera 'DEV-9'"):
        AravisCamera("DEV-9").open()
    two = [CameraInfo("V", "M", serial, f"10.0.0.{serial}", "GigEVision") for serial in ("1", "2")]
    with pytest.raises(CameraNotFoundError, match="more than one camera"):
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


@pytest.mark.parametrize("name", ["Mono8", "Mono12Packed"])
def test_frames_outlive_grab_and_camera(camera_on_loopback, name):
    with AravisCamera("127.0.0.1") as camera:
        camera.configure(pixel_format=name)
        kept = list(camera.grab(20))
        copies = [frame.dn.copy() for frame in kept]
        list(camera.grab(20))
    gc.collect()
    assert all((frame.dn == copy).all() for frame, copy in zip(kept, copies, strict=True))


def test_opening_resets_what_another_program_left(camera_on_loopback):
    """Modes, too; see the real cameras."""
    left = {"ReverseX": True, "ReverseY": True, "LUTEnable": True, "ExposureMode": "TriggerWidth"}
    part = {"Width": 32, "Height": 24, "OffsetX": 16, "OffsetY": 12, "TriggerMode": "On"}
    with AravisCamera("127.0.0.1") as camera:
        upright, now = camera.snap().dn, {name: camera.feature(name) for name in left}
        for name, value in (left | part).items():
            assert camera.set_feature(name, value) == value
            if name == "ReverseY":
                # The first row carries what differs from frame to frame.
                np.testing.assert_array_equal(camera.snap().dn[:-1], upright[1:][::-1, ::-1])
    with AravisCamera("127.0.0.1") as camera:
        np.testing.assert_array_equal(camera.snap().dn[1:], upright[1:])
        assert {name: camera.feature(name) for name in left} == now


#: Features that a camera need not have, beside those that some real one lacks.
_OPTIONAL = ("DeviceVendorName", "DeviceModelName", "DeviceManufacturerInfo", "DeviceID", "SensorWidth", "SensorHeight")


def test_opens_and_grabs_without_features_that_a_camera_need_not_have(aravis):
    size = {f"{of}Max": {"register": f"SENSOR_{of.upper()}", "access": "RO"} for of in ("Width", "Height")}
    with opened(features=features(*_OPTIONAL, **size)) as camera:
        assert not set(_OPTIONAL) & set(camera.features())
        assert camera.snap().shape == (48, 64)


def test_gamma_that_cannot_be_switched_off_is_refused_and_the_camera_released(aravis):
    gamma = {"register": 0x150, "unit": "", "steps": 100, "range": [0.25, 4], "value": 45, "access": "RO"}
    with SimulatedGigECamera(replace(SMALL, features=features(Gamma=gamma)), Ramp()):
        for _ in range(2):
            with pytest.raises(CameraSettingError, match=r"Gamma is 0\.45"):
                AravisCamera("127.0.0.1").open()


def test_each_frame_has_the_temperature_of_its_time(aravis, monkeypatch):
    monkeypatch.setattr(stream, "_TEMPERATURE_EVERY_S", 0.0)
    warming = iter(range(200, 1200))
    served = SimulatedGigECamera(SMALL, Ramp(), temperature=lambda: next(warming) / 10)
    with served, AravisCamera("127.0.0.1") as camera:
        seen = [frame.temperature_c for frame in camera.grab(20)]
    assert seen == sorted(seen)
    assert len(set(seen)) > 5


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


def test_a_computer_that_becomes_busy_while_a_frame_is_waited_for_gets_more_time(camera, monkeypatch):
    loads = chain([0.0], repeat(5.0 * os.cpu_count()))
    monkeypatch.setattr("os.getloadavg", lambda: (next(loads), 0.0, 0.0))
    monkeypatch.setattr(camera_settings, "FRAME_ALLOWANCE_S", 0.1)
    camera.configure(trigger=Trigger("Line1"), exposure_s=0.2)
    # Exposure, and as many times 0.1 s as processes wait for each processor.
    with pytest.raises(FrameTimeoutError, match=r"within 0\.7 s"):
        camera.snap()


# What becomes of a camera that is lost, taken, or sends what it should not


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


# Its packets, and its share of the network


_GIGABIT = Interface("eth0", IPv4Interface("169.254.0.10/16"), mtu_bytes=1500, speed_mbit_s=1000)


def test_two_cameras_share_their_interface(aravis, monkeypatch):
    monkeypatch.setattr(aravis_transport, "interface_to", lambda _address, _known: replace(_GIGABIT, name="lo"))

    def shares(*cameras):
        for camera in cameras:
            camera.snap()
        return [camera.feature("StreamBytesPerSecond") for camera in cameras]

    with opened() as first:
        (alone,) = shares(first)
        other = SimulatedGigECamera(replace(SMALL, serial="SIM-2"), Ramp(), "127.0.0.2")
        with other, AravisCamera("SIM-2") as second:  # plugged in later
            # A camera that answers too late, on a busy computer, is seen at a later start.
            assert any(shares(first, second) == [alone // 2] * 2 for _ in range(100))
        assert any(shares(first) == [alone] for _ in range(100))


@pytest.mark.parametrize(
    ("camera", "bandwidth"),
    [("prosilica", "StreamBytesPerSecond"), ("sfnc", "DeviceLinkThroughputLimit")],
    indirect=["camera"],
)
def test_the_plan_is_carried_out_except_what_the_user_has_set(camera, bandwidth, monkeypatch):
    # As if the camera were behind a network card.
    narrow = replace(_GIGABIT, mtu_bytes=4000)
    monkeypatch.setattr(aravis_transport, "interface_to", lambda _address, _known: narrow)
    camera.snap()
    features = camera.features()
    assert (features["GevSCPSPacketSize"], features["GevSCPD"]) == (4000, 0)
    assert features[bandwidth] == int(125e6 * 4000 / 4038 * 0.95)
    assert features.get("DeviceLinkThroughputLimitMode", "On") == "On"
    chosen = {bandwidth: 50_000_000, "GevSCPSPacketSize": 1500}
    for name, value in chosen.items():
        camera.set_feature(name, value)
    camera.snap()
    assert {name: camera.feature(name) for name in chosen} == chosen
