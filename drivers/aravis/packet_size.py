"""Largest stream packet that comes through to this computer, found by test packets of the camera.

A switch on the path may take smaller packets than the interface of this computer; it drops larger ones without a word.
The camera sends a test packet when its size is written with the bit "fire test packet" (GigE Vision 2.0, SCPSx
register, 28.23; AIA, 2012).
"""

from __future__ import annotations

import socket
from contextlib import closing
from ipaddress import IPv4Address
from typing import Any, Final

from .gvcp import (
    DO_NOT_FRAGMENT,
    FIRE_TEST_PACKET,
    STREAM_CHANNEL_ADDRESS,
    STREAM_CHANNEL_PACKET_SIZE,
    STREAM_CHANNEL_PORT,
)

#: Size that every path takes (RFC 791).
SMALLEST_BYTES: Final = 576
#: Headers of IP and UDP, which the size of a packet includes.
_HEADER_BYTES: Final = 28
#: Tries for a size, and the time to wait for each: a packet on a wire takes less than a millisecond.
_TRIES, _WAIT_S = 3, 0.05
#: Sizes are found to this many bytes; cameras step by 4 or more.
_STEP_BYTES: Final = 4


def path_packet_bytes(camera: Any, own_address: str, largest_bytes: int) -> int | None:
    """Find the largest packet from a camera that reaches an address of this computer; raises errors of Aravis.

    The registers of the stream are left as they were.

    Parameters
    ----------
    camera : Aravis.Camera
        Open GigE Vision camera that this program controls, not acquiring.
    own_address : str
        Address of the interface that leads to it.
    largest_bytes : int
        Largest size to try, headers of IP and above included; the MTU of the interface.

    Returns
    -------
    int or None
        None if no test packet came, as from cameras that have none.
    """
    device = camera.get_device()
    places = (STREAM_CHANNEL_PORT, STREAM_CHANNEL_PACKET_SIZE, STREAM_CHANNEL_ADDRESS)
    before = [device.read_register(place) for place in places]
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as receiver:
        receiver.bind((own_address, 0))
        receiver.settimeout(_WAIT_S)
        try:
            device.write_register(STREAM_CHANNEL_PORT, receiver.getsockname()[1])
            device.write_register(STREAM_CHANNEL_ADDRESS, int(IPv4Address(own_address)))
            return _largest(lambda size: _comes_through(device, receiver, size), largest_bytes)
        finally:
            for place, value in zip(places, before, strict=True):
                device.write_register(place, value)


def _largest(comes_through: Any, largest_bytes: int) -> int | None:
    """Return the largest size that comes through, by bisection; most paths take all."""
    if comes_through(largest_bytes):
        return largest_bytes
    low, high = SMALLEST_BYTES, largest_bytes
    if not comes_through(low):
        return None
    while high - low > _STEP_BYTES:
        middle = (low + high) // 2 // _STEP_BYTES * _STEP_BYTES
        if middle <= low:
            break
        low, high = (middle, high) if comes_through(middle) else (low, middle)
    return low


def _comes_through(device: Any, receiver: socket.socket, size: int) -> bool:
    for _ in range(_TRIES):
        device.write_register(STREAM_CHANNEL_PACKET_SIZE, FIRE_TEST_PACKET | DO_NOT_FRAGMENT | size)
        try:
            while True:
                if len(receiver.recv(65536)) == size - _HEADER_BYTES:
                    return True
        except TimeoutError:
            continue
    return False
