"""The host: limits, capabilities, ports, packages and permissions, from a tree of files and from this computer."""

import ctypes
import os
import shutil
import socket
import subprocess
import sys
from dataclasses import replace
from ipaddress import IPv4Interface
from pathlib import Path

import pytest

from labcdp.drivers.diagnosis import Finding, kernel
from labcdp.drivers.diagnosis.host import FRAME_BYTES, HostFacts, host_facts, host_findings
from labcdp.drivers.diagnosis.network import Interface
from labcdp.drivers.diagnosis.packages import NEEDED, AravisFacts, aravis_facts, aravis_finding, debian_packages
from labcdp.drivers.diagnosis.serial_port import SerialPortFacts, serial_port_facts, serial_port_finding
from labcdp.drivers.diagnosis.udp_port import PortUser, udp_port_users

NO_NET_RAW = "CapEff:\t0000000000000400\n"
NET_RAW = "CapEff:\t0000000000002000\n"
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


def test_every_file_that_is_missing_is_unknown_and_not_an_error(tmp_path):
    facts = host_facts(root=tmp_path)
    assert facts.receive_limit_bytes is None
    assert facts.kept_receive_limit_bytes is None
    assert facts.packet_sockets is None
    assert facts.port_users is None
    assert facts.aravis.packages is None
    assert finding(facts, "receive buffer").state == "unknown"


# Receive buffer


def test_the_limits_are_read(tmp_path):
    write(tmp_path, "proc/sys/net/core/rmem_max", "212992\n")
    write(tmp_path, "proc/sys/net/core/rmem_default", "106496\n")
    assert (kernel.receive_limit_bytes(tmp_path), kernel.receive_default_bytes(tmp_path)) == (212_992, 106_496)


def test_the_limit_is_the_kernels():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        limit, default = kernel.receive_limit_bytes(), kernel.receive_default_bytes()
        if limit is None:
            pytest.skip("this kernel hides net.core.rmem_max in a network of its own")
        assert one.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) == default
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**30)
        # socket(7): the kernel doubles what it grants.
        assert one.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) == 2 * limit


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


def test_a_limit_of_exactly_a_frame_is_enough():
    assert finding(replace(GOOD, receive_limit_bytes=FRAME_BYTES), "receive buffer").state == "good"
    assert finding(replace(GOOD, receive_limit_bytes=FRAME_BYTES - 1), "receive buffer").state == "fault"


@pytest.mark.parametrize("kept", [None, 212_992])
def test_a_limit_that_the_next_start_forgets(kept):
    found = finding(replace(GOOD, kept_receive_limit_bytes=kept), "receive buffer")
    assert (found.state, found.remedy) == ("notice", KEEP)
    assert found.cause.startswith("until the computer starts again, net.core.rmem_max is 33.6 MB")


@pytest.mark.parametrize(
    "name", ["etc/sysctl.conf", "etc/sysctl.d/90-camera.conf", "usr/lib/sysctl.d/x.conf", "run/sysctl.d/x.conf"]
)
def test_what_is_kept_is_found_wherever_it_stands(tmp_path, name):
    write(tmp_path, "etc/sysctl.d/10-other.conf", "# net.core.rmem_max = 1\nnet.core.wmem_max=2\nnet.core.rmem_max=3\n")
    write(tmp_path, name, " net/core/rmem_max = 33554432\n")
    assert kernel.kept_receive_limit_bytes(tmp_path) == 33_554_432


def test_the_command_that_keeps_it_does_keep_it(tmp_path):
    (tmp_path / "etc/sysctl.d").mkdir(parents=True)
    command = kernel.keep_receive_limit(FRAME_BYTES).replace("sudo ", "").replace("/etc", f"{tmp_path}/etc")
    subprocess.run(["sh", "-c", command], check=True, capture_output=True)
    assert kernel.kept_receive_limit_bytes(tmp_path) == 33_554_432


# Capabilities


@pytest.mark.parametrize(("text", "has"), [(NO_NET_RAW, False), (NET_RAW, True), ("CapInh:\t0\n", None)])
def test_capabilities_are_read(tmp_path, text, has):
    write(tmp_path, "proc/self/status", f"Name:\tpython\n{text}Seccomp:\t0\n")
    assert kernel.may_open_packet_sockets(tmp_path) is has


def test_the_capability_is_what_lets_a_packet_socket_open():
    try:
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW).close()
        may = True
    except PermissionError:
        may = False
    assert kernel.may_open_packet_sockets() is may


def test_the_capability_is_worth_a_notice_only_where_the_buffer_is_small():
    assert finding(GOOD, "capabilities").state == "good"
    found = finding(replace(GOOD, receive_limit_bytes=212_992), "capabilities")
    assert found.state == "notice"
    assert "sudo setcap cap_net_raw+ep /usr/bin/python3.11, which" in found.remedy
    assert finding(replace(GOOD, receive_limit_bytes=212_992, packet_sockets=True), "capabilities").state == "good"


def test_the_interpreter_is_a_file_and_no_link():
    path = Path(kernel.interpreter())
    assert path.is_file()
    assert not path.is_symlink()


