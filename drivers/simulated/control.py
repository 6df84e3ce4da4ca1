"""The control port of a simulated camera: availability, access and deafness."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Final

from .. import packet_filter
from ..aravis import gvcp
from ..aravis.gvcp import GVCP_PORT
from ..camera import CameraError
from ..computer import own_udp_sockets
from ..network import interfaces
from ..packet_filter import ABOVE, AT_LEAST, DROP, EQUAL, KEEP, UDP_HEADER_BYTES
from .genicam import Values

#: Size of the registers of Aravis' simulator; its description follows (ARV_FAKE_CAMERA_MEMORY_SIZE).
_REGISTERS_BYTES: Final = 0x10000

#: Bootstrap registers that a client writes: heartbeat time-out, control, and port and address of the stream.
_CLIENT_REGISTERS: Final = (
    0x0938,
    gvcp.CONTROL_CHANNEL_PRIVILEGE,
    gvcp.STREAM_CHANNEL_PORT,
    gvcp.STREAM_CHANNEL_ADDRESS,
)

#: Most bytes that a READMEM may ask for (GigE Vision 2.0, 16.3).
_MOST_READ_BYTES: Final = 536


def request_filter(writable: Mapping[int, Values], description_bytes: int) -> packet_filter.Program:
    """Return the filter that lets the requests through which Aravis' simulator answers.

    It does not check them: a read beyond the description ends its process, as may sizes that a client writes.

    Parameters
    ----------
    writable : mapping
        Values that the registers of the camera's features take, by address.
    description_bytes : int
        Size of its GenICam description.
    """
    header, known = UDP_HEADER_BYTES, {**writable, **{address: Values() for address in _CLIENT_REGISTERS}}

    def sized(n_bytes: int) -> packet_filter.Program:
        """Require a request with so many bytes after its header of 8."""
        length = packet_filter.load_length() + packet_filter.require(EQUAL, header + 8 + n_bytes)
        return length + packet_filter.load(header + 4, 2) + packet_filter.require(EQUAL, n_bytes)

    address = packet_filter.load(header + 8, 4)
    inside = address + packet_filter.refuse(AT_LEAST, _REGISTERS_BYTES + description_bytes) + KEEP
    count = packet_filter.load(header + 14, 2)
    count += packet_filter.require(AT_LEAST, 1) + packet_filter.refuse(ABOVE, _MOST_READ_BYTES)
    command = packet_filter.load(header, 1) + packet_filter.require(EQUAL, gvcp.KEY)
    command += packet_filter.load(header + 2, 2)
    program = command + packet_filter.when(EQUAL, gvcp.DISCOVERY, sized(0) + KEEP)
    program += packet_filter.when(EQUAL, gvcp.READ_REGISTER, sized(4) + inside)
    program += packet_filter.when(EQUAL, gvcp.READ_MEMORY, sized(8) + count + inside)
    # Both write four bytes behind an address: no feature has more.
    program += packet_filter.require(EQUAL, gvcp.WRITE_REGISTER, gvcp.WRITE_MEMORY) + sized(8)
    for register, values in known.items():
        program += address + packet_filter.when(EQUAL, register, _written(header + 12, values))
    return program + DROP


def _written(offset: int, values: Values) -> packet_filter.Program:
    value = packet_filter.load(offset, 4) + packet_filter.masked(values.mask)
    if values.choices:
        return value + packet_filter.require(EQUAL, *values.choices) + KEEP
    return value + packet_filter.require(AT_LEAST, values.low) + packet_filter.refuse(ABOVE, values.high) + KEEP


def check_free(address: str) -> None:
    """Refuse a port in use, which Aravis does not notice: requests would reach another camera.

    Raises
    ------
    CameraError
        If the port of that address is taken, or the address is not one of this machine.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, GVCP_PORT))
        except OSError as error:
            remedy = (
                "stop the other simulated camera or program that uses it"
                if error.errno == errno.EADDRINUSE
                else "give an address of this machine, best a loopback one"
            )
            raise CameraError(
                f"the simulated camera cannot use {address}, UDP port {GVCP_PORT} ({error.strerror})", f"{remedy}"
            ) from error


def free_loopback_address() -> str:
    """Return the first loopback address of this computer that no simulated camera has.

    Raises
    ------
    CameraError
        If all are taken; the message says how to add one.
    """
    addresses = [str(interface.address.ip) for interface in interfaces() if interface.is_loopback]
    for address in addresses:
        with suppress(CameraError):
            check_free(address)
            return address
    raise CameraError(
        f"UDP port {GVCP_PORT} of {', '.join(addresses) or 'loopback'} is taken",
        "stop the other simulated camera or "
        f"program, or run 'sudo ip addr add 127.0.0.{len(addresses) + 1}/8 dev lo' for another address",
    )


class ControlPort:
    """The sockets on which a simulated camera receives requests; created before the camera.

    Parameters
    ----------
    address : str
        Loopback address of the camera.
    requests : tuple
        Filter of the requests that it answers; see `request_filter`.
    """

    def __init__(self, address: str, requests: packet_filter.Program) -> None:
        self._address = address
        self._requests = requests
        self._others = {_inode(listener) for listener, _ in self._bound()}
        self._inodes: set[int] = set()

    def find(self) -> None:
        """Find the sockets that the camera has opened, filter their requests, and let only loopback discover it.

        Aravis' simulator also listens to broadcasts, which come from every network. Answering there would show the
        camera to other machines, and make clients on this one look for its frames on the wrong interface.
        """
        for listener, address in self._bound():
            if _inode(listener) not in self._others:
                self._inodes.add(_inode(listener))
                packet_filter.attach(listener, self._requests)
                if address == "255.255.255.255":
                    listener.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo\0")

    def deaf(self, deaf: bool) -> None:
        """Drop all requests, or receive them again."""
        for listener, _ in self._bound():
            if _inode(listener) in self._inodes:
                packet_filter.attach(listener, DROP if deaf else self._requests)

    @staticmethod
    def _bound() -> Iterator[tuple[socket.socket, str]]:
        for listener, (host, port) in own_udp_sockets():
            if port == GVCP_PORT:
                yield listener, host


def _inode(listener: socket.socket) -> int:
    return os.fstat(listener.fileno()).st_ino
