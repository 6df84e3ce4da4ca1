"""The computer: limits, capabilities, ports, packages and permissions, from a tree of files and from this computer."""

import pytest

from labcdp.drivers.doctor import computer


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
