"""The computer: limits, capabilities, ports, packages and permissions, from a tree of files and from this computer."""

import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from labcdp.drivers import computer
from labcdp.drivers.aravis.library import aravis
from labcdp.drivers.device import Finding
from labcdp.drivers.doctor.computer import aravis_finding, debian_packages, host_findings, port_finding
from labcdp.drivers.doctor.meter import serial_port_finding

KEEP = "echo net.core.rmem_max=33554432 | sudo tee /etc/sysctl.d/90-camera.conf"


def write(root, name, text):
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


@pytest.fixture
def root(tmp_path):
    """The files of a computer fit for a camera."""
    write(tmp_path, "proc/sys/net/core/rmem_max", "33554432\n")
    write(tmp_path, "proc/sys/net/core/rmem_default", "212992\n")
    write(tmp_path, "etc/sysctl.d/90-camera.conf", "net.core.rmem_max = 33554432\n")
    write(tmp_path, "proc/self/status", "CapEff:\t0000000000000000\n")
    return tmp_path


def finding(root, topic):
    (found,) = [one for one in host_findings(root) if one.topic == topic]
    return found


def test_a_computer_fit_for_a_camera_has_good_findings(root):
    assert finding(root, "receive buffer").state == finding(root, "capabilities").state == "good"


def test_what_cannot_be_read_is_unknown_and_not_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr("psutil.PROCFS_PATH", str(tmp_path))
    found = {one.topic: one.state for one in host_findings(tmp_path)}
    assert found["receive buffer"] == "unknown"
    assert not {"capabilities", "UDP port 3956"} & found.keys()


@pytest.mark.parametrize(("capabilities", "state"), [("0000000000000000", "fault"), ("0000000000002000", "notice")])
def test_a_limit_below_a_frame(root, capabilities, state):
    write(root, "proc/sys/net/core/rmem_max", "212992\n")
    write(root, "proc/self/status", f"CapEff:\t{capabilities}\n")
    assert finding(root, "receive buffer") == Finding(
        "receive buffer",
        state,
        "net.core.rmem_max is 213 kB, and a frame has up to 10.1 MB; programs that ask for nothing get 213 kB "
        "(rmem_default)",
        f"sudo sysctl -w net.core.rmem_max=33554432 (to keep it: {KEEP})",
    )


@pytest.mark.parametrize("kept", ["", "net.core.rmem_max=212992\n"])
def test_a_limit_that_the_next_start_forgets(root, kept):
    write(root, "etc/sysctl.d/90-camera.conf", kept)
    found = finding(root, "receive buffer")
    assert (found.state, found.remedy) == ("notice", KEEP)
    assert found.cause.startswith("until the computer starts again, net.core.rmem_max is 33.6 MB")


def test_the_capability_is_what_lets_a_packet_socket_open():
    try:
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW).close()
        may = True
    except PermissionError:
        may = False
    assert computer.may_open_packet_sockets() is may


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
    assert computer.firewall(tmp_path) == firewall


def test_the_program_that_has_a_port_is_named():
    code = (
        "import socket, time; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(('127.0.0.2', 0)); "
        "print(s.getsockname()[1], flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        try:
            found = port_finding(int(process.stdout.readline()))
            name = Path(f"/proc/{process.pid}/comm").read_text().strip()
        finally:
            process.kill()
    assert found.cause == f"taken by {name} (process {process.pid}) on 127.0.0.2; real cameras do not need it"
    assert f"end it (kill {process.pid}), or give it another one (labcdp simulate-bench --address)" in found.remedy


needs_dpkg = pytest.mark.skipif(shutil.which("dpkg-query") is None, reason="this is not a Debian system")


@needs_dpkg
def test_packages_that_are_missing_are_named(tmp_path, monkeypatch):
    aravis.cache_clear()
    monkeypatch.setitem(sys.modules, "gi", None)  # as if PyGObject were not there
    installed = (
        ("python3-gi", "3.42.2-3+b1", "install ok installed"),
        ("gir1.2-aravis-0.8", "0.8.26-1", "deinstall ok config-files"),
    )
    about = "Architecture: amd64\nMaintainer: x\nDescription: x\n"
    packages = [
        f"Package: {name}\nStatus: {state}\nVersion: {version}\n{about}\n" for name, version, state in installed
    ]
    write(tmp_path, "var/lib/dpkg/status", "".join(packages))
    (tmp_path / "var/lib/dpkg/updates").mkdir()
    assert debian_packages(tmp_path / "var/lib/dpkg") == {"python3-gi": "3.42.2-3+b1"}
    assert aravis_finding(tmp_path) == Finding(
        "Aravis",
        "fault",
        "no camera can be used: gir1.2-aravis-0.8 and libaravis-0.8-0 not installed",
        "sudo apt-get install gir1.2-aravis-0.8 libaravis-0.8-0",
    )


@pytest.mark.parametrize(
    ("mode", "gid", "members", "cause", "remedy"),
    [
        (0o660, 20, [], "anna may not open it (crw-rw----, owner root, group dialout)", "sudo adduser anna dialout"),
        (0o660, 20, ["anna"], "group dialout), though of its group", "log out and in again"),
        (0o600, 20, [], "(crw-------", "sudo chgrp dialout /dev/ttyUSB0; sudo chmod g+rw /dev/ttyUSB0; sudo adduser"),
        (0o660, 0, [], "group root)", "sudo chgrp dialout /dev/ttyUSB0; sudo chmod g+rw /dev/ttyUSB0; sudo adduser"),
    ],
)
def test_each_way_not_to_be_let_in(monkeypatch, mode, gid, members, cause, remedy):
    names = {0: "root", 1000: "anna"}
    groups = {0: "root", 20: "dialout"}
    monkeypatch.setattr(os, "stat", lambda _path: SimpleNamespace(st_mode=0o020000 | mode, st_uid=0, st_gid=gid))
    monkeypatch.setattr(os, "getuid", lambda: 1000)
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr("pwd.getpwuid", lambda uid: SimpleNamespace(pw_name=names[uid]))
    monkeypatch.setattr("pwd.getpwnam", lambda _name: SimpleNamespace(pw_gid=1000))
    monkeypatch.setattr("grp.getgrgid", lambda gid: SimpleNamespace(gr_name=groups[gid], gr_mem=members))
    needed, seen = (serial_port_finding("/dev/ttyUSB0", needed=needed) for needed in (True, False))
    assert (needed.state, seen.state) == ("fault", "notice")
    assert cause in needed.cause
    assert needed.remedy.startswith(remedy)
