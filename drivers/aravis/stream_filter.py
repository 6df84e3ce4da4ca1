"""Filter of the packets of a GigE Vision stream, before Aravis reads them.

Aravis takes packets of any number and length: some end the process, others put pixels in a wrong place of a frame that
counts as good. Layout of the packets: GigE Vision 2.0, sections 24 and 25 (AIA, 2012).
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import Any, Final

from .. import packet_filter
from ..camera import CameraSettingError
from ..computer import own_packet_sockets, own_udp_sockets
from ..packet_filter import ABOVE, AT_LEAST, DROP, EQUAL, HAS_BITS, KEEP, UDP_HEADER_BYTES, Program

#: Bytes of the headers of IP, which GevSCPSPacketSize includes, and of Ethernet.
_IP_BYTES: Final = 20
_ETHERNET_BYTES: Final = 14

#: Bytes of the header of a packet with ids of 16 and of 64 bits, and the flag of the latter.
_SHORT_BYTES, _LONG_BYTES = 8, 20
_LONG_IDS: Final = 0x80

_LEADER, _TRAILER, _PAYLOAD = 1, 2, 3
#: Payload types of leaders: image, chunks, and image with chunks; bytes of theirs without and with a size of the image.
_IMAGE, _CHUNKS, _IMAGE_AND_CHUNKS = 1, 4, 5
_LEADER_BYTES, _IMAGE_LEADER_BYTES = 12, 36

#: New sockets of Aravis can be identified only while no other thread opens a stream.
_opening = threading.Lock()


@dataclass(frozen=True)
class PacketPlan:
    """Packets of a frame.

    Parameters
    ----------
    packet_bytes : int
        Size of a packet with the headers of IP and above (GevSCPSPacketSize).
    payload_bytes : int
        Size of a frame (PayloadSize).
    pixel_bytes : int
        Bytes of its pixels, which come first.
    """

    packet_bytes: int
    payload_bytes: int
    pixel_bytes: int

    def __post_init__(self) -> None:
        if self.packet_bytes <= _IP_BYTES + UDP_HEADER_BYTES + _LONG_BYTES:
            raise CameraSettingError(
                f"the camera's packets have {self.packet_bytes} bytes, not more than their headers",
                "set GevSCPSPacketSize to 576 or more",
            )

    def filter(self, address: str) -> Program:
        """Return the filter of a UDP socket for packets of the camera with this address."""
        return self._from(address, 0) + self._packets(0)

    def filter_of_interface(self, address: str, receiver: tuple[str, int]) -> Program:
        """Return the filter of a packet socket, for packets to address and port of the receiver, without IP options."""
        load, udp = packet_filter.load, _ETHERNET_BYTES + _IP_BYTES
        host, port = receiver
        program = load(12, 2) + packet_filter.require(EQUAL, 0x0800)
        program += load(_ETHERNET_BYTES, 1) + packet_filter.require(EQUAL, 0x45)
        # No fragments; UDP.
        program += load(_ETHERNET_BYTES + 6, 2) + packet_filter.refuse(HAS_BITS, 0x3FFF)
        program += load(_ETHERNET_BYTES + 9, 1) + packet_filter.require(EQUAL, 17)
        program += load(_ETHERNET_BYTES + 16, 4) + packet_filter.require(EQUAL, int(IPv4Address(host)))
        program += load(udp + 2, 2) + packet_filter.require(EQUAL, port)
        # Aravis believes the length in the IP header.
        program += load(udp + 4, 2) + packet_filter.require_sum(_IP_BYTES, load(_ETHERNET_BYTES + 2, 2))
        program += load(_ETHERNET_BYTES + 2, 2)
        program += packet_filter.require_sum(_ETHERNET_BYTES, packet_filter.load_length(), or_more=True)
        return program + self._from(address, udp) + self._packets(udp)

    def _from(self, address: str, udp: int) -> Program:
        return packet_filter.load_source() + packet_filter.require(EQUAL, int(IPv4Address(address)))

    def _packets(self, udp: int) -> Program:
        flags = packet_filter.load(udp + UDP_HEADER_BYTES + 4, 1)
        long = self._kinds(udp, _LONG_BYTES, packet_filter.load(udp + UDP_HEADER_BYTES + 16, 4))
        short_id = packet_filter.load(udp + UDP_HEADER_BYTES + 4, 4) + packet_filter.masked(0x00FFFFFF)
        return flags + packet_filter.when(HAS_BITS, _LONG_IDS, long) + self._kinds(udp, _SHORT_BYTES, short_id)

    def _kinds(self, udp: int, header_bytes: int, packet_id: Program) -> Program:
        """Accept only packets whose length is right for their id."""
        block = self.packet_bytes - _IP_BYTES - UDP_HEADER_BYTES - header_bytes
        n_blocks = -(-self.payload_bytes // block)
        n_full, rest = divmod(self.pixel_bytes, block)
        data, empty = udp + UDP_HEADER_BYTES, UDP_HEADER_BYTES + header_bytes
        length, load = packet_filter.load(udp + 4, 2), packet_filter.load
        require, refuse, when = packet_filter.require, packet_filter.refuse, packet_filter.when

        kind = load(data + header_bytes + 2, 2) + packet_filter.masked(0x3FFF)
        leader = packet_id + require(EQUAL, 0) + length + require(AT_LEAST, empty + _LEADER_BYTES)
        leader += kind + when(EQUAL, _CHUNKS, KEEP) + require(EQUAL, _IMAGE, _IMAGE_AND_CHUNKS)
        leader += length + require(AT_LEAST, empty + _IMAGE_LEADER_BYTES) + KEEP
        # It comes earlier in frames with fewer chunks than they may have.
        trailer = packet_id + require(AT_LEAST, n_full + (rest > 0) + 1) + refuse(ABOVE, n_blocks + 1) + KEEP
        # Such as "no longer in memory": it has no data.
        error = packet_id + refuse(ABOVE, n_blocks + 1) + KEEP
        payload = packet_id + require(AT_LEAST, 1) + refuse(ABOVE, n_blocks)
        behind = length + refuse(ABOVE, empty + block)
        payload += when(ABOVE, n_full + 1, behind + KEEP)
        payload += when(ABOVE, n_full, behind + require(AT_LEAST, empty + rest) + KEEP)
        payload += length + require(EQUAL, empty + block) + KEEP

        content = load(data + 4, 1) + packet_filter.masked(0x7F)
        program = content + when(EQUAL, _LEADER, leader) + when(EQUAL, _TRAILER, trailer) + require(EQUAL, _PAYLOAD)
        return program + load(data, 2) + when(HAS_BITS, 0x8000, error) + payload + DROP


def filtered_stream(camera: Any, address: str, payload_bytes: int, pixel_bytes: int) -> Any:
    """Open a stream of Aravis that receives only packets that have a place in its frames; raises errors of Aravis.

    Parameters
    ----------
    camera : Aravis.Camera
        Open GigE Vision camera, not acquiring.
    address : str
        Its network address.
    payload_bytes, pixel_bytes : int
        As of `PacketPlan`.
    """
    # Aravis divides by what they carry.
    PacketPlan(camera.gv_get_packet_size(), payload_bytes, pixel_bytes)
    with _opening:
        before = {number for number, _ in own_packet_sockets()}
        stream = camera.create_stream(None, None)
        # It may have changed it.
        plan = PacketPlan(camera.gv_get_packet_size(), payload_bytes, pixel_bytes)
        for receiver, bound in own_udp_sockets():
            if bound[1] == stream.get_port():
                packet_filter.attach(receiver, plan.filter(address))
                listening = bound
        for number, receiver in own_packet_sockets():
            if number not in before:
                packet_filter.attach(receiver, plan.filter_of_interface(address, listening))
    return stream
