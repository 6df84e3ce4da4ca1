"""Network interfaces of this computer, and which of them leads to a camera."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Interface
from itertools import combinations
from pathlib import Path
from typing import Any

import psutil

from .camera import StreamStatistics
from .computer import firewall, keep_receive_limit, open_firewall, raise_receive_limit, read_int, receive_limit_bytes
from .device import Finding, size

#: MTU of an interface with jumbo frames.
JUMBO_BYTES = 9000
#: Nominal speed of GigE Vision.
GIGABIT_MBIT_S = 1000

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
    speed = read_int(root / "sys/class/net" / name / "speed")
    filters = [read_int(root / "proc/sys/net/ipv4/conf" / which / "rp_filter") or 0 for which in ("all", name)]
    return Interface(
        name=name,
        address=IPv4Interface(f"{address.address}/{address.netmask}"),
        is_up="up" in flags,
        has_link="running" in flags,
        is_loopback="loopback" in flags,
        mtu_bytes=states[name].mtu,
        speed_mbit_s=speed if speed is not None and speed > 0 else None,
        strict_reverse_path=max(filters) == 1,
    )


def interface_to(address: str, known: Sequence[Interface]) -> Interface | None:
    """Return the interface by which the kernel reaches an IPv4 address, None if there is no way or it is no address."""
    try:
        wanted = IPv4Address(address)
    except ValueError:
        return None
    if any(one.address.ip == wanted for one in known):
        # Its own address is reached inside the computer.
        return next((one for one in known if one.is_loopback), None)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
            asking.connect((str(wanted), _SOME_PORT))
            own = IPv4Address(asking.getsockname()[0])
    except OSError:
        return None
    exactly = [one for one in known if one.address.ip == own]
    return next(iter(exactly or [one for one in known if own in one.address.network]), None)


def network_finding(address: str, interface: Interface) -> Finding | None:
    """Return a finding if a camera's address is outside the network of the interface that leads to it."""
    try:
        wanted = IPv4Address(address)
    except ValueError:
        return None
    if interface.is_loopback or wanted in interface.address.network:
        return None
    strict = f", and {interface.name} drops what comes from elsewhere (rp_filter)"
    return Finding(
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
    own = network[10] if network[10] != camera else network[11]
    return IPv4Interface(f"{own}/{bits}")


def interface_findings(known: Sequence[Interface]) -> list[Finding]:
    """Judge the network interfaces as ways to a GigE Vision camera; loopback is left out."""
    real = [one for one in known if not one.is_loopback]
    if not real:
        return [
            Finding(
                "network",
                "notice",
                "no network interface has an IPv4 address: no GigE Vision camera can be reached",
                "connect the camera's interface and give it an address of the camera's network, for example sudo ip "
                "addr add 169.254.0.10/16 dev INTERFACE",
            )
        ]
    found = [finding for one in real for finding in _judged(one)]
    for one, other in combinations(real, 2):
        if one.name != other.name and one.address.network.overlaps(other.address.network):
            found.append(
                Finding(
                    f"interface {other.name}",
                    "notice",
                    f"{one.name} ({one.address}) and {other.name} ({other.address}) are in one network: a camera "
                    "behind one of them may be looked for behind the other",
                    f"give them different networks, for example sudo ip addr del {other.address} dev {other.name}",
                )
            )
    return found


def _judged(one: Interface) -> list[Finding]:
    topic = f"interface {one.name}"
    if not one.is_up:
        return [Finding(topic, "notice", f"{one.address} is switched off", f"sudo ip link set {one.name} up")]
    if not one.has_link:
        return [
            Finding(topic, "notice", f"{one.address} has no link", "check the cable, and that the camera has power")
        ]
    found = []
    if one.speed_mbit_s is not None and one.speed_mbit_s < GIGABIT_MBIT_S:
        found.append(
            Finding(
                topic,
                "notice",
                f"{one.address} runs at {one.speed_mbit_s} Mbit/s: a GigE Vision camera needs {GIGABIT_MBIT_S}",
                "use a cable of category 5e or better, and a gigabit port at both ends",
            )
        )
    if one.mtu_bytes < JUMBO_BYTES:
        found.append(
            Finding(
                topic,
                "notice",
                f"{one.address} takes packets of {one.mtu_bytes} bytes; jumbo frames of {JUMBO_BYTES} cost less "
                "computing time and lose less",
                f"sudo ip link set {one.name} mtu {JUMBO_BYTES}, if it is the camera's interface and every switch "
                "between takes them",
            )
        )
    if found:
        return found
    speed = "" if one.speed_mbit_s is None else f", {one.speed_mbit_s} Mbit/s"
    return [Finding(topic, "good", f"{one.address}, packets of {one.mtu_bytes} bytes{speed}")]


@dataclass(frozen=True)
class StreamFacts:
    """State of a stream with missing or incomplete frames.

    Parameters
    ----------
    address : str
        Network address of the camera; empty if it is not on a network.
    payload_bytes : int
        Bytes of a frame.
    packet_size_bytes : int or None
        Size of a stream packet as the camera has it (GevSCPSPacketSize), headers included.
    socket_buffer_bytes : int or None
        Receive buffer the kernel granted; None if unknown.
    counted : StreamStatistics
        The stream's counters.
    """

    address: str
    payload_bytes: int
    packet_size_bytes: int | None = None
    socket_buffer_bytes: int | None = None
    counted: StreamStatistics = field(default_factory=StreamStatistics)


def stream_causes(facts: StreamFacts) -> list[Finding]:
    """List possible causes of missing frames, the most likely first; only reads the host's settings.

    Parameters
    ----------
    facts : StreamFacts
        State of the stream.

    Returns
    -------
    list of Finding
        Faults certainly prevent frames, notices may; empty if no problem is known.
    """
    if not facts.address:
        return causes_at(facts)
    return causes_at(facts, interface_to(facts.address, interfaces()), receive_limit_bytes(), firewall())


def causes_at(
    facts: StreamFacts, interface: Interface | None = None, limit_bytes: int | None = None, wall: str | None = None
) -> list[Finding]:
    """List possible causes as `stream_causes`, for an interface to the camera, net.core.rmem_max and a firewall."""
    something_came = facts.counted.completed + facts.counted.failed + facts.counted.missing > 0
    buffer, packets = _receive_buffer(facts, limit_bytes), packet_size_finding(facts.packet_size_bytes, interface)
    away = None if interface is None else network_finding(facts.address, interface)
    if not something_came:
        # Packets larger than the path MTU never arrive; with a small buffer the first ones do.
        found = [packets, away, buffer, _firewall(facts, interface, wall)]
    else:
        found = [buffer, packets, _missing(facts), away]
    return [finding for finding in [*found, _underruns(facts)] if finding is not None]


def _receive_buffer(facts: StreamFacts, limit: int | None) -> Finding | None:
    granted = facts.socket_buffer_bytes
    if granted is None or granted >= facts.payload_bytes:
        return None
    cause = f"the receive buffer of {size(granted)} does not hold a frame of {size(facts.payload_bytes)}"
    if limit is not None and limit >= facts.payload_bytes:
        return Finding(
            "receive buffer",
            "fault",
            f"{cause}, though net.core.rmem_max allows {size(limit)}",
            "close the camera and open it again",
        )
    return Finding(
        "receive buffer",
        "fault",
        cause,
        f"{raise_receive_limit(facts.payload_bytes)} (to keep it: {keep_receive_limit(facts.payload_bytes)})",
    )


def packet_size_finding(packet_bytes: int | None, interface: Interface | None) -> Finding | None:
    """Return a finding if the camera's packets exceed the MTU of the interface."""
    if packet_bytes is None or interface is None or packet_bytes <= interface.mtu_bytes:
        return None
    return Finding(
        "packet size",
        "fault",
        f"the camera sends packets of {packet_bytes} bytes, but {interface.name} takes {interface.mtu_bytes}",
        f"sudo ip link set {interface.name} mtu {packet_bytes}, or set the camera's GevSCPSPacketSize to "
        f"{interface.mtu_bytes}",
    )


def _missing(facts: StreamFacts) -> Finding | None:
    if facts.counted.missing == 0:
        return None
    return Finding(
        "packets",
        "notice",
        f"{facts.counted.missing} packets are counted as missing",
        "check cable and switch, lower the frame rate or the camera's bandwidth, or raise the packet delay",
    )


def _underruns(facts: StreamFacts) -> Finding | None:
    if facts.counted.underruns == 0:
        return None
    return Finding(
        "underruns",
        "notice",
        f"{facts.counted.underruns} packets found no free buffer, since the program was too slow to take them",
        "lower the frame rate, or do less between two frames",
    )


def _firewall(facts: StreamFacts, interface: Interface | None, wall: str | None) -> Finding | None:
    if not facts.address or (interface is not None and interface.is_loopback):
        return None
    remedy = open_firewall(wall, facts.address)
    if wall is None:
        return Finding("firewall", "unknown", "a firewall may keep the camera's packets out", remedy)
    return Finding("firewall", "notice", f"the firewall {wall} is on and may keep the camera's packets out", remedy)
