from dataclasses import replace
from ipaddress import IPv4Interface

import pytest

from labcdp.drivers.aravis import transport as aravis_transport
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.aravis.transport import TransportPlan, plan_transport
from labcdp.drivers.network import Interface
from labcdp.drivers.simulated.genicam import standard_features
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera

from ..conftest import SMALL, Ramp

_GIGABIT = Interface("eth0", IPv4Interface("169.254.0.10/16"), mtu_bytes=1500, speed_mbit_s=1000)
_RANGE = (1_000_000, 124_000_000)
_MANTA = {"packet_bytes": 1500, "payload_bytes": 2452 * 2056, "frame_rate_hz": 15.0, "interface": _GIGABIT}


@pytest.mark.parametrize(
    ("packet_bytes", "mbit_s", "plan"),
    [
        # By hand: 125 MB/s x 1500 / 1538 x 0.95; Allied Vision's default is 115 MB/s.
        (1500, 1000, TransportPlan(None, 115_815_994, 0)),
        # Jumbo frames carry more, up to the camera's limit.
        (9000, 1000, TransportPlan(None, 118_250_719, 0)),
        (9000, 10_000, TransportPlan(None, 124_000_000, 0)),
    ],
)
def test_the_link_gives_a_manta_its_bandwidth(packet_bytes, mbit_s, plan):
    interface = replace(_GIGABIT, mtu_bytes=packet_bytes, speed_mbit_s=mbit_s)
    facts = _MANTA | {"packet_bytes": packet_bytes, "interface": interface}
    assert plan_transport(**facts, bandwidth_range=_RANGE) == plan


def test_two_cameras_share_their_interface(aravis, monkeypatch):
    gigabit = replace(_GIGABIT, name="lo")
    monkeypatch.setattr(aravis_transport, "interface_to", lambda _address, _known: gigabit)
    with SimulatedGigECamera(SMALL, Ramp()), AravisCamera("SIM-1") as first:
        first.snap()
        alone = first.feature("StreamBytesPerSecond")
        # Plugged in later.
        with (
            SimulatedGigECamera(replace(SMALL, serial="SIM-2"), Ramp(), "127.0.0.2"),
            AravisCamera("SIM-2") as second,
        ):
            first.snap()
            second.snap()
            shares = [camera.feature("StreamBytesPerSecond") for camera in (first, second)]
        first.snap()
        assert first.feature("StreamBytesPerSecond") == alone
    packet_bytes = min(9000, _GIGABIT.mtu_bytes)
    assert alone == int(125e6 * packet_bytes / (packet_bytes + 38) * 0.95)
    assert shares == [int(125e6 * packet_bytes / (packet_bytes + 38) * 0.95 / 2)] * 2


@pytest.mark.parametrize("interface", [None, replace(_GIGABIT, name="lo", is_loopback=True, speed_mbit_s=None)])
def test_what_is_not_known_to_need_it_is_left_alone(interface):
    facts = _MANTA | {"packet_bytes": 9000, "interface": interface}
    assert plan_transport(**facts, bandwidth_range=_RANGE) == TransportPlan()


def test_a_camera_without_bandwidth_pauses_between_packets():
    plan = plan_transport(**_MANTA | {"frame_rate_hz": 5.0}, bandwidth_range=None)
    assert plan.bytes_per_s is None
    n_packets = -(-2452 * 2056 // (1500 - 36))
    sending_s = 1538 / 125e6
    assert n_packets * (sending_s + plan.packet_delay_ns * 1e-9) == pytest.approx(0.5 / 5, rel=1e-3)


@pytest.mark.parametrize(
    ("naming", "bandwidth"), [("prosilica", "StreamBytesPerSecond"), ("sfnc", "DeviceLinkThroughputLimit")]
)
def test_the_plan_is_carried_out_except_what_the_user_has_set(aravis, monkeypatch, naming, bandwidth):
    jumbo = replace(_GIGABIT, mtu_bytes=4000)
    with (
        SimulatedGigECamera(replace(SMALL, features=standard_features(naming)), Ramp()),
        AravisCamera("127.0.0.1") as camera,
    ):
        # As if the camera were behind a network card.
        monkeypatch.setattr(aravis_transport, "interface_to", lambda _address, _known: jumbo)
        camera.snap()
        features = camera.features()
        assert features["GevSCPSPacketSize"] == 4000
        assert features["GevSCPD"] == 0
        assert features[bandwidth] == int(125e6 * 4000 / 4038 * 0.95)
        assert features.get("DeviceLinkThroughputLimitMode", "On") == "On"
        camera.set_feature(bandwidth, 50_000_000)
        camera.set_feature("GevSCPSPacketSize", 1500)
        camera.snap()
        assert camera.feature(bandwidth) == 50_000_000
        assert camera.feature("GevSCPSPacketSize") == 1500
