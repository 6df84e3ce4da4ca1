"""Kernel settings relevant for a camera stream, None where they cannot be read, and the sockets of this process."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import socket
from collections.abc import Iterator
from pathlib import Path

#: Limit of the receive buffer that ``make`` sets and the remedies name: three 16-bit frames of 2452 x 2056 pixels.
RECEIVE_LIMIT_BYTES = 33_554_432

#: State of the kernel's clock: not synchronised, adjtimex(2).
_TIME_ERROR = 5
#: Larger than ``struct timex`` on any machine (208 bytes on 64-bit ones).
_TIMEX_BYTES = 512
#: Nice value of threads that receive and write frames: that of high priority in Aravis' own programs.
_URGENT = -10
#: Where sysctl settings are kept, sysctl.d(5).
_SYSCTL_FOLDERS = ("usr/lib/sysctl.d", "run/sysctl.d", "etc/sysctl.d")


def read_text(path: Path) -> str | None:
    """Return the content of a small file, None if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None


def read_int(path: Path) -> int | None:
    """Return the number in a file, None if there is none."""
    text = read_text(path)
    return int(text) if text is not None and re.fullmatch(r"\s*-?\d{1,18}\s*", text) else None


def network_limit(name: str, root: Path = Path("/")) -> int | None:
    """Return a limit of the kernel's network in bytes, for example ``rmem_max``, the largest receive buffer."""
    return read_int(root / "proc/sys/net/core" / name)


def kept_receive_limit_bytes(root: Path = Path("/")) -> int | None:
    """Largest net.core.rmem_max in the files that are applied when the computer starts."""
    files = [path for folder in _SYSCTL_FOLDERS for path in (root / folder).glob("*.conf")]
    texts = [read_text(path) or "" for path in [*files, root / "etc/sysctl.conf"]]
    pattern = re.compile(r"^\s*-?net[./]core[./]rmem_max\s*=\s*(\d{1,18})\s*$", re.MULTILINE)
    return max((int(limit) for text in texts for limit in pattern.findall(text)), default=None)


def raise_receive_limit(frame_bytes: int) -> str:
    """Return the command that allows a receive buffer for a whole frame."""
    return f"sudo sysctl -w net.core.rmem_max={_enough_bytes(frame_bytes)}"


def keep_receive_limit(frame_bytes: int) -> str:
    """Return the command that makes the limit persistent."""
    return f"echo net.core.rmem_max={_enough_bytes(frame_bytes)} | sudo tee /etc/sysctl.d/90-camera.conf"


def _enough_bytes(frame_bytes: int) -> int:
    return max(RECEIVE_LIMIT_BYTES, 1 << max(0, frame_bytes - 1).bit_length())


def may_open_packet_sockets() -> bool:
    """Whether this process may open packet sockets (CAP_NET_RAW), with which Aravis bypasses the ordinary buffer."""
    try:
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW).close()
    except OSError:
        return False
    return True


def overload() -> float:
    """Return how many processes wait for each processor, over the last minute; at least 1."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def clock_is_synchronised() -> bool | None:
    """Whether a time service synchronises the computer's clock, according to the kernel (adjtimex)."""
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != _TIME_ERROR


def firewall(root: Path = Path("/")) -> str | None:
    """Name of an active firewall, as far as readable without privileges; None is inconclusive."""
    if re.search(r"^ENABLED=yes\s*$", read_text(root / "etc/ufw/ufw.conf") or "", re.MULTILINE | re.IGNORECASE):
        return "ufw"
    if any(os.path.exists(root / "run" / name) for name in ("firewalld", "firewalld.pid")):
        return "firewalld"
    if "filter" in (read_text(root / "proc/net/ip_tables_names") or "").split():
        return "iptables"
    return None


def open_firewall(name: str | None, address: str) -> str:
    """Return the command that admits a camera's packets."""
    commands = {
        "ufw": f"sudo ufw allow proto udp from {address}",
        "firewalld": f"sudo firewall-cmd --zone=trusted --add-source={address}",
        "iptables": f"sudo iptables -I INPUT -p udp -s {address} -j ACCEPT",
    }
    return commands.get(name or "", f"if there is a firewall, let UDP packets from {address} through")


#: Linux (asm-generic/socket.h): sets the receive buffer beyond net.core.rmem_max; needs CAP_NET_ADMIN.
_SO_RCVBUFFORCE = 33


def own_udp_sockets() -> Iterator[tuple[socket.socket, tuple[str, int]]]:
    """Yield each IPv4 datagram socket of this process with its bound address.

    The socket object is a duplicate that is closed afterwards; options set on it persist.
    """
    for sock in _own_sockets():
        if sock.family == socket.AF_INET and sock.type == socket.SOCK_DGRAM:
            yield sock, sock.getsockname()


def own_packet_sockets() -> Iterator[tuple[int, socket.socket]]:
    """Yield each packet socket of this process with the kernel's number (inode); duplicates as `own_udp_sockets`."""
    for sock in _own_sockets():
        if sock.family == socket.AF_PACKET:
            yield os.fstat(sock.fileno()).st_ino, sock


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
    return frozenset(os.fstat(sock.fileno()).st_ino for sock, _ in own_udp_sockets())


def shut_down(numbers: frozenset[int]) -> None:
    """Make further sends on these sockets fail immediately, for all their users.

    Only sending: on a socket shut down for receiving, Aravis would poll endlessly.
    """
    for sock, _ in own_udp_sockets():
        if os.fstat(sock.fileno()).st_ino in numbers:
            # Linux reports ENOTCONN for a datagram socket but shuts it down anyway.
            with contextlib.suppress(OSError):
                sock.shutdown(socket.SHUT_WR)


def enlarge_receive_buffer(port: int, wanted_bytes: int) -> int | None:
    """Enlarge the receive buffer of the UDP socket on a port, and return the granted size in bytes.

    Beyond net.core.rmem_max only with CAP_NET_ADMIN. None if there is no such socket.
    """
    for receiver, (_, bound) in own_udp_sockets():
        if bound == port:
            # Small frames would otherwise get less than a socket has from the start.
            return _enlarge(receiver, max(wanted_bytes, receiver.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2))
    return None


def receive_buffer_limit(wanted_bytes: int) -> int:
    """Return the size in bytes that would be granted for a receive buffer of `wanted_bytes`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        return _enlarge(probe, wanted_bytes)


def _enlarge(receiver: socket.socket, wanted_bytes: int) -> int:
    # The kernel takes half of what 32 bits hold.
    wanted_bytes = min(wanted_bytes, 2**30)
    try:
        receiver.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, wanted_bytes)
    except OSError:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted_bytes)
    # The kernel doubles the size for its own bookkeeping and reports the doubled value (socket(7)).
    return receiver.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2


def raise_priority(*threads: int) -> None:
    """Give threads, by the kernel's numbers, priority over other programs, where that is permitted (CAP_SYS_NICE)."""
    for thread in threads:
        with contextlib.suppress(OSError, AttributeError):  # it may have ended, or the system have no priorities
            os.setpriority(os.PRIO_PROCESS, thread, _URGENT)


def threads_named(name: str) -> list[int]:
    """Return the kernel's numbers of the threads of this process with a name."""
    threads = Path("/proc/self/task").iterdir()
    return [int(thread.name) for thread in threads if (read_text(thread / "comm") or "").strip() == name]
