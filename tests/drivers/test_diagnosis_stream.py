"""Why no frames come: each cause from facts that show it, the likeliest first, with the command that mends it."""

from ipaddress import IPv4Interface

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.drivers.diagnosis import Finding, StreamFacts, stream_causes
from labcdp.drivers.diagnosis.network import Interface
from labcdp.drivers.diagnosis.stream import Receiver, causes_at
from labcdp.drivers.diagnosis.units import size

#: A 16-bit frame of a Manta G-505.
FRAME = 2452 * 2056 * 2
CAMERA = "192.168.7.20"
ETH1 = Interface("eth1", IPv4Interface("192.168.7.1/24"), mtu_bytes=1500)
LO = Interface("lo", IPv4Interface("127.0.0.1/8"), is_loopback=True, mtu_bytes=65536)


def topics(facts, receiver):
    return [finding.topic for finding in causes_at(facts, receiver)]


def test_a_receive_buffer_smaller_than_a_frame_comes_with_its_command():
    facts = StreamFacts(CAMERA, FRAME, 1500, socket_buffer_bytes=425_984, failed=3, missing=900)
    first, *others = causes_at(facts, Receiver(ETH1, receive_limit_bytes=212_992))
    assert first == Finding(
        "receive buffer",
        "fault",
        "the receive buffer of 426 kB does not hold a frame of 10.1 MB",
        "sudo sysctl -w net.core.rmem_max=33554432 (to keep it: echo net.core.rmem_max=33554432 | sudo tee "
        "/etc/sysctl.d/90-camera.conf)",
    )
    assert [finding.topic for finding in others] == ["packets"]


def test_a_frame_larger_than_the_usual_limit_asks_for_more():
    finding = causes_at(StreamFacts(CAMERA, 50_000_000, None, 425_984, failed=1), Receiver(ETH1, 212_992))[0]
    assert "net.core.rmem_max=67108864" in finding.remedy


def test_a_limit_raised_after_opening_asks_to_open_again():
    finding = causes_at(StreamFacts(CAMERA, FRAME, None, 425_984, failed=1), Receiver(ETH1, 33_554_432))[0]
    assert str(finding) == (
        "the receive buffer of 426 kB does not hold a frame of 10.1 MB, though net.core.rmem_max allows 33.6 MB: "
        "close the camera and open it again"
    )


@pytest.mark.parametrize("granted", [None, FRAME, 2 * FRAME])
def test_a_buffer_that_holds_a_frame_or_is_unknown_is_no_cause(granted):
    assert topics(StreamFacts(CAMERA, FRAME, 1500, granted, failed=1), Receiver(ETH1, 212_992)) == []


def test_packets_larger_than_the_interface_takes():
    facts = StreamFacts(CAMERA, FRAME, 9000)
    first = causes_at(facts, Receiver(ETH1))[0]
    assert first == Finding(
        "packet size",
        "fault",
        "the camera sends packets of 9000 bytes, but eth1 takes 1500",
        "sudo ip link set eth1 mtu 9000, or set the camera's GevSCPSPacketSize to 1500",
    )
    assert topics(StreamFacts(CAMERA, FRAME, 1500), Receiver(ETH1)) == ["firewall"]


def test_a_camera_that_waits_for_its_trigger_comes_first_if_nothing_came():
    waiting = StreamFacts(CAMERA, FRAME, 9000, 425_984, trigger_source="Line1")
    found = causes_at(waiting, Receiver(ETH1, 212_992))
    assert [finding.topic for finding in found] == ["trigger", "packet size", "receive buffer", "firewall"]
    assert str(found[0]) == (
        "the camera waits for a pulse on Line1: check the cable of the trigger and that pulses come, or set the "
        "trigger to free-running"
    )
    assert "software trigger" in causes_at(StreamFacts(CAMERA, FRAME, trigger_source="Software"), Receiver())[0].cause


def test_where_packets_came_neither_trigger_nor_firewall_is_to_blame():
    facts = StreamFacts(CAMERA, FRAME, 1500, FRAME, trigger_source="Line1", completed=2, failed=1, missing=7)
    found = causes_at(facts, Receiver(ETH1, firewall="ufw"))
    assert [str(finding) for finding in found] == [
        "7 packets are counted as missing: check cable and switch, lower the frame rate or the camera's bandwidth, or "
        "raise the packet delay"
    ]


def test_underruns_say_that_the_program_is_too_slow():
    (finding,) = causes_at(StreamFacts(CAMERA, FRAME, completed=5, underruns=3), Receiver(ETH1))
    assert finding.cause == "3 packets found no free buffer, since the program was too slow to take them"
    assert finding.remedy == "lower the frame rate, or do less between two frames"


@pytest.mark.parametrize(
    ("firewall", "state", "command"),
    [
        ("ufw", "notice", "sudo ufw allow proto udp from 192.168.7.20"),
        ("firewalld", "notice", "sudo firewall-cmd --zone=trusted --add-source=192.168.7.20"),
        ("iptables", "notice", "sudo iptables -I INPUT -p udp -s 192.168.7.20 -j ACCEPT"),
        (None, "unknown", "if there is a firewall, let UDP packets from 192.168.7.20 through"),
    ],
)
def test_a_firewall_is_suspected_when_nothing_came(firewall, state, command):
    (finding,) = causes_at(StreamFacts(CAMERA, FRAME), Receiver(ETH1, firewall=firewall))
    assert (finding.topic, finding.state, finding.remedy) == ("firewall", state, command)


def test_no_firewall_on_loopback_or_off_the_network():
    assert causes_at(StreamFacts("127.0.0.1", FRAME), Receiver(LO, firewall="ufw")) == []
    assert causes_at(StreamFacts("", FRAME), Receiver(firewall="ufw")) == []


def test_a_camera_in_another_network():
    facts = StreamFacts("169.254.3.4", FRAME, failed=1)
    (finding,) = causes_at(facts, Receiver(ETH1))
    assert (finding.topic, finding.state) == ("network", "notice")
    assert finding.cause == "the camera's address 169.254.3.4 is outside the network 192.168.7.0/24 of eth1"
    assert finding.remedy == (
        "sudo ip addr add 169.254.0.10/16 dev eth1, or give the camera an address of that network"
    )
    strict = Interface("eth1", ETH1.address, strict_reverse_path=True)
    assert causes_at(facts, Receiver(strict))[0].state == "fault"


def test_this_computer_is_asked_for_the_rest():
    (finding,) = stream_causes(StreamFacts("127.0.0.1", FRAME, packet_size_bytes=70_000, failed=1))
    assert finding.cause == "the camera sends packets of 70000 bytes, but lo takes 65536"


counts = st.integers(0, 10**12)


@given(
    st.text() | st.sampled_from(["", CAMERA, "127.0.0.1", "255.255.255.255", "::1", "localhost"]),
    counts,
    st.none() | st.integers(-5, 10**9),
    st.none() | counts,
    st.none() | st.text(max_size=8),
    counts,
    counts,
)
def test_no_facts_make_it_fail(address, payload, packet, granted, trigger, failed, missing):
    facts = StreamFacts(address, payload, packet, granted, trigger, failed=failed, missing=missing)
    for finding in stream_causes(facts):
        assert finding.state != "good"
        assert finding.cause
        assert finding.remedy


@pytest.mark.parametrize(
    ("n", "text"), [(0, "0 bytes"), (1500, "1500 bytes"), (212_992, "213 kB"), (10_082_624, "10.1 MB")]
)
def test_sizes_for_a_person(n, text):
    assert size(n) == text


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
