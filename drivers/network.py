"""Network interfaces of this computer, and which of them leads to a camera."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface
from itertools import combinations
from pathlib import Path
from typing import Any

import psutil

from .camera import StreamStatistics
from .check import Check
from .computer import firewall, keep_receive_limit, network_limit, open_firewall, raise_receive_limit, read_int
from .device import size

#: MTU of an interface with jumbo frames.
JUMBO_BYTES = 9000
#: Nominal speed of GigE Vision.
GIGABIT_MBIT_S = 1000

#: Largest step of packet sizes of cameras.
_SIZE_STEP_BYTES = 16

#: Arbitrary port: connecting a UDP socket sends nothing.
_SOME_PORT = 3956


@dataclass(frozen=True)
class Interface:
    """A network interface with one of its IPv4 addresses.

    Parameters
    ----------
    name : str
        For example ``eth0``.
    address : IPv4Interface
        Address and network.
    is_up, has_link : bool
        Whether it is up, and whether it has a link.
    is_loopback : bool
        Whether it is a loopback interface.
    mtu_bytes : int
        Largest IP packet (MTU).
    speed_mbit_s : int or None
        Speed of the link; None if unknown (loopback, radio, no link).
    strict_reverse_path : bool
        Whether packets are dropped whose answer would leave by another interface (rp_filter = 1).
    """

    name: str
    address: IPv4Interface
    is_up: bool = True
    has_link: bool = True
    is_loopback: bool = False
    mtu_bytes: int = 1500
    speed_mbit_s: int | None = None
    strict_reverse_path: bool = False


def interfaces(root: Path = Path("/")) -> list[Interface]:
    """List the interfaces that have an IPv4 address; one entry for each address, none if they cannot be read."""
    try:
        states, known = psutil.net_if_stats(), psutil.net_if_addrs()
    except OSError:
        return []
    return [
        _interface(label.split(":")[0], address, states, root)
        for label, addresses in known.items()
        for address in addresses
        # It may be removed in between.
        if address.family == socket.AF_INET and label.split(":")[0] in states
    ]


def _interface(name: str, address: Any, states: dict[str, Any], root: Path) -> Interface:
    flags = states[name].flags.split(",")
    filters = [read_int(root / "proc/sys/net/ipv4/conf" / which / "rp_filter") or 0 for which in ("all", name)]
    return Interface(
        name=name,
        address=IPv4Interface(f"{address.address}/{address.netmask}"),
        is_up="up" in flags,
        has_link="running" in flags,
        is_loopback="loopback" in flags,
        mtu_bytes=states[name].mtu,
        speed_mbit_s=states[name].speed or None,
        strict_reverse_path=max(filters) == 1,
    )


def interface_to(address: str, known: Sequence[Interface]) -> Interface | None:
    """Return the interface by which the kernel reaches an IPv4 address, None if there is no way or it is no address."""
    try:
        wanted = IPv4Address(address)
    except ValueError:
        return None
    if any(interface.address.ip == wanted for interface in known):
        # Its own address is reached inside the computer.
        return next((interface for interface in known if interface.is_loopback), None)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
            asking.connect((str(wanted), _SOME_PORT))
            source = IPv4Address(asking.getsockname()[0])
    except OSError:
        return None
    exactly = [interface for interface in known if interface.address.ip == source]
    return next(iter(exactly or [interface for interface in known if source in interface.address.network]), None)


def network_check(address: str, interface: Interface) -> Check | None:
    """Return a finding if a camera's address is outside the network of the interface that leads to it."""
    try:
        wanted = IPv4Address(address)
    except ValueError:
        return None
    if interface.is_loopback or wanted in interface.address.network:
        return None
    strict = f", and {interface.name} drops what comes from elsewhere (rp_filter)"
    return Check(
        "network",
        "fault" if interface.strict_reverse_path else "notice",
        f"the camera's address {address} is outside the network {interface.address.network} of {interface.name}"
        f"{strict if interface.strict_reverse_path else ''}",
        f"sudo ip addr add {_beside(wanted)} dev {interface.name}, or give the camera an address of that network "
        "(labcdp devices --set-address SERIAL=ADDRESS)",
    )


