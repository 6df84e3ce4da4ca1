"""Network interfaces: as the kernel has them, and what is wrong with them as a way to a camera."""

import os
import shutil
import subprocess
import sys
import time
from ipaddress import IPv4Interface

import pytest

from labcdp.drivers.network import Interface, interface_findings, interface_to, interfaces, network_finding

needs_own_network = pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("ip") is None, reason="making network interfaces needs root and ip"
)


def ip(*arguments):
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


@pytest.fixture
def veth():
    """A cable with both ends in the tests' own network: vt0 with jumbo frames, vt1 without."""
    ip("link", "add", "vt0", "type", "veth", "peer", "name", "vt1")
    try:
        ip("link", "set", "vt0", "mtu", "9000", "up")
        ip("link", "set", "vt1", "mtu", "1500", "up")
        ip("addr", "add", "10.20.0.1/16", "dev", "vt0")
        ip("addr", "add", "10.20.9.1/24", "dev", "vt0", "label", "vt0:x")
        ip("addr", "add", "10.30.0.1/24", "dev", "vt1")
        yield
    finally:
        ip("link", "del", "vt0")


def named(name):
    return [one for one in interfaces() if one.name == name]


@needs_own_network
def test_address_mtu_and_link_are_the_kernels(veth):
    first, second = named("vt0")
    assert (first.address, second.address) == (IPv4Interface("10.20.0.1/16"), IPv4Interface("10.20.9.1/24"))
    assert first.mtu_bytes == second.mtu_bytes == 9000
    assert first.is_up
    assert first.has_link
    assert not first.is_loopback
    (third,) = named("vt1")
    assert (third.address, third.mtu_bytes) == (IPv4Interface("10.30.0.1/24"), 1500)
    ip("link", "set", "vt1", "down")
    (third,) = named("vt1")
    assert not third.is_up
    # The kernel tells the other end some time later.
    until_s = time.monotonic() + 60
    while named("vt0")[0].has_link:
        assert time.monotonic() < until_s
        time.sleep(0.05)


@needs_own_network
def test_the_way_to_a_camera_is_the_kernels(veth):
    known = interfaces()
    ip("route", "add", "10.50.0.0/16", "dev", "vt1")
    assert interface_to("10.20.3.3", known).name == "vt0"
    assert interface_to("10.20.9.7", known).address == IPv4Interface("10.20.9.1/24")
    assert interface_to("10.30.0.9", known).name == "vt1"
    assert interface_to("10.50.1.1", known).name == "vt1"
    # Its own address is reached inside the computer.
    assert interface_to("10.20.0.1", known).name == "lo"
    assert interface_to("127.0.0.1", known).name == "lo"


@pytest.mark.skipif(os.geteuid() != 0 or shutil.which("unshare") is None, reason="mounting sysfs needs root")
def test_the_speed_of_the_link_is_read():
    if subprocess.run(["unshare", "--net", "--mount", "true"], capture_output=True).returncode != 0:
        pytest.skip("a mount namespace cannot be had here")
    code = "from labcdp.drivers.network import interfaces;print({one.name: one.speed_mbit_s for one in interfaces()})"
    script = (
        "mount -t sysfs none /sys || exit 77; ip link set lo up; ip link add sp0 type veth peer name sp1; "
        'ip link set sp0 up; ip link set sp1 up; ip addr add 10.1.0.1/24 dev sp0; cat /sys/class/net/sp0/speed; "$@"'
    )
    command = ["unshare", "--net", "--mount", "sh", "-c", script, "sh", sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    if done.returncode == 77:
        pytest.skip("sysfs cannot be mounted here")
    speed, found = done.stdout.splitlines()
    assert found == str({"lo": None, "sp0": int(speed)})


def eth(name="eth0", address="10.0.0.1/24", **values):
    return Interface(name, IPv4Interface(address), **{"mtu_bytes": 9000, "speed_mbit_s": 1000} | values)


def texts(*known):
    return [(finding.state, str(finding)) for finding in interface_findings(known)]


def test_an_interface_fit_for_a_camera():
    assert texts(eth()) == [("good", "10.0.0.1/24, packets of 9000 bytes, 1000 Mbit/s")]
    # A radio link does not tell its speed.
    assert texts(eth(speed_mbit_s=None)) == [("good", "10.0.0.1/24, packets of 9000 bytes")]


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"is_up": False}, "10.0.0.1/24 is switched off: sudo ip link set eth0 up"),
        ({"has_link": False}, "10.0.0.1/24 has no link: check the cable, and that the camera has power"),
        (
            {"speed_mbit_s": 100},
            "10.0.0.1/24 runs at 100 Mbit/s: a GigE Vision camera needs 1000: use a cable of category 5e or better, "
            "and a gigabit port at both ends",
        ),
        (
            {"mtu_bytes": 1500},
            "10.0.0.1/24 takes packets of 1500 bytes; jumbo frames of 9000 cost less computing time and lose less: "
            "sudo ip link set eth0 mtu 9000, if it is the camera's interface and every switch between takes them",
        ),
    ],
)
def test_each_fault_of_an_interface(values, text):
    assert texts(eth(**values)) == [("notice", text)]


@pytest.mark.parametrize(
    ("camera", "own"),
    [
        ("192.168.5.20", "192.168.5.10/24"),
        ("192.168.5.10", "192.168.5.11/24"),
        ("169.254.77.1", "169.254.0.10/16"),
    ],
)
def test_the_address_to_add_is_in_the_cameras_network(camera, own):
    finding = network_finding(camera, eth())
    assert finding.remedy.startswith(f"sudo ip addr add {own} dev eth0")
    assert network_finding("10.0.0.77", eth()) is None
    assert network_finding("nonsense", eth()) is None
