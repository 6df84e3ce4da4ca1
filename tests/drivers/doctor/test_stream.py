"""Why no frames come: each cause from facts that show it, the likeliest first, with the command that fixes it."""

from ipaddress import IPv4Interface

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.drivers import network
from labcdp.drivers.camera import StreamStatistics
from labcdp.drivers.device import Finding
from labcdp.drivers.network import Interface, stream_causes

#: A 16-bit frame of a Manta G-505.
FRAME = 2452 * 2056 * 2
CAMERA = "192.168.7.20"
ETH1 = Interface("eth1", IPv4Interface("192.168.7.1/24"), mtu_bytes=1500)


@pytest.fixture
def behind_a_card(monkeypatch, tmp_path):
    """The camera is behind a network card of a computer with these files."""
    monkeypatch.setattr(network, "interface_to", lambda _address, _known: ETH1)
    return tmp_path


def test_packets_larger_than_the_interface_takes(behind_a_card):
    found = stream_causes(CAMERA, FRAME, 9000, root=behind_a_card)
    assert found[0] == Finding(
        "packet size",
        "fault",
        "the camera sends packets of 9000 bytes, but eth1 takes 1500",
        "sudo ip link set eth1 mtu 9000, or set the camera's GevSCPSPacketSize to 1500",
    )
    assert [one.topic for one in stream_causes(CAMERA, FRAME, 1500, root=behind_a_card)] == ["firewall"]


@pytest.mark.parametrize(
    ("file", "state", "command"),
    [
        ("etc/ufw/ufw.conf", "notice", "sudo ufw allow proto udp from 192.168.7.20"),
        ("run/firewalld", "notice", "sudo firewall-cmd --zone=trusted --add-source=192.168.7.20"),
        ("proc/net/ip_tables_names", "notice", "sudo iptables -I INPUT -p udp -s 192.168.7.20 -j ACCEPT"),
        (None, "unknown", "if there is a firewall, let UDP packets from 192.168.7.20 through"),
    ],
)
def test_a_firewall_is_suspected_when_nothing_came(behind_a_card, file, state, command):
    if file is not None:
        (behind_a_card / file).parent.mkdir(parents=True)
        (behind_a_card / file).write_text("ENABLED=yes\nfilter\n")
    (finding,) = stream_causes(CAMERA, FRAME, root=behind_a_card)
    assert (finding.topic, finding.state, finding.remedy) == ("firewall", state, command)


counts = st.integers(0, 10**12)


@given(
    st.text() | st.sampled_from(["", CAMERA, "127.0.0.1", "255.255.255.255", "::1", "localhost"]),
    counts,
    st.none() | st.integers(-5, 10**9),
    st.none() | counts,
    counts,
    counts,
)
def test_no_facts_make_it_fail(address, payload, packet, granted, failed, missing):
    counted = StreamStatistics(failed=failed, missing=missing)
    for finding in stream_causes(address, payload, packet, granted, counted):
        assert finding.state != "good"
        assert finding.cause
        assert finding.remedy


@pytest.mark.parametrize(
    ("message", "cause", "remedy"),
    [
        ("no camera: check power", "no camera", "check power"),
        ("/dev/x: in use: end\n the program", "/dev/x: in use", "end the program"),
        ("no reason at all", "no reason at all", None),
        # What another program said stands in brackets, and is no remedy.
        ("cannot be opened [Device: not found]", "cannot be opened [Device: not found]", None),
        ("cannot be opened [E: x]: look at [1]", "cannot be opened [E: x]", "look at [1]"),
    ],
)
def test_an_error_becomes_cause_and_remedy(message, cause, remedy):
    found = Finding.of_error("topic", RuntimeError(message))
    assert found == Finding("topic", "fault", cause, remedy)
    assert str(found) == " ".join(message.split())
