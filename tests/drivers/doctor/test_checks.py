"""Checks of the doctor, first of network interfaces: as the kernel has them, and as a way to a camera."""

import os
import shutil
import subprocess
from ipaddress import IPv4Interface

import pytest
import serial

from labcdp.drivers.aravis import gvcp
from labcdp.drivers.doctor import computer
from labcdp.drivers.doctor.camera import check_camera
from labcdp.drivers.doctor.meter import check_meter
from labcdp.drivers.network import Interface, interface_checks, interface_to, interfaces, network_check
from labcdp.drivers.simulated.pty import PtyMeter

needs_own_network = pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("ip") is None, reason="making network interfaces needs root and ip"
)


def ip(arguments):
    subprocess.run(["ip", *arguments.split()], check=True, capture_output=True)


@pytest.fixture
def veth():
    """A cable with both ends in the tests' own network: vt0 with jumbo frames, vt1 without."""
    ip("link add vt0 type veth peer name vt1")
    try:
        ip("link set vt0 mtu 9000 up")
        ip("link set vt1 mtu 1500 up")
        ip("addr add 10.20.0.1/16 dev vt0")
        ip("addr add 10.20.9.1/24 dev vt0 label vt0:x")
        ip("addr add 10.30.0.1/24 dev vt1")
        yield
    finally:
        ip("link del vt0")


def named(name):
    return [one for one in interfaces() if one.name == name]


@needs_own_network
def test_address_mtu_link_and_way_are_the_kernels(veth):
    first, second = named("vt0")
    assert (first.address, second.address) == (IPv4Interface("10.20.0.1/16"), IPv4Interface("10.20.9.1/24"))
    assert (first.mtu_bytes, first.is_up, first.has_link, first.is_loopback) == (9000, True, True, False)
    # What the driver of such a cable says; that of loopback says nothing.
    assert (first.speed_mbit_s, named("lo")[0].speed_mbit_s) == (10_000, None)
    assert [(one.address, one.mtu_bytes) for one in named("vt1")] == [(IPv4Interface("10.30.0.1/24"), 1500)]
    ip("route add 10.50.0.0/16 dev vt1")
    ways = {address: interface_to(address, interfaces()).name for address in ("10.20.3.3", "10.50.1.1", "127.0.0.1")}
    assert ways == {"10.20.3.3": "vt0", "10.50.1.1": "vt1", "127.0.0.1": "lo"}
    assert interface_to("10.20.9.7", interfaces()).address == second.address
    # Its own address is reached inside the computer.
    assert interface_to("10.20.0.1", interfaces()).name == "lo"
    ip("link set vt1 down")
    assert not named("vt1")[0].is_up


@pytest.fixture
def camera_of_another_network(aravis_tools):
    """Aravis' own simulator behind vt0, in a network of which this computer has no address."""
    with subprocess.Popen(["unshare", "--net", "sh", "-c", "echo; exec sleep 5m"], stdout=subprocess.PIPE) as elsewhere:
        elsewhere.stdout.readline()
        there = ["nsenter", f"--net=/proc/{elsewhere.pid}/ns/net"]
        ip("link add vt0 type veth peer name vt1")
        ip(f"link set vt1 netns {elsewhere.pid}")
        for words in ("addr add 10.77.0.5/24 dev vt1", "link set vt1 up", "route add default dev vt1"):
            subprocess.run([*there, "ip", *words.split()], check=True)
        ip("link set vt0 up")
        ip("addr add 10.20.0.1/16 dev vt0")
        with subprocess.Popen([*there, "arv-fake-gv-camera-0.8", "-i", "vt1"]) as camera:
            while not (found := gvcp.announce_all("vt0")):
                assert camera.poll() is None
            yield found[0]
            camera.kill()
        ip("link del vt0")
        elsewhere.kill()


