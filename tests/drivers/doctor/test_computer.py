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
#: A computer fit for a camera: limit of the receive buffer, the same for its next start, and capabilities.
FIT = ("33554432\n", "net.core.rmem_max = 33554432\n", "0000000000000000")


def write(root, name, text):
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def findings(root, limit, kept, capabilities):
    write(root, "proc/sys/net/core/rmem_max", limit)
    write(root, "proc/sys/net/core/rmem_default", "212992\n")
    write(root, "etc/sysctl.d/90-camera.conf", kept)
    write(root, "proc/self/status", f"CapEff:\t{capabilities}\n")
    return {one.topic: one for one in host_findings(root)}


def test_a_computer_fit_for_a_camera_has_good_findings_and_what_cannot_be_read_is_unknown(tmp_path, monkeypatch):
    found = findings(tmp_path / "fit", *FIT)
    assert found["receive buffer"].state == found["capabilities"].state == "good"
    (tmp_path / "nothing").mkdir()
    monkeypatch.setattr("psutil.PROCFS_PATH", str(tmp_path / "nothing"))
    states = {one.topic: one.state for one in host_findings(tmp_path / "nothing")}
    assert states["receive buffer"] == "unknown"
    assert not {"capabilities", "UDP port 3956"} & states.keys()


@pytest.mark.parametrize(("capabilities", "state"), [("0000000000000000", "fault"), ("0000000000002000", "notice")])
def test_a_limit_below_a_frame(tmp_path, capabilities, state):
    assert findings(tmp_path, "212992\n", FIT[1], capabilities)["receive buffer"] == Finding(
        "receive buffer",
        state,
        "net.core.rmem_max is 213 kB, and a frame has up to 10.1 MB; programs that ask for nothing get 213 kB "
        "(rmem_default)",
        f"sudo sysctl -w net.core.rmem_max=33554432 (to keep it: {KEEP})",
    )


@pytest.mark.parametrize("kept", ["", "net.core.rmem_max=212992\n"])
def test_a_limit_that_the_next_start_forgets(tmp_path, kept):
    found = findings(tmp_path, FIT[0], kept, FIT[2])["receive buffer"]
    assert (found.state, found.remedy) == ("notice", KEEP)
    assert found.cause.startswith("until the computer starts again, net.core.rmem_max is 33.6 MB")


def test_the_capability_is_what_lets_a_packet_socket_open():
    try:
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW).close()
        may = True
    except PermissionError:
        may = False
    assert computer.may_open_packet_sockets() is may


def test_the_program_that_has_a_port_is_named():
    code = (
        "import socket, time; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(('127.0.0.2', 0)); "
        "print(s.getsockname()[1], flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        found = port_finding(int(process.stdout.readline()))
        name = Path(f"/proc/{process.pid}/comm").read_text().strip()
        process.kill()
    assert found.cause == f"taken by {name} (process {process.pid}) on 127.0.0.2; real cameras do not need it"
    assert f"end it (kill {process.pid}), or give it another one (labcdp simulate-bench --address)" in found.remedy


@pytest.mark.skipif(shutil.which("dpkg-query") is None, reason="this is not a Debian system")
def test_packages_that_are_missing_are_named(tmp_path, monkeypatch):
    aravis.cache_clear()
    monkeypatch.setitem(sys.modules, "gi", None)  # as if PyGObject were not there
    installed = (("python3-gi", "3.42.2-3+b1", "ok installed"), ("gir1.2-aravis-0.8", "0.8.26-1", "ok config-files"))
    about = "Architecture: amd64\nMaintainer: x\nDescription: x\n"
    entries = [f"Package: {name}\nStatus: install {state}\nVersion: {n}\n{about}\n" for name, n, state in installed]
    write(tmp_path, "var/lib/dpkg/status", "".join(entries))
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
    ],
)
def test_each_way_not_to_be_let_in(monkeypatch, mode, gid, members, cause, remedy):
    monkeypatch.setattr(os, "stat", lambda _path: SimpleNamespace(st_mode=0o020000 | mode, st_uid=0, st_gid=gid))
    monkeypatch.setattr(os, "getuid", lambda: 1000)
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr("pwd.getpwuid", lambda uid: SimpleNamespace(pw_name={0: "root", 1000: "anna"}[uid]))
    monkeypatch.setattr("pwd.getpwnam", lambda _name: SimpleNamespace(pw_gid=1000))
    monkeypatch.setattr("grp.getgrgid", lambda _gid: SimpleNamespace(gr_name="dialout", gr_mem=members))
    needed, seen = (serial_port_finding("/dev/ttyUSB0", needed=needed) for needed in (True, False))
    assert (needed.state, seen.state) == ("fault", "notice")
    assert cause in needed.cause
    assert needed.remedy.startswith(remedy)
