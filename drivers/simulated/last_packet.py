"""The last packet of a frame that Aravis' simulator sends without its last byte, where that holds half a pixel.

The simulator rounds the size of an odd number of packed pixels down. The whole packet is sent before; receivers drop
the second one with the same number. Layout: GigE Vision 2.0, section 24 (AIA, 2012).
"""

from __future__ import annotations

import socket
import struct
from ipaddress import IPv4Address

import numpy as np
from numpy.typing import NDArray

from ..aravis.gvcp import STREAM_CHANNEL_ADDRESS, STREAM_CHANNEL_PACKET_SIZE, STREAM_CHANNEL_PORT
from .device import Registers

#: Bytes of the headers of IP, UDP and the stream, which the packet size includes.
_HEADER_BYTES = 36
#: Content type of a packet with pixels.
_PAYLOAD = 3


class LastPacket:
    """Sends last packets from an address, until `close`.

    Parameters
    ----------
    address : str
        Of the camera.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._socket: socket.socket | None = None

    def close(self) -> None:
        """Close its socket; may be called twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def send(self, registers: Registers, payload: NDArray[np.uint8], frame_id: int) -> None:
        """Send the last packet of a frame to where the registers say."""
        block = (registers.read(STREAM_CHANNEL_PACKET_SIZE) & 0xFFFF) - _HEADER_BYTES
        start = (payload.nbytes - 1) // block * block
        header = struct.pack(">HHI", 0, frame_id, _PAYLOAD << 24 | start // block + 1)
        host = IPv4Address(registers.read(STREAM_CHANNEL_ADDRESS))
        port = registers.read(STREAM_CHANNEL_PORT) & 0xFFFF
        if self._socket is None:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.bind((self._address, 0))
        self._socket.sendto(header + payload[start:].tobytes(), (str(host), port))
