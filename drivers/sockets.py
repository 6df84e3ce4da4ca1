"""The UDP sockets of this process that belong to Aravis, which offers no way to set their options."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path


def own_udp_sockets() -> Iterator[tuple[socket.socket, tuple[str, int]]]:
    """Yield each IPv4 datagram socket of this process with the address it is bound to.

    The socket object is a duplicate that is closed afterwards; options set on it stay.
    """
    for entry in Path("/proc/self/fd").iterdir():
        try:
            if not entry.is_socket():
                continue
            duplicate = socket.socket(fileno=os.dup(int(entry.name)))
        except OSError:
            continue  # closed by another thread in the meantime
        with duplicate:
            if duplicate.family == socket.AF_INET and duplicate.type == socket.SOCK_DGRAM:
                yield duplicate, duplicate.getsockname()
