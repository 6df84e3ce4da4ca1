"""The sockets of this process that belong to Aravis, which offers no way to set their options."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path

#: Linux (asm-generic/socket.h): sets the receive buffer beyond net.core.rmem_max; needs CAP_NET_ADMIN.
_SO_RCVBUFFORCE = 33


def own_udp_sockets() -> Iterator[tuple[socket.socket, tuple[str, int]]]:
    """Yield each IPv4 datagram socket of this process with the address it is bound to.

    The socket object is a duplicate that is closed afterwards; options set on it stay.
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
    """Make whatever is sent by these sockets from now on fail at once, for whoever holds them.

    Only sending: Aravis, waiting for an answer on a socket that is shut for receiving, would ask it without end.
    """
    for own, _ in own_udp_sockets():
        if os.fstat(own.fileno()).st_ino in numbers:
            # Linux reports that a datagram socket is not connected, and shuts it down all the same.
            with contextlib.suppress(OSError):
                own.shutdown(socket.SHUT_WR)


def has_packet_sockets() -> bool:
    """Whether this process receives past the UDP sockets, which need no large buffer then."""
    return any(own.family == socket.AF_PACKET for own in _own_sockets())


def enlarge_receive_buffer(port: int, wanted_bytes: int) -> int | None:
    """Enlarge the receive buffer of the UDP socket on a port, and return what the kernel granted, in bytes.

    Beyond net.core.rmem_max only with CAP_NET_ADMIN. None if there is no such socket.
    """
    for receiver, (_, bound) in own_udp_sockets():
        if bound == port:
            return _enlarge(receiver, wanted_bytes)
    return None


def receive_buffer_limit(wanted_bytes: int) -> int:
    """Return how much of a receive buffer of `wanted_bytes` this process would be granted, in bytes."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        return _enlarge(probe, wanted_bytes)


def _enlarge(receiver: socket.socket, wanted_bytes: int) -> int:
    try:
        receiver.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, wanted_bytes)
    except OSError:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted_bytes)
    # The kernel doubles the number for its own bookkeeping, and tells the doubled one (socket(7)).
    return receiver.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2