@needs_own_network
def test_the_remedy_for_a_camera_of_another_network_is_one(camera_of_another_network):
    unreachable, network = check_camera(camera_of_another_network, interfaces())
    assert (unreachable.state, network.state) == ("fault", "notice")
    command = network.remedy.split(",")[0]
    assert command == "sudo ip addr add 10.77.0.10/24 dev vt0"
    ip(command.removeprefix("sudo ip "))
    found = {one.topic: one.state for one in check_camera(camera_of_another_network, interfaces())}
    assert (found["controller"], found["network"]) == ("good", "good")


def eth(**values):
    return Interface("eth0", IPv4Interface("10.0.0.1/24"), **{"mtu_bytes": 9000, "speed_mbit_s": 1000} | values)


@pytest.mark.parametrize(
    ("values", "state"),
    [
        ({}, "good"),
        # A radio link does not tell its speed.
        ({"speed_mbit_s": None}, "good"),
        *((values, "notice") for values in ({"is_up": False}, {"has_link": False}, {"speed_mbit_s": 100})),
        ({"mtu_bytes": 1500}, "notice"),
    ],
)
def test_what_is_said_of_an_interface(values, state):
    (found,) = interface_checks([eth(**values)])
    assert (found.state, found.remedy is None) == (state, state == "good")


@pytest.mark.parametrize(
    ("camera", "own"), [("192.168.5.10", "192.168.5.11/24"), ("169.254.77.1", "169.254.0.10/16"), ("10.0.0.77", None)]
)
def test_the_address_to_add_is_in_the_cameras_network(camera, own):
    finding = network_check(camera, eth())
    assert (finding.remedy.split(",")[0] if finding else None) == (own and f"sudo ip addr add {own} dev eth0")


# The computer: its receive buffer, from a tree of files


def write(root, name, text):
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


@pytest.mark.parametrize(
    ("limit", "kept", "may_open_packet_sockets", "state"),
    [
        (33554432, 33554432, False, "good"),
        # Only until the computer starts again.
        (33554432, 212992, False, "notice"),
        (212992, 33554432, False, "fault"),
        (212992, 33554432, True, "notice"),
    ],
)
def test_the_receive_buffer_holds_a_frame(tmp_path, monkeypatch, limit, kept, may_open_packet_sockets, state):
    write(tmp_path, "proc/sys/net/core/rmem_max", f"{limit}\n")
    write(tmp_path, "proc/sys/net/core/rmem_default", "212992\n")
    write(tmp_path, "etc/sysctl.d/90-camera.conf", f"net.core.rmem_max = {kept}\n")
    monkeypatch.setattr(computer, "may_open_packet_sockets", lambda: may_open_packet_sockets)
    found = {one.topic: one for one in computer.host_checks(tmp_path)}["receive buffer"]
    assert (found.state, found.remedy is None) == (state, state == "good")
    assert found.remedy is None or "net.core.rmem_max=33554432" in found.remedy


# The meter, on a pseudo-terminal: a good one, and each way not to work


class Scripted:
    """A meter that takes every mode and shows one thing; it is silent if it shows nothing."""

    def __init__(self, shown):
        self.shown = shown
        self.heard = []

    def answer(self, command):
        self.heard.append(command[:3])
        return b"OK00\r\n" if self.shown and command.startswith(b"MDS") else self.shown


def checked(engine, timeout_s=5.0):
    with PtyMeter(engine, response_time_s=0) as served:
        found = check_meter(served.port, timeout_s=timeout_s)
        # It is closed again: another program may have the port.
        serial.Serial(served.port, exclusive=True).close()
    return found


def test_a_meter_in_order():
    engine = Scripted(b"OK00,CcPH 83.02\r\n")
    assert {one.state for one in checked(engine)} == {"good"}
    # It changes nothing but modes, and does not measure: too dark a first reading can end remote mode.
    assert set(engine.heard) == {b"MDS", b"DSR"}


def test_a_meter_that_does_not_answer_and_a_port_that_another_program_uses():
    assert [one.state for one in checked(Scripted(b""), timeout_s=0.2)] == ["good", "fault"]
    with PtyMeter(Scripted(b"")) as served, serial.Serial(served.port, exclusive=True):
        _, in_use = check_meter(served.port, timeout_s=0.2)
    assert str(in_use).endswith("another program uses it: end that program")
