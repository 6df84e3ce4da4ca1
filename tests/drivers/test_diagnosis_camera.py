"""The camera's check: each finding from facts that show it, and the whole on a simulated camera."""

from dataclasses import replace
from ipaddress import IPv4Interface

import pytest

from labcdp.drivers.aravis_library import CameraInfo, discover
from labcdp.drivers.camera import CameraSettings, FrameTimeoutError, StreamStatistics
from labcdp.drivers.diagnosis import Finding
from labcdp.drivers.diagnosis.camera import CameraFacts, camera_findings, check_camera
from labcdp.drivers.diagnosis.discovery import no_camera_finding
from labcdp.drivers.diagnosis.network import Interface, interfaces

ETH = Interface("eth1", IPv4Interface("192.168.7.1/24"), mtu_bytes=9000, speed_mbit_s=1000)
LO = Interface("lo", IPv4Interface("127.0.0.1/8"), is_loopback=True, mtu_bytes=65536)
MANTA = CameraFacts(
    address="192.168.7.20",
    interface=ETH,
    settings=CameraSettings(0.01, 0.0, "Mono12", 2452, 2056, frame_rate_hz=10.0),
    features={"GevSCPSPacketSize": 8996, "StreamBytesPerSecond": 115_000_000, "GevLinkSpeed": 1000},
    temperature_c=41.0,
    statistics=StreamStatistics(completed=5),
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


def test_what_a_camera_does_not_tell_is_left_out():
    facts = replace(MANTA, features={}, temperature_c=None, settings=replace(MANTA.settings, frame_rate_hz=None))
    assert [one.topic for one in camera_findings(facts)] == ["controller", "network", "frames"]
    # A camera on USB has no network either.
    assert [one.topic for one in camera_findings(replace(facts, address="", interface=None))] == [
        "controller",
        "frames",
    ]


def test_the_interface_is_unknown():
    found = finding(replace(MANTA, interface=None), "network")
    assert (found.state, found.cause) == ("unknown", "no interface of this computer is known to lead to 192.168.7.20")


def test_a_camera_in_another_network():
    found = finding(replace(MANTA, address="169.254.1.2"), "network")
    assert found.state == "notice"
    assert found.remedy.startswith("sudo ip addr add 169.254.0.10/16 dev eth1")


def test_packets_too_large_for_the_interface():
    small = replace(MANTA, interface=replace(ETH, mtu_bytes=1500))
    found = finding(small, "packet size")
    assert (found.state, found.cause) == ("fault", "the camera sends packets of 8996 bytes, but eth1 takes 1500")


def test_small_packets_on_an_interface_with_jumbo_frames():
    found = finding(features(GevSCPSPacketSize=1500), "packet size")
    assert (found.state, found.remedy) == (
        "notice",
        "check that the camera and every switch between take jumbo frames",
    )
    # Loopback takes more than any camera sends.
    assert finding(replace(MANTA, interface=LO, address="127.0.0.1"), "packet size").state == "good"


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


def test_frames_that_need_more_than_the_limit():
    # 10 082 624 bytes in packets that carry 8960 of 8996 bytes: 10.12 MB a frame.
    found = finding(replace(MANTA, settings=replace(MANTA.settings, frame_rate_hz=15.0)), "frame rate")
    assert found.state == "notice"
    assert found.cause == "2452 x 2056 pixels of Mono12 at 15 frames/s need 151.8 MB/s of 115.0 MB/s"
    assert found.remedy == "lower the frame rate to 11.4 frames/s, or take fewer pixels or bits"
    packed = replace(MANTA.settings, pixel_format="Mono12Packed", frame_rate_hz=15.0)
    assert finding(replace(MANTA, settings=packed), "frame rate").state == "good"


def test_the_link_limits_a_camera_without_a_limit_of_its_own():
    slow = replace(MANTA, interface=replace(ETH, speed_mbit_s=100), features={"GevSCPSPacketSize": 8996})
    assert finding(slow, "frame rate").state == "notice"


@pytest.mark.parametrize(("temperature_c", "state"), [(60.0, "good"), (60.1, "notice")])
def test_a_warm_camera(temperature_c, state):
    found = finding(replace(MANTA, temperature_c=temperature_c), "temperature")
    assert found.state == state
    assert found.cause.startswith(f"the camera is at {temperature_c:.1f} degC")


def test_frames_that_came_incomplete():
    statistics = StreamStatistics(completed=5, failed=2, underruns=1, resent=4, missing=90)
    found = finding(replace(MANTA, refused=2, statistics=statistics), "frames")
    assert found.state == "notice"
    assert found.cause == ("5 of 5 frames came whole, 2 incomplete (90 packets missing, 4 sent again, 1 underruns)")


def test_no_frames():
    error = FrameTimeoutError("no frame came within 2.0 s: check the trigger")
    assert finding(replace(MANTA, came=0, problem=error, statistics=StreamStatistics()), "frames") == Finding(
        "frames",
        "fault",
        "0 of 5 frames came whole, 0 incomplete (0 packets missing, 0 sent again, 0 underruns); no frame came within "
        "2.0 s",
        "check the trigger",
    )


@pytest.mark.parametrize("way", [[LO], [], [replace(ETH, has_link=False)], [replace(ETH, is_up=False)]])
def test_no_camera_where_no_way_leads_to_one(way):
    found = no_camera_finding(way, "ufw", "notice")
    assert (found.topic, found.state) == ("discovery", "notice")
    assert found.cause == "no camera answers, and no network interface with an IPv4 address has a link"


def test_no_camera_behind_a_good_interface():
    found = no_camera_finding([LO, ETH], None, "fault")
    assert (found.state, found.cause) == ("fault", "no camera answers at eth1 (192.168.7.1/24)")
    found = no_camera_finding([LO, ETH], "ufw", "fault")
    assert found.cause.endswith("and the firewall ufw may keep its answer out")
    assert found.remedy.endswith("; then sudo ufw allow proto udp from 192.168.7.0/24")


# On the wire


def test_a_simulated_camera_is_in_order_and_closed_again(camera_on_loopback):
    (info,) = discover()
    for _ in range(2):
        found = check_camera(info, interfaces())
        assert {one.state for one in found} == {"good"}, found
        topics = [one.topic for one in found]
        assert topics[0] == "controller"
        assert topics[-1] == "frames"
        assert {"network", "temperature"} <= set(topics)
    assert found[-1].cause.startswith("5 of 5 frames came whole, 0 incomplete")


def test_a_camera_that_another_program_controls(camera_on_loopback, start_python):
    code = (
        "from labcdp.drivers.aravis_camera import AravisCamera\nimport time\n"
        "with AravisCamera('SIM-1'):\n    print('ready')\n    time.sleep(60)"
    )
    other = start_python(code)
    assert other.stdout.readline() == "ready\n"
    found = check_camera(discover()[0], interfaces())
    assert (found[0].topic, found[0].state) == ("controller", "fault")
    assert "another program" in found[0].cause
    assert found[0].remedy


def test_a_camera_that_loses_packets(camera_on_loopback):
    (info,) = discover()
    camera_on_loopback.set_packet_loss(1.0)
    found = check_camera(info, interfaces(), timeout_s=0.5)
    assert (found[-1].topic, found[-1].state) == ("frames", "fault")
    assert found[-1].remedy
    camera_on_loopback.set_packet_loss(0.0)
    assert check_camera(info, interfaces())[-1].state == "good"


def test_a_camera_that_is_gone(aravis):
    found = check_camera(CameraInfo("A", "B", "GONE-1", "127.0.0.1", "GigEVision"), interfaces())
    assert (found[0].topic, found[0].state) == ("camera", "fault")
    assert "GONE-1" in found[0].cause


def test_the_packets_are_held_against_the_interface_that_leads_to_the_camera(camera_on_loopback):
    (info,) = discover()
    found = check_camera(info, [replace(one, mtu_bytes=100) for one in interfaces()])
    (packets,) = [one for one in found if one.topic == "packet size"]
    assert packets.state == "fault"
    assert packets.cause.endswith("but lo takes 100")
