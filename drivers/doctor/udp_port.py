"""Owner of a UDP port on this computer."""

from __future__ import annotations

from dataclasses import dataclass

import psutil


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


def udp_port_users(port: int) -> list[PortUser] | None:
    """List the sockets bound to a UDP port over IPv4; None if the kernel's list cannot be read."""
    try:
        bound = [one for one in psutil.net_connections("udp4") if one.laddr and one.laddr.port == port]
    except (psutil.Error, OSError):
        return None
    return [PortUser(one.laddr.ip, one.pid, _program(one.pid)) for one in bound]


def _program(pid: int | None) -> str:
    try:
        return "" if pid is None else psutil.Process(pid).name()
    except psutil.Error:
        return ""
