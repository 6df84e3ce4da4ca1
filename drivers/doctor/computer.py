"""Checks of this computer: buffers, interfaces, permissions, packages."""

from __future__ import annotations

import platform
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

from .. import computer as kernel
from ..computer import open_firewall
from ..device import Finding, State, size
from ..minolta_ls.meter import find_meter_ports
from ..network import Interface, interface_findings, interfaces
from .meter import SerialPortFacts, serial_port_facts, serial_port_finding


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


_BY_HAND = "check that it has power, its cable, and that it is in the network of one of these interfaces"


def no_camera_finding(known: Sequence[Interface], firewall: str | None, state: State) -> Finding:
    """List possible causes of a camera that does not answer.

    Parameters
    ----------
    known : sequence of Interface
        The computer's.
    firewall : str or None
        Name of an active firewall; empty if none is known.
    state : {'notice', 'fault'}
        Whether a camera was expected.
    """
    ways = [one for one in known if not one.is_loopback and one.is_up and one.has_link]
    topic = "discovery"
    if not ways:
        return Finding(
            topic,
            state,
            "no camera answers, and no network interface with an IPv4 address has a link",
            "connect the camera, give it power, and see the network interfaces above",
        )
    listing = ", ".join(f"{one.name} ({one.address})" for one in ways)
    if firewall is None:
        return Finding(topic, state, f"no camera answers at {listing}", _BY_HAND)
    networks = "; ".join(open_firewall(firewall, str(one.address.network)) for one in ways)
    return Finding(
        topic,
        state,
        f"no camera answers at {listing}, and the firewall {firewall} may keep its answer out",
        f"{_BY_HAND}; then {networks}",
    )


#: A 16-bit frame of a Manta G-505: 2452 x 2056 pixels.
FRAME_BYTES = 2452 * 2056 * 2
#: UDP port of the GigE Vision control protocol.
GVCP_PORT = 3956


@dataclass(frozen=True)
class HostFacts:
    """State of this computer; None for unknown values.

    Parameters
    ----------
    frame_bytes : int
        Bytes of a frame to receive.
    receive_limit_bytes, receive_default_bytes : int or None
        net.core.rmem_max and net.core.rmem_default.
    kept_receive_limit_bytes : int or None
        net.core.rmem_max in the files for the next start.
    packet_sockets : bool or None
        Whether this process has CAP_NET_RAW.
    interpreter : str
        The real file of the running Python.
    interfaces : sequence of Interface
        Those with an IPv4 address.
    port_users : sequence of PortUser or None
        Owners of the UDP port of GigE Vision.
    clock_is_synchronised : bool or None
        Whether a time service keeps the clock.
    aravis : AravisFacts
        Whether Aravis can be loaded.
    serial_ports : sequence of SerialPortFacts
        Those of the computer.
    """

    frame_bytes: int
    receive_limit_bytes: int | None
    receive_default_bytes: int | None
    kept_receive_limit_bytes: int | None
    packet_sockets: bool | None
    interpreter: str
    interfaces: Sequence[Interface]
    port_users: Sequence[PortUser] | None
    clock_is_synchronised: bool | None
    aravis: AravisFacts
    serial_ports: Sequence[SerialPortFacts]


def host_facts(frame_bytes: int = FRAME_BYTES, root: Path = Path("/")) -> HostFacts:
    """Inspect this computer without changing anything or opening a device.

    Parameters
    ----------
    frame_bytes : int
        Bytes of a frame to receive.
    root : Path
        Parent of ``proc``, ``sys``, ``etc`` and ``var``.
    """
    return HostFacts(
        frame_bytes=frame_bytes,
        receive_limit_bytes=kernel.receive_limit_bytes(root),
        receive_default_bytes=kernel.receive_default_bytes(root),
        kept_receive_limit_bytes=kernel.kept_receive_limit_bytes(root),
        packet_sockets=kernel.may_open_packet_sockets(root),
        interpreter=kernel.interpreter(),
        interfaces=interfaces(root),
        port_users=udp_port_users(GVCP_PORT),
        clock_is_synchronised=kernel.clock_is_synchronised(),
        aravis=aravis_facts(root),
        serial_ports=[serial_port_facts(port.device) for port in find_meter_ports()],
    )


def host_findings(facts: HostFacts) -> list[Finding]:
    """Evaluate the state of this computer."""
    optional = [_capabilities(facts), _port(facts), _clock(facts)]
    return [
        Finding("Python", "good", f"{platform.python_version()}, {facts.interpreter}, on {sys.platform}"),
        aravis_finding(facts.aravis),
        _receive_buffer(facts),
        *(finding for finding in optional if finding is not None),
        *interface_findings(facts.interfaces),
        *(serial_port_finding(port, needed=False) for port in facts.serial_ports),
    ]


