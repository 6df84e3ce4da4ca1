"""Owner of a UDP port on this computer."""

from __future__ import annotations

import os
import socket
import struct
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..host.kernel import read_text


@dataclass(frozen=True)
class PortUser:
    """A socket bound to a UDP port.

    Parameters
    ----------
    address : str
        Local address; ``0.0.0.0`` for all of them.
    pid : int or None
        Process id; None if not visible to this user.
    program : str
        Name of the program; empty if not visible to this user.
    """

    address: str
    pid: int | None = None
    program: str = ""

    def __str__(self) -> str:
        """Return program, process and address."""
        who = "a program of another user" if self.pid is None else f"{self.program} (process {self.pid})"
        return f"{who} on {self.address}"


def udp_port_users(port: int, root: Path = Path("/")) -> list[PortUser] | None:
    """List the sockets bound to a UDP port over IPv4; None if the kernel's list cannot be read.

    Parameters
    ----------
    port : int
        The port.
    root : Path
        Where ``proc`` is.
    """
    text = read_text(root / "proc/net/udp")
    if text is None:
        return None
    bound: dict[str, str] = {}
    for line in text.splitlines()[1:]:
        fields = line.split()
        if len(fields) < 10 or not fields[1].endswith(f":{port:04X}"):
            continue
        bound[fields[9]] = _dotted(fields[1].split(":")[0])
    owners = _owners(set(bound), root) if bound else {}
    return [PortUser(address, *owners.get(inode, (None, ""))) for inode, address in bound.items()]


def _dotted(hexadecimal: str) -> str:
    """Return an address that the kernel printed as one number in its own byte order."""
    return socket.inet_ntoa(struct.pack("=I", int(hexadecimal, 16)))


def _owners(inodes: set[str], root: Path) -> dict[str, tuple[int, str]]:
    """Find the processes that hold sockets, as far as permitted."""
    wanted = {f"socket:[{inode}]": inode for inode in inodes}
    found: dict[str, tuple[int, str]] = {}
    for process in (root / "proc").glob("[0-9]*"):
        for target in _descriptors(process) & wanted.keys():
            found[wanted[target]] = (int(process.name), (read_text(process / "comm") or "").strip())
    return found


def _descriptors(process: Path) -> set[str]:
    """Return the targets of a process's open files; empty for other users' processes."""
    targets = set()
    with suppress(OSError):
        for descriptor in (process / "fd").iterdir():
            with suppress(OSError):  # closed in between
                targets.add(os.readlink(descriptor))
    return targets
