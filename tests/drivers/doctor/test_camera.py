"""The camera's check: each finding from facts that show it, and the whole on a simulated camera."""

import re
from contextlib import closing
from dataclasses import replace
from ipaddress import IPv4Interface

import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.aravis.features import readable_features
from labcdp.drivers.aravis.library import discover
from labcdp.drivers.aravis.link import connect
from labcdp.drivers.camera import StreamStatistics
from labcdp.drivers.camera_settings import CameraSettings
from labcdp.drivers.doctor.camera import CameraFacts, camera_checks, check_camera
from labcdp.drivers.network import Interface, interfaces
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera

from ..conftest import SMALL, Ramp, features

MANTA = CameraFacts(
    address="192.168.7.20",
    interface=Interface("eth1", IPv4Interface("192.168.7.1/24"), mtu_bytes=9000, speed_mbit_s=1000),
    settings=CameraSettings(0.01, 0.0, "Mono12", 2452, 2056, frame_rate_hz=10.0),
    features={"GevSCPSPacketSize": 8996, "StreamBytesPerSecond": 115_000_000, "GevLinkSpeed": 1000},
    temperature_c=41.0,
    statistics=StreamStatistics(completed=5),
    came=5,
)
#: 1 Gbit/s are 125 MB/s on the wire, of which 8996 of 9034 bytes are packets; 5 % are left for everything else.
_SHARE = f"{0.95 * 125e6 * 8996 / 9034:.0f}"


def test_a_camera_in_order_and_one_of_another_network_that_loses_frames():
    assert {one.state for one in camera_checks(MANTA)} == {"good"}
    counted = StreamStatistics(completed=5, failed=2, underruns=1, resent=4, missing=90)
    found = camera_checks(replace(MANTA, address="169.254.1.2", refused=2, statistics=counted))
    assert {one.topic for one in found if one.state == "notice"} == {"network", "frames"}


@pytest.mark.parametrize(
    ("features", "topic", "state", "text"),
    [
        ({"GevLinkSpeed": 100}, "link speed", "notice", "100 Mbit/s"),
        # SFNC DeviceLinkSpeed counts bytes per second.
        ({"GevLinkSpeed": None, "DeviceLinkSpeed": 125_000_000}, "link speed", "good", "1000 Mbit/s"),
        ({"StreamBytesPerSecond": 124_000_000}, "bandwidth", "good", "124.0 MB/s"),
        ({"StreamBytesPerSecond": 125_000_000}, "bandwidth", "notice", f"carries 124.5 MB/s.*{_SHARE}"),
        ({"StreamBytesPerSecond": None, "DeviceLinkThroughputLimit": 200_000_000}, "bandwidth", "notice", _SHARE),
    ],
)
def test_each_finding_has_its_cause_and_remedy(features, topic, state, text):
    features = {name: value for name, value in (MANTA.features | features).items() if value is not None}
    (found,) = [one for one in camera_checks(replace(MANTA, features=features)) if one.topic == topic]
    assert found.state == state
    assert re.search(text, str(found))


#: Settings of another program that opening changes.
LEFT = {"ExposureAuto": "Continuous", "ReverseX": True, "TriggerMode": "On", "BinningHorizontal": 2, "Width": 20}
LEFT |= {
    "TriggerSelector": "AcquisitionStart",
    "OffsetX": 4,
    "PixelFormat": "Mono8",
    "StreamBytesPerSecond": 50_000_000,
}


@pytest.mark.parametrize("stream", [False, True])
def test_a_camera_is_left_as_it_was_found(aravis, stream):
    triggers = {"register": 0x30C0, "choices": {"FrameStart": 0, "AcquisitionStart": 1}}
    with SimulatedGigECamera(replace(SMALL, features=features(TriggerSelector=triggers)), Ramp()):
        (info,) = discover()
        with AravisCamera("127.0.0.1") as camera:
            for name, value in LEFT.items():
                camera.set_feature(name, value)
            before = camera.features()
        found = {one.topic: one for one in check_camera(info, interfaces(), stream=stream)}
        assert found["frames"].state == ("good" if stream else "unknown"), found
        with closing(connect(info, prepare=False)) as link, link.using("it cannot be read") as opened:
            assert dict(readable_features(opened)) == before


def test_a_camera_that_another_program_controls(camera_on_loopback):
    (info,) = discover()
    with AravisCamera(info.address):
        found = check_camera(info, interfaces())
    assert (found[0].topic, found[0].state) == ("controller", "fault")