def _beside(camera: IPv4Address) -> IPv4Interface:
    """Return an address for this computer in the likely network of a camera."""
    # Cameras that find no server give themselves a link-local address (RFC 3927), whose network has 16 bits.
    bits = 16 if camera.is_link_local else 24
    network = IPv4Interface(f"{camera}/{bits}").network
    suggestion = network[10] if network[10] != camera else network[11]
    return IPv4Interface(f"{suggestion}/{bits}")


def interface_checks(known: Sequence[Interface]) -> list[Check]:
    """Judge the network interfaces as ways to a GigE Vision camera; loopback is left out."""
    real = [interface for interface in known if not interface.is_loopback]
    if not real:
        return [
            Check(
                "network",
                "notice",
                "no network interface has an IPv4 address: no GigE Vision camera can be reached",
                "connect the camera's interface and give it an address of the camera's network, for example sudo ip "
                "addr add 169.254.0.10/16 dev INTERFACE",
            )
        ]
    checks = [finding for interface in real for finding in _judged(interface)]
    for interface, other in combinations(real, 2):
        if interface.name != other.name and interface.address.network.overlaps(other.address.network):
            cause = (
                f"{interface.name} ({interface.address}) and {other.name} ({other.address}) are in the same network: "
                "a camera on one of them may be searched for on the other"
            )
            remedy = f"give them different networks, for example sudo ip addr del {other.address} dev {other.name}"
            checks.append(Check(f"interface {other.name}", "notice", cause, remedy))
    return checks


def _judged(interface: Interface) -> list[Check]:
    slow = interface.speed_mbit_s is not None and interface.speed_mbit_s < GIGABIT_MBIT_S
    problems: list[tuple[bool, str, str]] = [
        (not interface.is_up, "is switched off", f"sudo ip link set {interface.name} up"),
        (not interface.has_link, "has no link", "check the cable, and that the camera has power"),
        (
            slow,
            f"runs at {interface.speed_mbit_s} Mbit/s: a GigE Vision camera needs {GIGABIT_MBIT_S}",
            "use a cable of category 5e or better, and a gigabit port at both ends",
        ),
        (
            interface.mtu_bytes < JUMBO_BYTES,
            f"takes packets of {interface.mtu_bytes} bytes; jumbo frames of {JUMBO_BYTES} need less computing time and "
            "lose fewer packets",
            f"sudo ip link set {interface.name} mtu {JUMBO_BYTES}, if it is the camera's interface and every switch "
            "between takes them",
        ),
    ]
    topic = f"interface {interface.name}"
    notices = [
        Check(topic, "notice", f"{interface.address} {cause}", remedy) for there, cause, remedy in problems if there
    ]
    if notices:
        # Without power or link there is nothing else to say.
        return notices if interface.is_up and interface.has_link else notices[:1]
    speed = "" if interface.speed_mbit_s is None else f", {interface.speed_mbit_s} Mbit/s"
    return [Check(topic, "good", f"{interface.address}, packets of {interface.mtu_bytes} bytes{speed}")]


def stream_causes(
    address: str,
    payload_bytes: int,
    packet_bytes: int | None = None,
    granted_bytes: int | None = None,
    counted: StreamStatistics = StreamStatistics(),  # noqa: B008 - immutable
    root: Path = Path("/"),
) -> list[Check]:
    """List possible causes of missing or incomplete frames, the most likely first; only reads the host's settings.

    Parameters
    ----------
    address : str
        Network address of the camera; empty if it is not on a network.
    payload_bytes : int
        Bytes of a frame.
    packet_bytes : int or None
        Size of a stream packet as the camera has it (GevSCPSPacketSize), headers included.
    granted_bytes : int or None
        Receive buffer the kernel granted; None if unknown.
    counted : StreamStatistics
        The stream's counters.
    root : Path
        Parent of ``proc``, ``sys``, ``etc`` and ``run``.

    Returns
    -------
    list of Check
        Faults certainly prevent frames, notices may; empty if no problem is known.
    """
    interface = interface_to(address, interfaces(root)) if address else None
    buffer, packets = _receive_buffer(payload_bytes, granted_bytes, root), packet_size_check(packet_bytes, interface)
    away = None if interface is None else network_check(address, interface)
    if counted.completed + counted.failed + counted.missing:
        causes = [buffer, packets, resend_check(counted), _missing(counted.missing), away]
    else:
        # Packets larger than the path MTU never arrive; with a small buffer the first ones do.
        loopback = not address or (interface is not None and interface.is_loopback)
        causes = [packets, away, buffer, None if loopback else _firewall(address, firewall(root))]
    return [finding for finding in [*causes, _underruns(counted.underruns)] if finding is not None]


