from dataclasses import replace
from ipaddress import IPv4Interface

import pytest

from labcdp.drivers.aravis import transport as aravis_transport
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.network import Interface
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera

from ..conftest import SMALL, Ramp, opened

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
