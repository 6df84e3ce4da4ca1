"""Causes and remedies of missing frames."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..camera import StreamStatistics
from .finding import Finding, size
from .kernel import firewall, keep_receive_limit, open_firewall, raise_receive_limit, receive_limit_bytes
from .network import Interface, interface_to, interfaces, network_finding


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
