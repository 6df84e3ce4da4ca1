"""Packets that a simulated camera sends again on request, rightly or with the faults of real cameras and switches.

Aravis' simulator cannot: a packet socket sees the requests, and a socket of the camera's address sends the packets.
That takes CAP_NET_RAW, as root has it. Layout of requests and packets: GigE Vision 2.0, sections 16.6 and 24 (AIA,
2012).
"""

from __future__ import annotations

import errno
import os
import select
import socket
import struct
import threading
from collections import OrderedDict
from ipaddress import IPv4Address
from typing import Final

from .. import packet_filter
from ..aravis.gvcp import GVCP_PORT, STREAM_CHANNEL_ADDRESS, STREAM_CHANNEL_PACKET_SIZE, STREAM_CHANNEL_PORT
from ..camera import CameraError
from ..packet_filter import EQUAL, HAS_BITS, KEEP
from .device import Registers
from .sender import SentFrame

#: Register of the abilities of the control protocol, and its bit for packets sent again.
CAPABILITY: Final = 0x0934
CAN_RESEND: Final = 1 << 2

_COMMAND: Final = 0x0040
_ETHERNET_BYTES, _IP_BYTES, _UDP_BYTES = 14, 20, 8
#: Flag of a request with a frame id of 64 bits, which follows.
_LONG_IDS: Final = 1 << 4
#: Frames that are kept.
_KEPT: Final = 4
#: A packet that is late comes this many frames later.
_LATE_FRAMES: Final = 2
_ETH_P_IP: Final = 0x0800


def _requests_to(address: str) -> packet_filter.Program:
    """Return the filter of a packet socket for requests to a camera to send packets again."""
    load, udp = packet_filter.load, _ETHERNET_BYTES + _IP_BYTES
    program = load(_ETHERNET_BYTES, 1) + packet_filter.require(EQUAL, 0x45)
    program += load(_ETHERNET_BYTES + 6, 2) + packet_filter.refuse(HAS_BITS, 0x3FFF)
    program += load(_ETHERNET_BYTES + 9, 1) + packet_filter.require(EQUAL, 17)
    program += load(_ETHERNET_BYTES + 16, 4) + packet_filter.require(EQUAL, int(IPv4Address(address)))
    program += load(udp + 2, 2) + packet_filter.require(EQUAL, GVCP_PORT)
    return program + load(udp + _UDP_BYTES + 2, 2) + packet_filter.require(EQUAL, _COMMAND) + KEEP


class ResendPort:
    """Sends packets again on request, until `close`.

    Parameters
    ----------
    address : str
        Loopback address of the camera.

    Raises
    ------
    CameraError
        If this process may not see the requests.
    """

    def __init__(self, address: str) -> None:
        #: One of `RESEND_KINDS`.
        self.kind = "right"
        self._lock = threading.Lock()
        self._frames: OrderedDict[int, SentFrame] = OrderedDict()
        self._late: list[tuple[int, int, int]] = []
        self._target: tuple[tuple[str, int], int] | None = None
        try:
            self._requests = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ETH_P_IP))
        except PermissionError as error:
            raise CameraError(
                f"the simulated camera may not see requests for packets ({errno.errorcode[error.errno or 1]})",
                "run it as root, or leave this fault out",
            ) from error
        packet_filter.attach(self._requests, _requests_to(address))
        self._requests.bind(("lo", 0))
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sender.bind((address, 0))
        self._stop_read, self._stop_write = os.pipe()
        self._thread = threading.Thread(target=self._serve, name=f"packets again of {address}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop sending."""
        os.write(self._stop_write, b"x")
        self._thread.join()
        for closing in (self._requests, self._sender):
            closing.close()
        os.close(self._stop_read)
        os.close(self._stop_write)

    def keep(self, registers: Registers, frame: SentFrame) -> None:
        """Keep a frame that is being sent, and send packets that are late by now."""
        host = str(IPv4Address(registers.read(STREAM_CHANNEL_ADDRESS)))
        port = registers.read(STREAM_CHANNEL_PORT) & 0xFFFF
        with self._lock:
            self._target = (host, port), registers.read(STREAM_CHANNEL_PACKET_SIZE) & 0xFFFF
            self._frames[frame.frame_id] = frame
            while len(self._frames) > _KEPT:
                self._frames.popitem(last=False)
            due = [packet for packet in self._late if packet[2] >= _LATE_FRAMES]
            self._late = [(late, number, age + 1) for late, number, age in self._late if age < _LATE_FRAMES]
            for late, number, _ in due:
                self._send(late, number, number)

    def _serve(self) -> None:
        seen: tuple[bytes, int] | None = None
        while True:
            ready, _, _ = select.select([self._requests.fileno(), self._stop_read], [], [])
            if self._stop_read in ready:
                return
            data, (_, _, kind, *_) = self._requests.recvfrom(2048)
            request = data[_ETHERNET_BYTES + _IP_BYTES + _UDP_BYTES :]
            # On loopback a packet socket sees each packet going out and coming in.
            if len(request) < 20 or kind == socket.PACKET_OUTGOING or (request, kind) == seen:
                continue
            seen = request, kind
            frame_id, first, last = struct.unpack(">III", request[8:20])
            if request[1] & _LONG_IDS and len(request) >= 28:
                (frame_id,) = struct.unpack(">Q", request[20:28])
            with self._lock:
                for number in range(first, min(last, first + 1000) + 1):
                    self._answer(frame_id, number)

    def _answer(self, frame_id: int, number: int) -> None:
        match self.kind:
            case "late":
                self._late.append((frame_id, number, 0))
            case "twice":
                self._send(frame_id, number, number)
                self._send(frame_id, number, number)
            case "wrong":
                # Pixels of the packet before; then the right ones, which come too late for their place.
                self._send(frame_id, number, number - 1 if number > 1 else number + 1)
                self._send(frame_id, number, number)
            case _:
                self._send(frame_id, number, number)

    def _send(self, frame_id: int, number: int, content_of: int) -> None:
        """Send a packet of a kept frame with the pixels of another; leaders and trailers are not sent again."""
        frame = self._frames.get(frame_id)
        if frame is None or self._target is None:
            return
        target, packet_bytes = self._target
        packet = frame.payload_packet(number, packet_bytes, content_of=content_of)
        if packet is not None:
            self._sender.sendto(packet, target)
