"""Filters in the kernel for what reaches a UDP socket, before the library that reads it does.

They are classic Berkeley packet filters: sequences of instructions (``struct sock_filter`` of Linux) that jump forward
only. A packet that ends before a field that is loaded is dropped. Offsets count from the UDP header.
"""

from __future__ import annotations

import ctypes
import socket
import struct
from collections.abc import Sequence
from typing import Final

#: Socket option of Linux (asm-generic/socket.h) that Python's socket module has no name for.
_SO_ATTACH_FILTER = 26

#: Bytes of the UDP header.
UDP_HEADER_BYTES: Final = 8
#: Offset of the IP header (SKF_NET_OFF, linux/filter.h).
_IP_HEADER: Final = 0xFFF00000
#: Offset of the source address in the IP header (RFC 791).
_IP_SOURCE: Final = 12

#: An instruction: code, instructions to skip if true and if false, and a number.
Instruction = tuple[int, int, int, int]
Program = tuple[Instruction, ...]

_RETURN = 0x06
#: Ends a filter: the packet is received, or dropped.
KEEP: Final[Program] = ((_RETURN, 0, 0, 0xFFFFFFFF),)
DROP: Final[Program] = ((_RETURN, 0, 0, 0),)

#: Comparisons of the loaded number.
EQUAL, ABOVE, AT_LEAST, HAS_BITS = 0x15, 0x25, 0x35, 0x45


def load(offset: int, n_bytes: int) -> Program:
    """Load a number of 1, 2 or 4 bytes, counted from the UDP header."""
    return (({1: 0x30, 2: 0x28, 4: 0x20}[n_bytes], 0, 0, offset),)


def load_source() -> Program:
    """Load the IPv4 address of the sender."""
    return load(_IP_HEADER + _IP_SOURCE, 4)


def load_length() -> Program:
    """Load the length of the packet with its UDP header."""
    return ((0x80, 0, 0, 0),)


def masked(mask: int) -> Program:
    """Keep some bits of the loaded number."""
    return ((0x54, 0, 0, mask),)


def require(comparison: int, *numbers: int) -> Program:
    """Drop the packet unless the comparison of the loaded number with one of the numbers holds."""
    n = len(numbers)
    return (*((comparison, n - i, 0, number) for i, number in enumerate(numbers)), *DROP)


def refuse(comparison: int, number: int) -> Program:
    """Drop the packet if the comparison of the loaded number holds."""
    return ((comparison, 0, 1, number), *DROP)


def require_sum(number: int, other: Program, *, or_more: bool = False) -> Program:
    """Drop the packet unless what `other` loads is the loaded number plus `number`, or more if so wanted."""
    # Add, transfer to the second register, and compare with that.
    return ((0x04, 0, 0, number), (0x07, 0, 0, 0), *other, (0x3D if or_more else 0x1D, 1, 0, 0), *DROP)


def when(comparison: int, number: int, block: Program) -> Program:
    """Run a block of up to 255 instructions only if the comparison of the loaded number holds."""
    return ((comparison, 0, len(block), number), *block)


def attach(receiver: socket.socket, program: Sequence[Instruction]) -> None:
    """Filter what reaches a socket from now on, instead of its former filter; raises OSError."""
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *instruction) for instruction in program))
    # The kernel copies it (struct sock_fprog).
    receiver.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, struct.pack("HP", len(program), ctypes.addressof(code)))
