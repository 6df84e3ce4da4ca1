"""The host: limits, capabilities, ports, packages and permissions, from a tree of files and from this computer."""

import shutil
import socket
import subprocess
import sys
from dataclasses import replace
from ipaddress import IPv4Interface
from pathlib import Path

import pytest

from labcdp.drivers import computer as kernel
from labcdp.drivers.aravis.library import aravis
from labcdp.drivers.device import Finding
from labcdp.drivers.doctor.computer import (
    FRAME_BYTES,
    NEEDED,
    AravisFacts,
    HostFacts,
    PortUser,
    aravis_facts,
    aravis_finding,
    debian_packages,
    host_facts,
    host_findings,
    udp_port_users,
)
from labcdp.drivers.doctor.meter import SerialPortFacts, serial_port_finding
from labcdp.drivers.network import Interface

KEEP = "echo net.core.rmem_max=33554432 | sudo tee /etc/sysctl.d/90-camera.conf"

GOOD = HostFacts(
    frame_bytes=FRAME_BYTES,
    receive_limit_bytes=33_554_432,
    receive_default_bytes=212_992,
    kept_receive_limit_bytes=33_554_432,
    packet_sockets=False,
    interpreter="/usr/bin/python3.11",
    interfaces=[Interface("eth0", IPv4Interface("10.0.0.1/24"), mtu_bytes=9000, speed_mbit_s=1000)],
    port_users=[],
    clock_is_synchronised=True,
    aravis=AravisFacts(pygobject="3.42.2", packages=dict.fromkeys(NEEDED, "1.0")),
    serial_ports=[],
)


def write(root, name, text):
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def finding(facts, topic):
    (found,) = [one for one in host_findings(facts) if one.topic == topic]
    return found


def test_a_computer_fit_for_a_camera_has_nothing_but_good_findings():
    assert {one.state for one in host_findings(GOOD)} == {"good"}
    assert {one.remedy for one in host_findings(GOOD)} == {None}


def test_every_file_that_is_missing_is_unknown_and_not_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr("psutil.PROCFS_PATH", str(tmp_path))
    facts = host_facts(root=tmp_path)
    assert facts.receive_limit_bytes is None
    assert facts.kept_receive_limit_bytes is None
    assert facts.packet_sockets is None
    assert facts.port_users is None
    assert facts.aravis.packages is None
    assert finding(facts, "receive buffer").state == "unknown"


# Receive buffer


@pytest.mark.parametrize("packet_sockets", [False, True])
def test_a_limit_below_a_frame(packet_sockets):
    facts = replace(GOOD, receive_limit_bytes=212_992, packet_sockets=packet_sockets)
    assert finding(facts, "receive buffer") == Finding(
        "receive buffer",
        "notice" if packet_sockets else "fault",
        "net.core.rmem_max is 213 kB, and a frame has up to 10.1 MB; programs that ask for nothing get 213 kB "
        "(rmem_default)",
        f"sudo sysctl -w net.core.rmem_max=33554432 (to keep it: {KEEP})",
    )


@pytest.mark.parametrize("kept", [None, 212_992])
def test_a_limit_that_the_next_start_forgets(kept):
    found = finding(replace(GOOD, kept_receive_limit_bytes=kept), "receive buffer")
    assert (found.state, found.remedy) == ("notice", KEEP)
    assert found.cause.startswith("until the computer starts again, net.core.rmem_max is 33.6 MB")


# Capabilities


def test_the_capability_is_what_lets_a_packet_socket_open():
    try:
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW).close()
        may = True
    except PermissionError:
        may = False
    assert kernel.may_open_packet_sockets() is may


# Clock and firewall


@pytest.mark.parametrize(
    ("name", "text", "firewall"),
    [
        ("etc/ufw/ufw.conf", "LOGLEVEL=low\nENABLED=yes\n", "ufw"),
        ("etc/ufw/ufw.conf", "#ENABLED=yes\nENABLED=no\n", None),
        ("run/firewalld.pid", "77", "firewalld"),
        ("proc/net/ip_tables_names", "nat\nfilter\n", "iptables"),
        ("proc/net/ip_tables_names", "nat\n", None),
    ],
)
def test_firewalls_that_show(tmp_path, name, text, firewall):
    write(tmp_path, name, text)
    assert kernel.firewall(tmp_path) == firewall


