"""Sockets of this process, to set options that Aravis does not offer for its own."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path

#: Linux (asm-generic/socket.h): sets the receive buffer beyond net.core.rmem_max; needs CAP_NET_ADMIN.
_SO_RCVBUFFORCE = 33


def own_udp_sockets() -> Iterator[tuple[socket.socket, tuple[str, int]]]:
    """Yield each IPv4 datagram socket of this process with its bound address.

    The socket object is a duplicate that is closed afterwards; options set on it persist.
    """
    for duplicate in _own_sockets():
        if duplicate.family == socket.AF_INET and duplicate.type == socket.SOCK_DGRAM:
            yield duplicate, duplicate.getsockname()


def _own_sockets() -> Iterator[socket.socket]:
    for entry in Path("/proc/self/fd").iterdir():
        try:
            if not entry.is_socket():
                continue
            duplicate = socket.socket(fileno=os.dup(int(entry.name)))
        except OSError:
            continue  # closed by another thread in the meantime
        with duplicate:
            yield duplicate


def udp_socket_numbers() -> frozenset[int]:
    """Return the kernel's numbers (inodes) of this process' UDP sockets."""
    return frozenset(os.fstat(own.fileno()).st_ino for own, _ in own_udp_sockets())


def shut_down(numbers: frozenset[int]) -> None:
    """Make further sends on these sockets fail immediately, for all their users.

    Only sending: on a socket shut down for receiving, Aravis would poll endlessly.
    """
    for own, _ in own_udp_sockets():
        if os.fstat(own.fileno()).st_ino in numbers:
            # Linux reports ENOTCONN for a datagram socket but shuts it down anyway.
            with contextlib.suppress(OSError):
                own.shutdown(socket.SHUT_WR)


def has_packet_sockets() -> bool:
    """Whether this process uses a packet socket instead of UDP sockets, which then need no large buffer."""
    return any(own.family == socket.AF_PACKET for own in _own_sockets())


def enlarge_receive_buffer(port: int, wanted_bytes: int) -> int | None:
    """Enlarge the receive buffer of the UDP socket on a port, and return the granted size in bytes.

    Beyond net.core.rmem_max only with CAP_NET_ADMIN. None if there is no such socket.
    """
    for receiver, (_, bound) in own_udp_sockets():
        if bound == port:
            return _enlarge(receiver, wanted_bytes)
    return None


def receive_buffer_limit(wanted_bytes: int) -> int:
    """Return the size in bytes that would be granted for a receive buffer of `wanted_bytes`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        return _enlarge(probe, wanted_bytes)


def _enlarge(receiver: socket.socket, wanted_bytes: int) -> int:
    try:
        receiver.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, wanted_bytes)
    except OSError:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted_bytes)
    # The kernel doubles the size for its own bookkeeping and reports the doubled value (socket(7)).
    return receiver.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2
