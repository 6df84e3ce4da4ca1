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
from labcdp.drivers.doctor.link import (
    PlannedStream,
    carried_bytes_per_s,
    frame_rate_hz,
    plan_check,
    planned_stream,
)
from labcdp.drivers.network import Interface, interfaces, resend_check
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera
from labcdp.session import SessionConfiguration, example_configuration

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


GIGE = carried_bytes_per_s(1500, 1000)
SENSOR = (2056, 2452)


@pytest.mark.parametrize(
    ("mtu", "megabytes", "rates"),
    [
        (1500, 119.0, {"Mono12": 11.8, "Mono12Packed": 15.7, "Mono8": 23.6}),
        (9000, 124.0, {"Mono12": 12.3, "Mono12Packed": 16.4}),
    ],
)
def test_what_gigabit_ethernet_carries_of_a_manta(mtu, megabytes, rates):
    """Each packet of the MTU takes 38 bytes more on the wire and has 36 bytes of headers."""
    carried = carried_bytes_per_s(mtu, 1000)
    assert round(carried / 1e6, 1) == megabytes
    assert {name: round(frame_rate_hz(name, SENSOR, carried), 1) for name in rates} == rates


OFFERED = ("Mono8", "Mono12", "Mono12Packed", "BayerRG12", "Unknown14")


@pytest.mark.parametrize(
    ("planned", "state", "text"),
    [
        (PlannedStream("Mono12", 11.0), "good", r"2452 x 2056 pixels of Mono12 at 11 frames/s, 110.9 MB/s"),
        (
            PlannedStream("Mono12"),
            "notice",
            r'119.0 MB/s of pixels: 11.8 frames/s: give pixel_format = "Mono12Packed" \(15.7',
        ),
        (
            PlannedStream("Mono12", 20.0),
            "notice",
            r"or frame_rate_hz = 11.8 in \[camera\], or a region of at most 12\d\d rows",
        ),
        (PlannedStream("Mono12Packed", 20.0), "notice", r"give frame_rate_hz = 15.7 in"),
        (PlannedStream("Mono12", 20.0, (1000, 2452)), "good", "2452 x 1000 pixels"),
        (PlannedStream("Unknown14", 20.0), None, ""),
    ],
)
def test_a_plan_is_told_what_fits(planned, state, text):
    check = plan_check(planned, SENSOR, 15.0, GIGE, OFFERED)
    assert (check and check.state) == state
    assert re.search(text, str(check))


def test_the_template_asks_for_what_gigabit_ethernet_carries():
    planned = planned_stream(SessionConfiguration.from_toml(example_configuration(), "example"))
    assert plan_check(planned, SENSOR, None, GIGE, OFFERED).state == "good"


def test_the_doctor_looks_at_the_plan_and_at_the_path():
    facts = replace(MANTA, planned=PlannedStream("Mono12", 15.0), formats=OFFERED, path_bytes=1500)
    checks = {check.topic: check for check in camera_checks(facts)}
    assert (checks["plan"].state, checks["path"].state) == ("notice", "notice")
    assert "packets above 1500 bytes do not come through, though eth1 takes 9000" in checks["path"].cause
    assert "path" not in {check.topic for check in camera_checks(replace(MANTA, path_bytes=8996))}


@pytest.mark.parametrize(
    ("counted", "text"),
    [
        (StreamStatistics(resent=4, requested=4), None),
        (StreamStatistics(duplicated=9), None),
        (StreamStatistics(resent=4, requested=4, duplicated=1), "1 packets came twice and 0 too late"),
        (StreamStatistics(resent=4, requested=4, ignored=2), "2 too late or with a wrong number"),
        (StreamStatistics(requested=4, failed=1), "of 4 packets that were asked for again 0 came in time"),
    ],
)
def test_resent_packets(counted, text):
    check = resend_check(counted)
    assert (check and check.topic) == (text and "resent packets")
    assert text is None or text in check.cause