# Clock and firewall


def test_a_clock_that_nobody_keeps():
    found = finding(replace(GOOD, clock_is_synchronised=False), "clock")
    assert (found.state, found.remedy) == ("notice", "sudo timedatectl set-ntp true")
    assert all(one.topic != "clock" for one in host_findings(replace(GOOD, clock_is_synchronised=None)))


def test_the_clock_is_judged_as_by_its_status():
    class Timex(ctypes.Structure):
        _fields_ = (
            ("modes", ctypes.c_uint),
            *((name, ctypes.c_long) for name in ("offset", "frequency", "largest_error", "estimated_error")),
            ("status", ctypes.c_int),
            ("rest", ctypes.c_byte * 256),
        )

    clock = Timex()
    if ctypes.CDLL(None).adjtimex(ctypes.byref(clock)) < 0:
        assert kernel.clock_is_synchronised() is None
    else:
        # STA_UNSYNC of adjtimex(2).
        assert kernel.clock_is_synchronised() is not bool(clock.status & 0x40)


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


def test_a_port_nobody_has_is_free():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
        assert [user.pid for user in udp_port_users(port)] == [os.getpid()]
    assert udp_port_users(port) == []


HEADER = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n"
ROW = " {n}: {address}:{port} 00000000:0000 07 00000000:00000000 00:00000000 00000000  1000        0 {inode} 2 0 0\n"


def test_a_program_of_another_user_is_not_named(tmp_path):
    rows = ROW.format(n=1, address="00000000", port="0F74", inode=11) + ROW.format(
        n=2, address="0100007F", port="1F74", inode=12
    )
    write(tmp_path, "proc/net/udp", HEADER + rows + "cut off\n")
    (tmp_path / "proc/5/fd").mkdir(parents=True)
    (tmp_path / "proc/5/fd/3").symlink_to("socket:[99]")
    assert udp_port_users(3956, tmp_path) == [PortUser("0.0.0.0")]


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
    monkeypatch.setitem(sys.modules, "gi", None)  # as if PyGObject were not there
    write(tmp_path, "var/lib/dpkg/status", status("python3-gi", "3.42.2-3+b1"))
    (tmp_path / "var/lib/dpkg/updates").mkdir()
    found = aravis_finding(aravis_facts(tmp_path))
    assert (found.state, found.remedy) == ("fault", "sudo apt-get install gir1.2-aravis-0.8 libaravis-0.8-0")
    assert found.cause == "no camera can be used: gir1.2-aravis-0.8 and libaravis-0.8-0 not installed"


def test_packages_that_this_python_does_not_see(monkeypatch):
    monkeypatch.setitem(sys.modules, "gi", None)
    facts = replace(aravis_facts(Path("/nowhere")), packages=dict.fromkeys(NEEDED, "1"))
    found = aravis_finding(facts)
    assert found.state == "fault"
    assert "--system-site-packages" in found.remedy


def test_aravis_where_it_is_installed(aravis):
    facts = aravis_facts()
    assert facts.problem == ""
    found = aravis_finding(facts)
    assert found.state == "good"
    import gi

    assert f"PyGObject {gi.__version__}" in found.cause


# Serial ports


def test_a_pseudo_terminal_of_our_own_may_be_opened():
    ours, theirs = os.openpty()
    try:
        name = os.ttyname(theirs)
        found = serial_port_finding(serial_port_facts(name), needed=True)
    finally:
        os.close(ours)
        os.close(theirs)
    assert found.topic == f"serial port {name}"
    assert found.state == "good"
    assert "(crw" in found.cause


def test_what_is_there_but_no_serial_port(tmp_path):
    (tmp_path / "file").touch()
    found = serial_port_finding(serial_port_facts(str(tmp_path / "file")), needed=True)
    assert found.cause == f"{tmp_path}/file is not a serial port"
    found = serial_port_finding(serial_port_facts(str(tmp_path / "ttyNONE")), needed=True)
    assert str(found) == (
        f"there is no {tmp_path}/ttyNONE: plug the adapter in, or choose one of the ports that labcdp devices lists"
    )


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


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_another_user_is_not_let_into_our_terminal():
    ours, theirs = os.openpty()
    child = -1
    try:
        name = os.ttyname(theirs)
        os.chmod(name, 0o620)
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            # A user and a group that nobody has; modules are imported already.
            try:
                os.setgroups([])
                os.setgid(54_321)
                os.setuid(54_321)
                facts = serial_port_facts(name)
                os.write(writing, f"{facts.may_open} {facts.user} {facts.in_group} {facts.mode}".encode())
            finally:
                os._exit(0)
        os.close(writing)
        with os.fdopen(reading) as pipe:
            assert pipe.read() == "False 54321 False crw--w----"
    finally:
        if child > 0:
            os.waitpid(child, 0)
        os.close(ours)
        os.close(theirs)


# The whole


def test_this_computer_is_looked_at():
    topics = [one.topic for one in host_findings(host_facts())]
    assert topics[:3] == ["Python", "Aravis", "receive buffer"]
    assert "UDP port 3956" in topics
