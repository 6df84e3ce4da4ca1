"""Transport of frames: packet size, bandwidth, packet delay and receive buffer."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..computer import may_open_packet_sockets, raise_receive_limit, receive_buffer_limit
from ..network import Interface, interface_to, interfaces, path_check
from . import gvcp
from .features import available, writable
from .library import aravis
from .packet_size import path_packet_bytes

_log = logging.getLogger(__name__)

#: Bytes on an Ethernet wire in addition to an IP packet: preamble 8, header 14, checksum 4, gap 12 (IEEE 802.3).
_ETHERNET_BYTES = 38

#: Share of a link reserved for other traffic than the stream. With packets of 1500 bytes on a gigabit link the stream
#: then gets 116 MB/s, about what an Allied Vision Manta has after switching on (115 MB/s).
_RESERVED = 0.05

#: Tries of 0.25 s to ask another camera whether it is in use.
_TRIES = 4

#: Where the bandwidth of a camera cannot be set, packet delays stretch a frame over this share of its period.
_STRETCH = 0.5


@dataclass(frozen=True)
class TransportPlan:
    """Settings of the transport; None leaves the camera's value.

    Parameters
    ----------
    packet_size_bytes : int or None
        Size of a stream packet.
    bytes_per_s : int or None
        Bandwidth.
    packet_delay_ns : int or None
        Pause between packets.
    """

    packet_size_bytes: int | None = None
    bytes_per_s: int | None = None
    packet_delay_ns: int | None = None


def plan_transport(
    packet_bytes: int,
    payload_bytes: int,
    frame_rate_hz: float | None,
    interface: Interface | None,
    bandwidth_range: tuple[int, int] | None,
    n_sharing: int = 1,
) -> TransportPlan:
    """Choose packet size, bandwidth and packet delay.

    Packets are never larger than the MTU of the interface. The bandwidth is an equal share of the link; a camera with
    that setting needs no delay. Other cameras send each frame at full speed whatever the frame rate: a delay then
    spreads the packets over half the period, to relieve receiver and switches.

    Parameters
    ----------
    packet_bytes : int
        Size of a stream packet now, headers of IP and above included (GevSCPSPacketSize).
    payload_bytes : int
        Bytes of a frame.
    frame_rate_hz : float or None
        Frame rate, if known.
    interface : Interface or None
        Interface that leads to the camera; None if unknown.
    bandwidth_range : (int, int) or None
        Bytes per second that the camera can be limited to; None if it cannot.
    n_sharing : int
        Cameras in use behind the interface, this one included.

    Returns
    -------
    TransportPlan
        Empty for loopback, where no packets are lost.
    """
    if interface is None or interface.is_loopback:
        return TransportPlan()
    size = interface.mtu_bytes if interface.mtu_bytes < packet_bytes else None
    packet_bytes = size or packet_bytes
    if interface.speed_mbit_s is None:
        return TransportPlan(size)
    wire_bytes_per_s = interface.speed_mbit_s * 1e6 / 8
    if bandwidth_range is not None:
        low, high = bandwidth_range
        carried = wire_bytes_per_s * packet_bytes / (packet_bytes + _ETHERNET_BYTES) * (1 - _RESERVED)
        return TransportPlan(size, max(low, min(high, int(carried / n_sharing))), 0)
    if not frame_rate_hz:
        return TransportPlan(size)
    # 36 bytes of each packet are headers of IP, UDP and GVSP.
    n_packets = -(-payload_bytes // max(1, packet_bytes - 36))
    sending_s = (packet_bytes + _ETHERNET_BYTES) / wire_bytes_per_s
    pause_s = max(0.0, _STRETCH / frame_rate_hz / n_packets - sending_s)
    return TransportPlan(size, None, int(pause_s * 1e9))


def set_up_transport(
    camera: Any, address: str, frame_rate_hz: float | None, chosen: frozenset[str], n_sharing: int
) -> None:
    """Set a GigE Vision camera's transport as planned; raises errors of Aravis.

    Parameters
    ----------
    camera : Aravis.Camera
        Open, not acquiring, with its settings made.
    address : str
        Its network address.
    frame_rate_hz : float or None
        Its frame rate, if known.
    chosen : frozenset of str
        Features set by the user, which are not changed.
    n_sharing : int
        As for `plan_transport`.
    """
    interface = interface_to(address, interfaces())
    bandwidth = available(camera, "StreamBytesPerSecond", "DeviceLinkThroughputLimit")
    bounds = None if bandwidth is None else tuple(camera.get_integer_bounds(bandwidth))
    packet_bytes, payload_bytes = camera.gv_get_packet_size(), camera.get_payload()
    plan = plan_transport(packet_bytes, payload_bytes, frame_rate_hz, interface, bounds, n_sharing)
    if plan.packet_size_bytes is not None and "GevSCPSPacketSize" not in chosen:
        camera.gv_set_packet_size(plan.packet_size_bytes)
    mode = "DeviceLinkThroughputLimitMode"
    if bandwidth is not None and plan.bytes_per_s is not None and bandwidth not in chosen:
        if writable(camera, mode):
            camera.set_string(mode, "On")
        camera.set_integer(bandwidth, plan.bytes_per_s)
    delay = available(camera, "GevSCPD")
    if delay is not None and plan.packet_delay_ns is not None and delay not in chosen:
        camera.gv_set_packet_delay(plan.packet_delay_ns)
    if plan != TransportPlan():
        _log.info("transport from %s by %s: %s", address, interface.name if interface else "?", plan)


def find_neighbours(address: str, timeout_s: float) -> frozenset[str]:
    """Find the addresses of other cameras behind the same interface, for `timeout_s`; none on loopback."""
    interface = interface_to(address, interfaces())
    if interface is None or interface.is_loopback:
        return frozenset()
    with contextlib.suppress(OSError):  # it went down: the camera tells
        return frozenset(other.address for other in gvcp.announce_all(interface.name, timeout_s)) - {address}
    return frozenset()


def ask_neighbours(addresses: Iterable[str]) -> dict[str, bool]:
    """Return which cameras are controlled by a program; one that does not answer any more is left out."""
    # One that streams, or a busy computer, may answer late.
    answers = {address: gvcp.is_controlled(address, _TRIES) for address in addresses}
    return {address: controlled for address, controlled in answers.items() if controlled is not None}


def find_packet_size(camera: Any, address: str) -> int | None:
    """Set the largest packet size that comes through, by test packets, else as Aravis negotiates it.

    Returns
    -------
    int or None
        Size that the path takes, if test packets came.

    Raises
    ------
    GLib.Error
        Errors of Aravis.
    """
    interface = interface_to(address, interfaces())
    if interface is not None and interface.is_loopback:
        camera.gv_set_packet_size_adjustment(aravis().GvPacketSizeAdjustment.NEVER)
        return None
    path_bytes = None if interface is None else _probed_bytes(camera, interface)
    if path_bytes is None or interface is None:
        camera.gv_auto_packet_size()
        return None
    camera.gv_set_packet_size_adjustment(aravis().GvPacketSizeAdjustment.NEVER)
    camera.gv_set_packet_size(path_bytes)
    if (narrow := path_check(path_bytes, interface)) is not None:
        _log.warning("%s", narrow)
    return path_bytes


def _probed_bytes(camera: Any, interface: Interface) -> int | None:
    """Return the largest packet that comes through, up to the camera's limit; None if no test packet came."""
    largest = min(interface.mtu_bytes, *camera.get_integer_bounds("GevSCPSPacketSize")[1:])
    with contextlib.suppress(OSError):
        return path_packet_bytes(camera, str(interface.address.ip), largest)
    return None


def warn_of_small_receive_buffer(payload_bytes: int) -> None:
    """Log a warning with its remedy if the kernel grants no receive buffer for a whole frame."""
    if may_open_packet_sockets():
        return
    granted = receive_buffer_limit(payload_bytes)
    if granted < payload_bytes:
        _log.warning(
            "the kernel grants a receive buffer of %d bytes, but a frame has %d: frames may be lost; run '%s'",
            granted,
            payload_bytes,
            raise_receive_limit(payload_bytes),
        )
