"""The computer: limits, capabilities, ports, packages and permissions, from a tree of files and from this computer."""

import os
from types import SimpleNamespace

import pytest

from labcdp.drivers.doctor import computer
from labcdp.drivers.doctor.meter import serial_port_finding


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
    found = {one.topic: one for one in computer.host_findings(tmp_path)}["receive buffer"]
    assert (found.state, found.remedy is None) == (state, state == "good")
    assert found.remedy is None or "net.core.rmem_max=33554432" in found.remedy


def test_what_cannot_be_read_is_unknown_and_not_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr("psutil.PROCFS_PATH", str(tmp_path))
    states = {one.topic: one.state for one in computer.host_findings(tmp_path)}
    assert states["receive buffer"] == "unknown"


@pytest.mark.parametrize(
    ("mode", "members", "remedy"),
    [
        (0o660, [], "sudo adduser anna dialout"),
        (0o660, ["anna"], "log out and in again"),
        (0o600, [], "sudo chgrp dialout /dev/ttyUSB0; sudo chmod g+rw /dev/ttyUSB0; sudo adduser"),
    ],
)
def test_each_way_not_to_be_let_in(monkeypatch, mode, members, remedy):
    monkeypatch.setattr(os, "stat", lambda _path: SimpleNamespace(st_mode=0o020000 | mode, st_uid=0, st_gid=20))
    monkeypatch.setattr(os, "getuid", lambda: 1000)
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr("pwd.getpwuid", lambda uid: SimpleNamespace(pw_name={0: "root", 1000: "anna"}[uid]))
    monkeypatch.setattr("pwd.getpwnam", lambda _name: SimpleNamespace(pw_gid=1000))
    monkeypatch.setattr("grp.getgrgid", lambda _gid: SimpleNamespace(gr_name="dialout", gr_mem=members))
    found = serial_port_finding("/dev/ttyUSB0", needed=True)
    assert found.state == "fault"
    assert found.remedy.startswith(remedy)