def _receive_buffer(facts: HostFacts) -> Finding:
    topic, limit, frame = "receive buffer", facts.receive_limit_bytes, facts.frame_bytes
    if limit is None:
        return Finding(topic, "unknown", "net.core.rmem_max cannot be read here", "sysctl net.core.rmem_max tells it")
    default = facts.receive_default_bytes
    text = f"net.core.rmem_max is {size(limit)}, and a frame has up to {size(frame)}"
    if default is not None:
        text += f"; programs that ask for nothing get {size(default)} (rmem_default)"
    keep = kernel.keep_receive_limit(frame)
    if limit < frame:
        remedy = f"{kernel.raise_receive_limit(frame)} (to keep it: {keep})"
        # With CAP_NET_RAW Aravis receives through a packet socket, which this limit does not apply to.
        return Finding(topic, "notice" if facts.packet_sockets else "fault", text, remedy)
    if (facts.kept_receive_limit_bytes or 0) < frame:
        return Finding(topic, "notice", f"until the computer starts again, {text}", keep)
    return Finding(topic, "good", text)


def _capabilities(facts: HostFacts) -> Finding | None:
    topic, limit = "capabilities", facts.receive_limit_bytes
    if facts.packet_sockets is None:
        return None
    if facts.packet_sockets:
        return Finding(topic, "good", "this process has CAP_NET_RAW: frames can come through a packet socket")
    if limit is not None and limit >= facts.frame_bytes:
        return Finding(topic, "good", "no CAP_NET_RAW, which so large a receive buffer makes needless")
    return Finding(
        topic,
        "notice",
        "this process has no CAP_NET_RAW, with which frames come through a packet socket whatever the receive buffer",
        f"raise the receive buffer; or sudo setcap cap_net_raw+ep {facts.interpreter}, which lets every program of "
        "this Python read all packets",
    )


def _port(facts: HostFacts) -> Finding | None:
    topic = f"UDP port {GVCP_PORT}"
    if facts.port_users is None:
        return None
    if not facts.port_users:
        return Finding(topic, "good", "free for a simulated camera")
    known = sorted({user.pid for user in facts.port_users if user.pid is not None})
    end = f"end it (kill {' '.join(map(str, known))})" if known else "end that program"
    return Finding(
        topic,
        "notice",
        f"taken by {', '.join(map(str, facts.port_users))}; real cameras do not need it",
        f"for a simulated camera on the same address {end}, or give it another one (labcdp simulate-bench --address)",
    )


def _clock(facts: HostFacts) -> Finding | None:
    if facts.clock_is_synchronised is None:
        return None
    if facts.clock_is_synchronised:
        return Finding("clock", "good", "kept by a time service")
    return Finding(
        "clock",
        "notice",
        "no time service keeps the computer's clock: recorded times may be off, and may step",
        "sudo timedatectl set-ntp true",
    )


#: Debian's packages that a GigE Vision camera needs.
NEEDED = ("gir1.2-aravis-0.8", "libaravis-0.8-0", "python3-gi")

_DPKG = "dpkg-query"
_LONGEST_S = 10


@dataclass(frozen=True)
class AravisFacts:
    """State of Aravis on this computer.

    Parameters
    ----------
    problem : str
        Why it cannot be loaded, with the remedy; empty if it can.
    pygobject : str
        Version of PyGObject; empty if it cannot be loaded.
    packages : dict or None
        Version of each of `NEEDED` that is installed; None if this is not a Debian system.
    """

    problem: str = ""
    pygobject: str = ""
    packages: dict[str, str] | None = None


def aravis_facts(root: Path = Path("/")) -> AravisFacts:
    """Load Aravis and query Debian's package database below `root`."""
    from ..aravis.library import aravis
    from ..camera import CameraError

    packages = debian_packages(root / "var/lib/dpkg")
    try:
        aravis()
    except CameraError as error:
        return AravisFacts(problem=str(error), packages=packages)
    import gi

    return AravisFacts(pygobject=gi.__version__, packages=packages)


def debian_packages(database: Path) -> dict[str, str] | None:
    """Return the versions of the needed packages that are installed, None if there is no package database."""
    command = [_DPKG, f"--admindir={database}", "--show", "--showformat=${Package} ${Version} ${db:Status-Status}\n"]
    if not (database / "status").exists():
        return None
    try:
        # It fails if one of the packages is unknown, but still lists the others.
        done = subprocess.run(  # noqa: S603
            [*command, *NEEDED], capture_output=True, text=True, timeout=_LONGEST_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    rows = [line.split() for line in done.stdout.splitlines()]
    return {row[0]: row[1] for row in rows if len(row) == 3 and row[2] == "installed"}


def aravis_finding(facts: AravisFacts) -> Finding:
    """Report whether GigE Vision cameras can be used, and otherwise what to install."""
    packages = facts.packages or {}
    versions = ", ".join(f"{name} {version}" for name, version in packages.items())
    if not facts.problem:
        known = f" ({versions})" if versions else ""
        return Finding("Aravis", "good", f"Aravis 0.8 is there, through PyGObject {facts.pygobject}{known}")
    missing = [name for name in NEEDED if name not in packages]
    if facts.packages is not None and missing:
        return Finding(
            "Aravis",
            "fault",
            f"no camera can be used: {' and '.join(missing)} not installed",
            f"sudo apt-get install {' '.join(missing)}",
        )
    return Finding.of_error("Aravis", RuntimeError(facts.problem))