def _receive_buffer(payload_bytes: int, granted_bytes: int | None, root: Path) -> Check | None:
    if granted_bytes is None or granted_bytes >= payload_bytes:
        return None
    cause = f"the receive buffer of {size(granted_bytes)} does not hold a frame of {size(payload_bytes)}"
    remedy = f"{raise_receive_limit(payload_bytes)} (to keep it: {keep_receive_limit(payload_bytes)})"
    limit = network_limit("rmem_max", root)
    if limit is not None and limit >= payload_bytes:
        cause += f", though net.core.rmem_max allows {size(limit)}"
        remedy = "close the camera and open it again"
    return Check("receive buffer", "fault", cause, remedy)


def packet_size_check(packet_bytes: int | None, interface: Interface | None) -> Check | None:
    """Return a finding if the camera's packets exceed the MTU of the interface."""
    if packet_bytes is None or interface is None or packet_bytes <= interface.mtu_bytes:
        return None
    return Check(
        "packet size",
        "fault",
        f"the camera sends packets of {packet_bytes} bytes, but {interface.name} takes {interface.mtu_bytes}",
        f"sudo ip link set {interface.name} mtu {packet_bytes}, or set the camera's GevSCPSPacketSize to "
        f"{interface.mtu_bytes}",
    )


def path_check(path_bytes: int | None, interface: Interface | None, camera_bytes: int | None = None) -> Check | None:
    """Return a finding if larger packets than the path takes would leave the camera and fit the interface.

    Parameters
    ----------
    path_bytes : int or None
        Largest packet that came through; None if no test packet was sent.
    interface : Interface or None
        That leads to the camera.
    camera_bytes : int or None
        Largest packet of the camera, if known.
    """
    if path_bytes is None or interface is None:
        return None
    possible = min(interface.mtu_bytes, camera_bytes or interface.mtu_bytes)
    # Cameras round the size down, in steps of up to 8 bytes.
    if path_bytes >= possible - _SIZE_STEP_BYTES:
        return None
    return Check(
        "path",
        "notice",
        f"packets above {path_bytes} bytes do not come through, though {interface.name} takes {interface.mtu_bytes}: a "
        "switch between camera and computer takes no larger ones",
        f"use a switch with jumbo frames or none, or keep packets of {path_bytes} bytes, as set now",
    )


def _missing(n_packets: int) -> Check | None:
    cause = "packets are missing"
    remedy = "check cable and switch, lower the frame rate or the camera's bandwidth, or raise the packet delay"
    return Check("packets", "notice", cause, remedy) if n_packets else None


def resend_check(counted: StreamStatistics) -> Check | None:
    """Return a finding if packets came again that do not belong where they came: too late, twice or by a wrong number.

    Cameras and switches have been reported whose resent packets put pixels in a wrong place of frames that count as
    complete: stripes.
    """
    remedy = 'set packet_resend = "never" in [camera]: incomplete frames are then taken again'
    strange = counted.duplicated + counted.ignored
    if not strange and counted.failed and counted.requested > 2 * counted.resent:
        cause = (
            f"of {counted.requested} packets that were asked for again {counted.resent} came in time for their frame"
        )
        return Check("resent packets", "notice", cause, remedy)
    cause = (
        f"{counted.requested} packets were asked for again and {counted.resent} came, but {counted.duplicated} packets "
        f"came twice and {counted.ignored} too late or with a wrong number: frames that count as complete may have "
        "stripes"
    )
    return Check("resent packets", "notice", cause, remedy) if strange and counted.requested else None


def _underruns(n_packets: int) -> Check | None:
    cause = "packets found no free buffer, since the program was too slow to take them"
    remedy = "lower the frame rate, or do less between two frames"
    return Check("underruns", "notice", cause, remedy) if n_packets else None


def _firewall(address: str, wall: str | None) -> Check:
    remedy = open_firewall(wall, address)
    if wall is None:
        return Check("firewall", "unknown", "a firewall may keep the camera's packets out", remedy)
    return Check("firewall", "notice", f"the firewall {wall} is on and may keep the camera's packets out", remedy)
