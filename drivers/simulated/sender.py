"""Frames that a simulated camera sends itself, where Aravis' simulator cannot.

The simulator sends an image with ids of 16 bits and nothing behind its pixels, and rounds the size of an odd number of
packed pixels down. Layout of the packets: GigE Vision 2.0, sections 24 and 25 (AIA, 2012).
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..aravis.gvcp import STREAM_CHANNEL_ADDRESS, STREAM_CHANNEL_PACKET_SIZE, STREAM_CHANNEL_PORT
from .device import Registers

#: Bytes of the headers of IP and UDP, which the packet size includes, and of the stream with ids of 16 and of 64 bits.
_IP_UDP_BYTES: Final = 28
_SHORT_BYTES, _LONG_BYTES = 8, 20
#: Content types, and the flag of ids of 64 bits.
_LEADER, _TRAILER, _PAYLOAD, _LONG_IDS = 1, 2, 3, 0x80
#: Payload types of an image, of nothing but chunks, and the flag of an image that chunks follow.
_IMAGE, _CHUNKS, _WITH_CHUNKS = 0x0001, 0x0004, 0x4000
#: Name of the chunk with the pixels.
_IMAGE_CHUNK: Final = 0x0001


def with_chunks(pixels: NDArray[np.uint8], chunks: Mapping[int, bytes]) -> NDArray[np.uint8]:
    """Return the payload of a frame with chunks: each is followed by its id and its size, a multiple of 4.

    Parameters
    ----------
    pixels : ndarray of uint8, shape (n,)
        The first chunk.
    chunks : mapping
        Content of the others by their ids.
    """
    padded = pixels.tobytes().ljust(-(-pixels.nbytes // 4) * 4, b"\0")
    content = {_IMAGE_CHUNK: padded, **chunks}
    data = b"".join(data + struct.pack(">II", chunk, len(data)) for chunk, data in content.items())
    return np.frombuffer(data, dtype=np.uint8)


@dataclass(frozen=True)
class SentFrame:
    """A frame as its camera sends it.

    Parameters
    ----------
    payload : ndarray of uint8, shape (n,)
        Pixels and what follows them.
    frame_id : int
        Its block id.
    has_chunks : bool
        Whether chunks follow the pixels.
    long_ids : bool
        Whether ids have 64 bits.
    """

    payload: NDArray[np.uint8]
    frame_id: int
    has_chunks: bool = False
    long_ids: bool = False

    def block_bytes(self, packet_bytes: int) -> int:
        """Return how many bytes of the payload a packet of a size carries."""
        return packet_bytes - _IP_UDP_BYTES - (_LONG_BYTES if self.long_ids else _SHORT_BYTES)

    def header(self, content: int, number: int) -> bytes:
        """Return the header of a packet of a frame."""
        if self.long_ids:
            return struct.pack(">HHIQI", 0, 0, (_LONG_IDS | content) << 24, self.frame_id, number)
        return struct.pack(">HHI", 0, self.frame_id, content << 24 | number)

    def payload_packet(self, number: int, packet_bytes: int, *, content_of: int | None = None) -> bytes | None:
        """Return the packet with a number from 1 on; None beyond the frame.

        Parameters
        ----------
        number : int
            Of the packet.
        packet_bytes : int
            Size of a packet, with the headers of IP and above.
        content_of : int or None
            Number of the packet whose content it has; None for its own.
        """
        block = self.block_bytes(packet_bytes)
        n_blocks = -(-self.payload.nbytes // block)
        taken = number if content_of is None else content_of
        if not (1 <= number <= n_blocks and 1 <= taken <= n_blocks):
            return None
        wanted = min(block, self.payload.nbytes - (number - 1) * block)
        content = self.payload[(taken - 1) * block :][:wanted].tobytes().ljust(wanted, b"\0")
        return self.header(_PAYLOAD, number) + content


@dataclass(frozen=True)
class ImageLeader:
    """What the leader of a frame says of its image.

    Parameters
    ----------
    timestamp_ns : int
        On the camera's clock.
    format_code, width, height, x, y : int
        Pixel format, and which part of the sensor it shows.
    """

    timestamp_ns: int
    format_code: int
    width: int
    height: int
    x: int
    y: int

    def packed(self, kind: int) -> bytes:
        """Return it for a payload type; that of nothing but chunks has no image."""
        size = (self.width, self.height, self.x, self.y)
        began = struct.pack(">HHQ", 0, kind, self.timestamp_ns)
        return began if kind == _CHUNKS else began + struct.pack(">IIIIIHH", self.format_code, *size, 0, 0)


class StreamSender:
    """Sends frames from an address, until `close`.

    Parameters
    ----------
    address : str
        Of the camera.
    bare_chunks : bool
        As of `SimulatedDevice`.
    """

    def __init__(self, address: str, *, bare_chunks: bool = False) -> None:
        self._address = address
        self._bare_chunks = bare_chunks
        self._socket: socket.socket | None = None
        self._random = np.random.default_rng(0)

    def close(self) -> None:
        """Close its socket; may be called twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def send(self, registers: Registers, frame: SentFrame, leader: ImageLeader, share_lost: float) -> None:
        """Send a frame to where the registers say, but for a share of its packets."""
        packet_bytes = registers.read(STREAM_CHANNEL_PACKET_SIZE) & 0xFFFF
        host = IPv4Address(registers.read(STREAM_CHANNEL_ADDRESS))
        target = (str(host), registers.read(STREAM_CHANNEL_PORT) & 0xFFFF)
        if self._socket is None:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.bind((self._address, 0))
        kind = _IMAGE | (_WITH_CHUNKS if frame.has_chunks else 0)
        if frame.has_chunks and self._bare_chunks:
            kind = _CHUNKS
        n_blocks = -(-frame.payload.nbytes // frame.block_bytes(packet_bytes))
        for number in range(n_blocks + 2):
            if self._random.random() < share_lost:
                continue
            if number == 0:
                packet = frame.header(_LEADER, number) + leader.packed(kind)
            elif number > n_blocks:
                packet = frame.header(_TRAILER, number) + struct.pack(">HHI", 0, kind, leader.height)
            else:
                packet = frame.payload_packet(number, packet_bytes) or b""
            self._socket.sendto(packet, target)
