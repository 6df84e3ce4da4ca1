"""The camera's check: each finding from facts that show it, and the whole on a simulated camera."""

import re
from dataclasses import replace
from ipaddress import IPv4Interface

import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.aravis.features import readable_features
from labcdp.drivers.aravis.library import discover
from labcdp.drivers.aravis.link import connect
from labcdp.drivers.camera import StreamStatistics
from labcdp.drivers.camera_settings import CameraSettings
from labcdp.drivers.doctor.camera import CameraFacts, camera_findings, check_camera
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
_TOPICS = "controller, network, packet size, link speed, bandwidth, frame rate, temperature, frames"
_COUNTED = StreamStatistics(completed=5, failed=2, underruns=1, resent=4, missing=90)
#: 1 Gbit/s are 125 MB/s on the wire, of which 8996 of 9034 bytes are packets; 5 % are left for everything else.
_SHARE = f"{0.95 * 125e6 * 8996 / 9034:.0f}"


def test_a_camera_in_order():
    found = camera_findings(MANTA)
    assert {one.state for one in found} == {"good"}
    assert ", ".join(one.topic for one in found) == _TOPICS


@pytest.mark.parametrize(
    ("facts", "topic", "state", "text"),
    [
        ({"GevLinkSpeed": 100}, "link speed", "notice", "the camera's link runs at 100 Mbit/s"),
        # SFNC DeviceLinkSpeed counts bytes per second.
        ({"GevLinkSpeed": "none", "DeviceLinkSpeed": 125_000_000}, "link speed", "good", "runs at 1000 Mbit/s"),
        ({"StreamBytesPerSecond": 124_000_000}, "bandwidth", "good", "124.0 MB/s"),
        ({"StreamBytesPerSecond": 125_000_000}, "bandwidth", "notice", "is 125.0 MB/s, and the .* carries 124.5 MB/s"),
        (
            {"StreamBytesPerSecond": 125_000_000},
            "bandwidth",
            "notice",
            f"the camera's StreamBytesPerSecond to {_SHARE}",
        ),
        ({"StreamBytesPerSecond": "none", "DeviceLinkThroughputLimit": 200_000_000}, "bandwidth", "notice", _SHARE),
        ({"address": "169.254.1.2"}, "network", "notice", "sudo ip addr add 169.254.0.10/16 dev eth1"),
        (
            {"refused": 2, "statistics": _COUNTED},
            *(
                "frames",
                "notice",
                r"5 of 5 frames came whole, 2 incomplete \(90 packets missing, 4 sent again, 1 under",
            ),
        ),
    ],
)
def test_each_finding_has_its_cause_and_remedy(facts, topic, state, text):
    own = {name: value for name, value in facts.items() if name in ("address", "refused", "statistics")}
    features = {**MANTA.features, **{name: value for name, value in facts.items() if name not in own}}
    facts = replace(MANTA, features={name: value for name, value in features.items() if value != "none"}, **own)
    (found,) = [one for one in camera_findings(facts) if one.topic == topic]
    assert found.state == state
    assert re.search(text, str(found))


#: Settings of another program that opening changes.
LEFT = {
    "ExposureAuto": "Continuous",
    "ReverseX": True,
    "TriggerMode": "On",
    "TriggerSelector": "AcquisitionStart",
    "BinningHorizontal": 2,
    "Width": 20,
    "OffsetX": 4,
    "PixelFormat": "Mono8",
    "StreamBytesPerSecond": 50_000_000,
}


@pytest.mark.parametrize("stream", [False, True])
def test_a_camera_is_left_as_it_was_found(aravis, stream):
    triggers = {"register": 0x30C0, "choices": {"FrameStart": 0, "AcquisitionStart": 1}}
    with SimulatedGigECamera(replace(SMALL, features=features(TriggerSelector=triggers)), Ramp()):
        require_left_as_found(stream)


def require_left_as_found(stream):
    (info,) = discover()
    with AravisCamera("127.0.0.1") as camera:
        for name, value in LEFT.items():
            camera.set_feature(name, value)
        before = camera.features()
    found = {one.topic: one for one in check_camera(info, interfaces(), stream=stream)}
    assert found["frames"].state == ("good" if stream else "unknown"), found
    assert {"controller", "network", "temperature"} <= found.keys()
    link = connect(info, prepare=False)
    try:
        with link.using("it cannot be read") as opened:
            assert dict(readable_features(opened)) == before
    finally:
        link.close()


def test_a_camera_that_another_program_controls(camera_on_loopback):
    camera_on_loopback.set_faults({"second controller": 0})
    found = check_camera(discover()[0], interfaces())
    assert (found[0].topic, found[0].state) == ("controller", "fault")
    assert "another program" in found[0].cause
    assert found[0].remedy
