"""The control port of a simulated camera: availability, access, deafness, and a second program that takes it."""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import suppress
from typing import Final

from ..aravis import gvcp
from ..aravis.gvcp import GVCP_PORT
from ..camera import CameraError
from ..computer import own_udp_sockets
from ..network import interfaces

#: Socket options of Linux (asm-generic/socket.h) that Python's socket module has no names for.
_SO_ATTACH_FILTER, _SO_DETACH_FILTER = 26, 27


#: A classic Berkeley packet filter of one instruction, "return 0": keep no byte of any packet (struct sock_filter).
_KEEP_NOTHING = ctypes.create_string_buffer(struct.pack("HBBI", 0x06, 0, 0, 0))
#: The filter with its length (struct sock_fprog).
_FILTER = struct.pack("HP", 1, ctypes.addressof(_KEEP_NOTHING))


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
                "end the other simulated camera or program that uses it"
                if error.errno == errno.EADDRINUSE
                else "give an address of this machine, best a loopback one"
            )
            raise CameraError(
                f"the simulated camera cannot use {address}, UDP port {GVCP_PORT} ({error.strerror}): {remedy}"
            ) from error


def free_loopback_address() -> str:
    """Return the first loopback address of this computer that no simulated camera has.

    Raises
    ------
    CameraError
        If all are taken; the message says how to add one.
    """
    addresses = [str(one.address.ip) for one in interfaces() if one.is_loopback]
    for address in addresses:
        with suppress(CameraError):
            check_free(address)
            return address
    raise CameraError(
        f"simulated cameras or other programs use UDP port {GVCP_PORT} of {', '.join(addresses) or 'loopback'}: end "
        f"one, or run 'sudo ip addr add 127.0.0.{len(addresses) + 1}/8 dev lo' for another address"
    )


class ControlPort:
    """The sockets on which a simulated camera receives requests; created before the camera.

    Parameters
    ----------
    address : str
        Loopback address of the camera.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._others = {_inode(listener) for listener, _ in self._bound()}
        self._own: set[int] = set()

    def find(self) -> None:
        """Find the sockets that the camera has opened, and let only loopback discover it.

        Aravis' simulator also listens to broadcasts, which come from every network. Answering there would show the
        camera to other machines, and make clients on this one look for its frames on the wrong interface.
        """
        for listener, address in self._bound():
            if _inode(listener) not in self._others:
                self._own.add(_inode(listener))
                if address == "255.255.255.255":
                    listener.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo\0")

    def deaf(self, deaf: bool) -> None:
        """Drop all requests, or receive them again."""
        for listener, _ in self._bound():
            if _inode(listener) in self._own:
                if deaf:
                    listener.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, _FILTER)
                else:
                    with suppress(FileNotFoundError):  # it was not deaf
                        listener.setsockopt(socket.SOL_SOCKET, _SO_DETACH_FILTER, b"\0\0\0\0")

    @staticmethod
    def _bound() -> Iterator[tuple[socket.socket, str]]:
        for listener, (host, port) in own_udp_sockets():
            if port == GVCP_PORT:
                yield listener, host


def _inode(listener: socket.socket) -> int:
    return os.fstat(listener.fileno()).st_ino


_CONTROL_ACCESS: Final = 2
_ANSWER_WITHIN_S: Final = 0.2

#: The camera lets go of a controller that is silent for 3 s.
_HEARTBEAT_S: Final = 0.5


class SecondController:
    """A bare GVCP client.

    Parameters
    ----------
    address : (str, int)
        Host and port of the camera.
    """

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(address)
        self._request_id = 0
        self._released = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="second controller", daemon=True)

    def take(self) -> bool:
        """Request control; returns whether it was granted."""
        if not self._ask(gvcp.WRITE_REGISTER, struct.pack(">II", gvcp.CONTROL_CHANNEL_PRIVILEGE, _CONTROL_ACCESS)):
            return False
        self._thread.start()
        return True

    def release(self) -> None:
        """Release control, if the camera still exists, and end."""
        self._released.set()
        if self._thread.is_alive():
            self._thread.join()
            self._ask(gvcp.WRITE_REGISTER, struct.pack(">II", gvcp.CONTROL_CHANNEL_PRIVILEGE, 0))
        self._socket.close()

    def _keep(self) -> None:
        while not self._released.wait(_HEARTBEAT_S):
            self._ask(gvcp.READ_REGISTER, struct.pack(">I", gvcp.CONTROL_CHANNEL_PRIVILEGE))

    def _ask(self, command: int, payload: bytes) -> bool:
        """Send one request; returns whether it succeeded."""
        self._request_id = self._request_id % 0xFFFF + 1
        try:
            answer = gvcp.request(self._socket, command, payload, self._request_id, _ANSWER_WITHIN_S)
        except OSError:  # no camera
            return False
        return answer is not None and answer.status == 0
