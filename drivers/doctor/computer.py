"""Checks of this computer: buffers, interfaces, permissions, packages."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import psutil

from ..aravis.gvcp import GVCP_PORT
from ..aravis.library import aravis, aravis_version
from ..camera import CameraError
from ..check import Check, State
from ..computer import (
    clock_is_synchronised,
    keep_receive_limit,
    kept_receive_limit_bytes,
    may_open_packet_sockets,
    network_limit,
    open_firewall,
    raise_receive_limit,
)
from ..device import size
from ..minolta.meter import find_meter_ports
from ..network import Interface, interface_checks, interfaces
from .meter import serial_port_check

#: A 16-bit frame of a Manta G-505: 2452 x 2056 pixels.
FRAME_BYTES = 2452 * 2056 * 2
#: Debian's packages that a GigE Vision camera needs.
NEEDED = ("gir1.2-aravis-0.8", "libaravis-0.8-0", "python3-gi")

_BY_HAND = "check that it has power, its cable, and that it is in the network of one of these interfaces"
#: Longest query of Debian's package database.
_LONGEST_S = 10


def host_checks(root: Path = Path("/")) -> list[Check]:
    """Check this computer without changing anything or opening a device.

    Parameters
    ----------
    root : Path
        Parent of ``proc``, ``sys``, ``etc`` and ``var``.
    """
    # Capabilities cannot be given to a link.
    interpreter = os.path.realpath(sys.executable)
    optional = [port_check(), _clock()]
    return [
        Check("Python", "good", f"{platform.python_version()}, {interpreter}, on {sys.platform}"),
        aravis_check(root),
        _receive_buffer(root),
        _capabilities(root, interpreter),
        *(finding for finding in optional if finding is not None),
        *interface_checks(interfaces(root)),
        *(serial_port_check(port.device, needed=False) for port in find_meter_ports()),
    ]


def _receive_buffer(root: Path) -> Check:
    topic, limit, default = "receive buffer", network_limit("rmem_max", root), network_limit("rmem_default", root)
    if limit is None:
        return Check(topic, "unknown", "net.core.rmem_max cannot be read here", "run sysctl net.core.rmem_max")
    text = f"net.core.rmem_max is {size(limit)}, and a frame needs up to {size(FRAME_BYTES)}"
    if default is not None:
        text += f"; programs that do not set a buffer size get {size(default)} (rmem_default)"
    keep = keep_receive_limit(FRAME_BYTES)
    if limit < FRAME_BYTES:
        remedy = f"{raise_receive_limit(FRAME_BYTES)} (to keep it: {keep})"
        # With CAP_NET_RAW Aravis receives through a packet socket, which this limit does not apply to.
        return Check(topic, "notice" if may_open_packet_sockets() else "fault", text, remedy)
    if (kept_receive_limit_bytes(root) or 0) < FRAME_BYTES:
        return Check(topic, "notice", f"until the next reboot, {text}", keep)
    return Check(topic, "good", text)


def _capabilities(root: Path, interpreter: str) -> Check:
    topic = "capabilities"
    if may_open_packet_sockets():
        return Check(topic, "good", "this process has CAP_NET_RAW: frames can come through a packet socket")
    if (network_limit("rmem_max", root) or 0) >= FRAME_BYTES:
        return Check(topic, "good", "no CAP_NET_RAW, but the receive buffer is large enough without it")
    return Check(
        topic,
        "notice",
        "this process lacks CAP_NET_RAW, with which frames bypass the limit of the receive buffer",
        f"raise the receive buffer; or sudo setcap cap_net_raw+ep {interpreter}, which lets every program of "
        "this Python read all packets",
    )


def port_check(port: int = GVCP_PORT) -> Check | None:
    """Report who has a UDP port over IPv4; None if the kernel's list cannot be read."""
    try:
        bound = [
            connection
            for connection in psutil.net_connections("udp4")
            if connection.laddr and connection.laddr.port == port
        ]
        names = {
            connection.pid: psutil.Process(connection.pid).name() for connection in bound if connection.pid is not None
        }
    except (psutil.Error, OSError):
        return None
    topic = f"UDP port {port}"
    if not bound:
        return Check(topic, "good", "free for a simulated camera")
    users = [
        f"{f'{names[user.pid]} (process {user.pid})' if user.pid is not None else 'a program of another user'} "
        f"on {user.laddr.ip}"
        for user in bound
    ]
    end = f"end it (kill {' '.join(map(str, sorted(names)))})" if names else "end that program"
    return Check(
        topic,
        "notice",
        f"taken by {', '.join(users)}; real cameras do not need it",
        f"for a simulated camera on this address {end}, or choose another one (labcdp simulate-bench --address)",
    )


def _clock() -> Check | None:
    synchronised = clock_is_synchronised()
    if synchronised is None:
        return None
    if synchronised:
        return Check("clock", "good", "synchronised by a time service")
    return Check(
        "clock",
        "notice",
        "the computer's clock is not synchronised: recorded times may be off or jump",
        "sudo timedatectl set-ntp true",
    )


def aravis_check(root: Path = Path("/")) -> Check:
    """Report whether GigE Vision cameras can be used, and otherwise what to install."""
    packages = debian_packages(root / "var/lib/dpkg")
    try:
        aravis()
    except CameraError as error:
        missing = [name for name in NEEDED if packages is not None and name not in packages]
        if not missing:
            return Check.failed("Aravis", error)
        cause = f"no camera can be used: {' and '.join(missing)} not installed"
        return Check("Aravis", "fault", cause, f"sudo apt-get install {' '.join(missing)}")
    import gi

    versions = ", ".join(f"{name} {version}" for name, version in (packages or {}).items())
    known = f"; Debian's packages are {versions}" if versions else ""
    return Check("Aravis", "good", f"{aravis_version()}, with PyGObject {gi.__version__}{known}")


def debian_packages(database: Path = Path("/var/lib/dpkg")) -> dict[str, str] | None:
    """Return the versions of those of `NEEDED` that are installed, None if there is no package database."""
    command = ["dpkg-query", f"--admindir={database}", "--show"]
    command += ["--showformat=${Package} ${Version} ${db:Status-Status}\n", *NEEDED]
    if not (database / "status").exists():
        return None
    try:
        # It fails if one of the packages is unknown, but still lists the others.
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST_S, check=False)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired):
        return None
    rows = [line.split() for line in done.stdout.splitlines()]
    return {row[0]: row[1] for row in rows if len(row) == 3 and row[2] == "installed"}


def no_camera_check(known: Sequence[Interface], firewall: str | None, state: State) -> Check:
    """List possible causes of a camera that does not answer.

    Parameters
    ----------
    known : sequence of Interface
        The computer's.
    firewall : str or None
        Name of an active firewall; None if none is known.
    state : {'notice', 'fault'}
        Whether a camera was expected.
    """
    topic = "discovery"
    ways = [interface for interface in known if not interface.is_loopback and interface.is_up and interface.has_link]
    if not ways:
        cause = "no camera answers, and no network interface with an IPv4 address has a link"
        return Check(topic, state, cause, "connect the camera, give it power, and see the network interfaces above")
    cause = f"no camera answers at {', '.join(f'{interface.name} ({interface.address})' for interface in ways)}"
    if firewall is None:
        return Check(topic, state, cause, _BY_HAND)
    networks = "; ".join(open_firewall(firewall, str(interface.address.network)) for interface in ways)
    cause += f", and the firewall {firewall} may keep its answer out"
    return Check(topic, state, cause, f"{_BY_HAND}; then {networks}")
