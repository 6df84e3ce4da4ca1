"""Test packets of a simulated camera, and a switch on their path that drops packets above a size.

A client writes the size of a stream packet with the bit "fire test packet" (GigE Vision 2.0, SCPSx register, 28.23;
AIA, 2012), and the camera sends one packet of that size to the port of the stream.
"""

from __future__ import annotations

import socket
import threading
from ipaddress import IPv4Address
from typing import Final

from ..aravis.gvcp import FIRE_TEST_PACKET, STREAM_CHANNEL_ADDRESS, STREAM_CHANNEL_PACKET_SIZE, STREAM_CHANNEL_PORT
from .device import Registers

#: Interval at which the register is read.
_LOOK_EVERY_S: Final = 0.002
#: Headers of IP and UDP, which the size of a packet includes.
_HEADER_BYTES: Final = 28


class TestPackets:
    """Answers to test packets up to a size, until `close`.

    Parameters
    ----------
    address : str
        Loopback address of the camera.
    registers : Registers
        Of the camera.
    largest_bytes : int
        Largest packet that the path takes, with its headers of IP and above.
    """

    #: For pytest: this is no test.
    __test__ = False

    def __init__(self, address: str, registers: Registers, largest_bytes: int) -> None:
        self._registers = registers
        self._largest_bytes = largest_bytes
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sender.bind((address, 0))
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=f"test packets of {address}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop answering."""
        self._stopped.set()
        self._thread.join()
        self._sender.close()

    def is_blocked(self) -> bool:
        """Whether packets of the stream do not come through."""
        return self._registers.read(STREAM_CHANNEL_PACKET_SIZE) & 0xFFFF > self._largest_bytes

    def _serve(self) -> None:
        while not self._stopped.wait(_LOOK_EVERY_S):
            wanted = self._registers.read(STREAM_CHANNEL_PACKET_SIZE)
            if not wanted & FIRE_TEST_PACKET:
                continue
            self._registers.write(STREAM_CHANNEL_PACKET_SIZE, wanted & ~FIRE_TEST_PACKET)
            size = wanted & 0xFFFF
            if _HEADER_BYTES < size <= self._largest_bytes:
                host = IPv4Address(self._registers.read(STREAM_CHANNEL_ADDRESS))
                port = self._registers.read(STREAM_CHANNEL_PORT) & 0xFFFF
                self._sender.sendto(bytes(size - _HEADER_BYTES), (str(host), port))