# UDP port


@pytest.fixture
def other_program():
    """Another process that has a UDP port of 127.0.0.2; yields its number and the port."""
    code = (
        "import socket, time; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(('127.0.0.2', 0)); "
        "print(s.getsockname()[1], flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process.pid, int(process.stdout.readline())
        finally:
            process.kill()


def test_the_program_that_has_a_port_is_named(other_program):
    pid, port = other_program
    comm = Path(f"/proc/{pid}/comm").read_text().strip()
    assert udp_port_users(port) == [PortUser("127.0.0.2", pid, comm)]


def test_who_has_the_port_and_how_to_end_it():
    facts = replace(GOOD, port_users=[PortUser("127.0.0.1", 42, "arv-fake-gv-cam"), PortUser("0.0.0.0")])
    found = finding(facts, "UDP port 3956")
    assert found.state == "notice"
    assert str(found) == (
        "taken by arv-fake-gv-cam (process 42) on 127.0.0.1, a program of another user on 0.0.0.0; real cameras do not "
        "need it: for a simulated camera on the same address end it (kill 42), or give it another one (labcdp "
        "simulate-bench --address)"
    )


# Packages


def status(name, version, state="install ok installed"):
    return (
        f"Package: {name}\nStatus: {state}\nArchitecture: amd64\nMaintainer: x\nVersion: {version}\nDescription: x\n\n"
    )


needs_dpkg = pytest.mark.skipif(shutil.which("dpkg-query") is None, reason="this is not a Debian system")


@needs_dpkg
def test_versions_come_from_debians_database(tmp_path):
    write(
        tmp_path,
        "var/lib/dpkg/status",
        status("python3-gi", "3.42.2-3+b1")
        + status("gir1.2-aravis-0.8", "0.8.26-1", "deinstall ok config-files")
        + status("other", "1"),
    )
    (tmp_path / "var/lib/dpkg/updates").mkdir()
    assert debian_packages(tmp_path / "var/lib/dpkg") == {"python3-gi": "3.42.2-3+b1"}


@needs_dpkg
def test_without_aravis_the_packages_to_install_are_named(tmp_path, monkeypatch):
    aravis.cache_clear()
    monkeypatch.setitem(sys.modules, "gi", None)  # as if PyGObject were not there
    write(tmp_path, "var/lib/dpkg/status", status("python3-gi", "3.42.2-3+b1"))
    (tmp_path / "var/lib/dpkg/updates").mkdir()
    found = aravis_finding(aravis_facts(tmp_path))
    assert (found.state, found.remedy) == ("fault", "sudo apt-get install gir1.2-aravis-0.8 libaravis-0.8-0")
    assert found.cause == "no camera can be used: gir1.2-aravis-0.8 and libaravis-0.8-0 not installed"


# Serial ports


CLOSED = SerialPortFacts(
    "/dev/ttyUSB0", may_open=False, mode="crw-rw----", owner="root", group="dialout", user="anna", in_group=False
)


@pytest.mark.parametrize(
    ("change", "cause", "remedy"),
    [
        ({}, "anna may not open it (crw-rw----, owner root, group dialout)", "sudo adduser anna dialout, then log out"),
        ({"in_group": True}, "group dialout), though of its group", "log out and in again"),
        ({"mode": "crw-------"}, "(crw-------", "sudo chgrp dialout /dev/ttyUSB0; sudo chmod g+rw /dev/ttyUSB0; sudo"),
        ({"group": "root"}, "group root)", "sudo chgrp dialout /dev/ttyUSB0; sudo chmod g+rw /dev/ttyUSB0; sudo"),
    ],
)
def test_each_way_not_to_be_let_in(change, cause, remedy):
    found = serial_port_finding(replace(CLOSED, **change), needed=True)
    assert found.state == "fault"
    assert cause in found.cause
    assert found.remedy.startswith(remedy)
    assert serial_port_finding(replace(CLOSED, **change), needed=False).state == "notice"


# The whole
