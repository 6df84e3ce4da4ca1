"""The camera's check: each finding from facts that show it, and the whole on a simulated camera."""

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

ETH = Interface("eth1", IPv4Interface("192.168.7.1/24"), mtu_bytes=9000, speed_mbit_s=1000)
MANTA = CameraFacts(
    address="192.168.7.20",
    interface=ETH,
    settings=CameraSettings(0.01, 0.0, "Mono12", 2452, 2056, frame_rate_hz=10.0),
    features={"GevSCPSPacketSize": 8996, "StreamBytesPerSecond": 115_000_000, "GevLinkSpeed": 1000},
    temperature_c=41.0,
    statistics=StreamStatistics(completed=5),
    came=5,
)


def finding(facts, topic):
    (found,) = [one for one in camera_findings(facts) if one.topic == topic]
    return found


def features(**values):
    return replace(MANTA, features={**MANTA.features, **values})


def test_a_camera_in_order():
    found = camera_findings(MANTA)
    assert {one.state for one in found} == {"good"}
    assert [one.topic for one in found] == [
        "controller",
        "network",
        "packet size",
        "link speed",
        "bandwidth",
        "frame rate",
        "temperature",
        "frames",
    ]


def test_a_camera_in_another_network():
    found = finding(replace(MANTA, address="169.254.1.2"), "network")
    assert found.state == "notice"
    assert found.remedy.startswith("sudo ip addr add 169.254.0.10/16 dev eth1")


@pytest.mark.parametrize(
    ("values", "state", "text"),
    [
        ({"GevLinkSpeed": 100}, "notice", "the camera's link runs at 100 Mbit/s"),
        # SFNC DeviceLinkSpeed counts bytes per second.
        ({"GevLinkSpeed": "none", "DeviceLinkSpeed": 125_000_000}, "good", "the camera's link runs at 1000 Mbit/s"),
    ],
)
def test_the_cameras_link(values, state, text):
    found = finding(features(**values), "link speed")
    assert (found.state, found.cause) == (state, text)


def test_a_bandwidth_beyond_the_link():
    # 1 Gbit/s are 125 MB/s on the wire, of which 8996 of 9034 bytes are packets: 124.5 MB/s.
    found = finding(features(StreamBytesPerSecond=124_000_000), "bandwidth")
    assert found.state == "good"
    found = finding(features(StreamBytesPerSecond=125_000_000), "bandwidth")
    assert found.state == "notice"
    assert found.cause == "StreamBytesPerSecond is 125.0 MB/s, and the computer's interface carries 124.5 MB/s"
    # 5 % are left for everything else.
    assert found.remedy == f"set the camera's StreamBytesPerSecond to {0.95 * 125e6 * 8996 / 9034:.0f}"
    sfnc = replace(MANTA, features={"DeviceLinkThroughputLimit": 200_000_000, "GevSCPSPacketSize": 8996})
    assert finding(sfnc, "bandwidth").remedy.startswith("set the camera's DeviceLinkThroughputLimit to ")


def test_frames_that_came_incomplete():
    statistics = StreamStatistics(completed=5, failed=2, underruns=1, resent=4, missing=90)
    found = finding(replace(MANTA, refused=2, statistics=statistics), "frames")
    assert found.state == "notice"
    assert found.cause == ("5 of 5 frames came whole, 2 incomplete (90 packets missing, 4 sent again, 1 underruns)")


# On the wire


#: Settings of another program that opening changes.
LEFT = {
    "ExposureAuto": "Continuous",
    "ReverseX": True,
    "TriggerMode": "On",
    "BinningHorizontal": 2,
    "Width": 20,
    "OffsetX": 4,
    "PixelFormat": "Mono8",
    "StreamBytesPerSecond": 50_000_000,
}


@pytest.mark.parametrize("stream", [False, True])
def test_a_camera_is_left_as_it_was_found(camera_on_loopback, stream):
    def features(camera):
        return {name: value for name, value in camera.features().items() if name != "DeviceTemperature"}

    (info,) = discover()
    with AravisCamera("127.0.0.1") as camera:
        for name, value in LEFT.items():
            camera.set_feature(name, value)
        before = features(camera)
    found = {one.topic: one for one in check_camera(info, interfaces(), stream=stream)}
    assert found["frames"].state == ("good" if stream else "unknown"), found
    assert {"controller", "network", "temperature"} <= found.keys()
    link = connect(info, prepare=False)
    try:
        with link.using("it cannot be read") as opened:
            after = dict(readable_features(opened))
    finally:
        link.close()
    assert {name: after[name] for name in before} == before


def test_a_camera_that_another_program_controls(camera_on_loopback, start_python):
    code = (
        "from labcdp.drivers.aravis.camera import AravisCamera\nimport time\n"
        "with AravisCamera('127.0.0.1'):\n    print('ready')\n    time.sleep(60)"
    )
    other = start_python(code)
    assert other.stdout.readline() == "ready\n"
    found = check_camera(discover()[0], interfaces())
    assert (found[0].topic, found[0].state) == ("controller", "fault")
    assert "another program" in found[0].cause
    assert found[0].remedy
