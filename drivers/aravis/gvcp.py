"""GigE Vision Control Protocol (GVCP): requests without control of the camera, on a separate socket.

Aravis retries five times over 2.5 s before it gives up, and cannot query a camera controlled by another program. Layout
of the messages and bootstrap registers: GigE Vision 2.0, sections 14 to 16 and 28 (AIA, 2012).
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Address, IPv4Interface

from ...core.errors import InputError, printable
from ..camera import CameraError, CameraNotFoundError
from ..network import interfaces
from .library import CameraInfo

#: UDP port of the protocol, fixed by the standard.
GVCP_PORT = 3956

#: Bootstrap register Control Channel Privilege: 0 if no program controls the camera.
CONTROL_CHANNEL_PRIVILEGE = 0x0A00

#: Bootstrap register Stream Channel Port: its lower 16 bits are the port that the stream is sent to.
STREAM_CHANNEL_PORT = 0x0D00
STREAM_CHANNEL_PACKET_SIZE = 0x0D04
#: Bits of that register: send one packet of this size now, and let no router take it apart.
FIRE_TEST_PACKET, DO_NOT_FRAGMENT = 1 << 31, 1 << 30
STREAM_CHANNEL_ADDRESS = 0x0D18

#: Tries of 0.25 s after which a camera is lost: as long as Aravis retries itself (5 x 500 ms).
PATIENT_TRIES = 10

#: First byte of each request.
KEY = 0x42
_ACKNOWLEDGE = 0x01
#: Flag of a request that may be answered by broadcast.
_ANSWER_ALL = 0x10
_EVERYBODY = ("255.255.255.255", GVCP_PORT)
DISCOVERY = 0x0002
_FORCE_IP = 0x0004
READ_REGISTER = 0x0080
WRITE_REGISTER = 0x0082
READ_MEMORY = 0x0084
WRITE_MEMORY = 0x0086
#: The acknowledgement of a command has the next number; a busy camera sends PENDING_ACK first.
_PENDING = 0x0089
_LARGEST_MESSAGE = 576
_CONFIRMED_WITHIN_S = 2.0


@dataclass(frozen=True)
class Answer:
    """Answer of a camera.

    Parameters
    ----------
    status : int
        0 for success, else a GigE Vision status code.
    payload : bytes
        Payload after the header; empty for a camera that is still busy.
    """

    status: int
    payload: bytes

    @property
    def register(self) -> int | None:
        """Value of the register; None if the answer does not contain it."""
        return int.from_bytes(self.payload[:4], "big") if self.status == 0 and len(self.payload) >= 4 else None


def ask(address: str, command: int, payload: bytes = b"", timeout_s: float = 0.25, tries: int = 3) -> Answer | None:
    """Send a command and return the answer; None if none came within `tries` times `timeout_s`.

    An ICMP "port unreachable" and a missing network end the wait immediately.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        try:
            client.connect((address, GVCP_PORT))
            for request_id in range(1, tries + 1):
                answer = request(client, command, payload, request_id, timeout_s)
                if answer is not None:
                    return answer
        except OSError:
            return None
    return None


def request(client: socket.socket, command: int, payload: bytes, request_id: int, timeout_s: float) -> Answer | None:
    """Send one request on a connected socket; the answer may be that to an earlier one. Raises OSError."""
    client.send(struct.pack(">BBHHH", KEY, _ACKNOWLEDGE, command, len(payload), request_id) + payload)
    return _wait_for(client, command, request_id, time.monotonic() + timeout_s)


def _wait_for(client: socket.socket, command: int, last_id: int, until_s: float) -> Answer | None:
    """Receive until the answer to any request up to `last_id` arrives: the first may be slow."""
    while (left_s := until_s - time.monotonic()) > 0:
        client.settimeout(left_s)
        try:
            message = client.recv(_LARGEST_MESSAGE)
        except TimeoutError:
            return None
        if len(message) < 8:
            continue
        status, acknowledged, length, request_id = struct.unpack(">HHHH", message[:8])
        if not 1 <= request_id <= last_id:
            continue
        if acknowledged == _PENDING:
            return Answer(0, b"")
        if acknowledged == command + 1:
            return Answer(status, message[8 : 8 + length])
    return None


def read_register(address: str, register: int, timeout_s: float = 0.25, tries: int = PATIENT_TRIES) -> Answer | None:
    """Read a register of 32 bits; any answer, even an error, shows that the camera is alive.

    Parameters
    ----------
    address : str
        Network address of the camera.
    register : int
        Register address, for example `CONTROL_CHANNEL_PRIVILEGE`.
    timeout_s : float
        Longest wait for each try, in seconds.
    tries : int
        Number of attempts.

    Returns
    -------
    Answer or None
        None if the camera does not answer.
    """
    return ask(address, READ_REGISTER, struct.pack(">I", register), timeout_s, tries)


def is_controlled(address: str, tries: int = PATIENT_TRIES) -> bool | None:
    """Whether a program controls the camera; None if it does not answer. Parameters as `read_register`."""
    answer = read_register(address, CONTROL_CHANNEL_PRIVILEGE, tries=tries)
    # Under exclusive access it refuses to tell.
    return None if answer is None else bool(answer.register) or answer.status != 0


def announce(address: str, timeout_s: float = 0.25, tries: int = 3) -> CameraInfo | None:
    """Query one address for a camera; None if none answers. Parameters as `read_register`."""
    answer = ask(address, DISCOVERY, b"", timeout_s, tries)
    return None if answer is None else _announced(answer)


def _announced(answer: Answer) -> CameraInfo | None:
    payload = answer.payload
    if answer.status != 0 or len(payload) < 0xE8:
        return None
    vendor, model, serial = (
        printable(payload[start : start + length].split(b"\0")[0].decode("utf-8", "replace"))
        for start, length in ((0x48, 32), (0x68, 32), (0xD8, 16))
    )
    address = socket.inet_ntoa(payload[0x24:0x28])
    return CameraInfo(vendor, model, serial, address, "GigEVision", mac=payload[0x0A:0x10])


def announce_all(interface: str, timeout_s: float = 1.0) -> list[CameraInfo]:
    """Query all cameras behind an interface, for example ``eth0``, whatever their network; waits for `timeout_s`.

    Raises
    ------
    OSError
        If the interface cannot be used.
    """
    seen = map(_announced, _ask_all(interface, DISCOVERY, b"", timeout_s))
    # Simulated cameras of one computer share its hardware address.
    return list({(info.mac, info.address): info for info in seen if info is not None}.values())


def _ask_all(interface: str, command: int, payload: bytes, timeout_s: float) -> Iterator[Answer]:
    """Send a command to all cameras, which may answer to all: they need not know a way to this computer."""
    until_s = time.monotonic() + timeout_s
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface.encode() + b"\0")
        flags = _ACKNOWLEDGE | _ANSWER_ALL
        client.sendto(struct.pack(">BBHHH", KEY, flags, command, len(payload), 1) + payload, _EVERYBODY)
        while (answer := _wait_for(client, command, 1, until_s)) is not None:
            yield answer


def set_address(serial: str, wanted: str) -> IPv4Interface:
    """Give a camera an address of a network of this computer, until it is switched off.

    Parameters
    ----------
    serial : str
        Serial number of the camera, which may be in any network behind the interface with that of the new address.
    wanted : str
        IPv4 address.

    Returns
    -------
    IPv4Interface
        The new address with its network.

    Raises
    ------
    InputError
        If the address is not one of a device in a network of this computer, or another device has it.
    CameraNotFoundError
        If no such camera answers there.
    CameraError
        If it does not confirm, or the interface cannot be used.
    """
    known = interfaces()
    try:
        address = IPv4Address(wanted)
    except AddressValueError:
        raise InputError(f"the address is {wanted!r}: give an IPv4 address such as 192.168.7.20") from None
    interface = next((candidate for candidate in known if address in candidate.address.network), None)
    if interface is None:
        listing = ", ".join(f"{interface.name} ({interface.address.network})" for interface in known)
        raise InputError(f"{address} is in no network of this computer: choose one of {listing}")
    if any(interface.address.ip == address for interface in known):
        raise InputError(f"{address} is an address of this computer: choose another one")
    network = interface.address.network
    # A network of 31 bits has neither (RFC 3021).
    if network.prefixlen < 31 and address in (network.network_address, network.broadcast_address):
        raise InputError(f"{address} is the network's or the broadcast address of {network}: choose one in between")
    new = IPv4Interface(f"{address}/{network.prefixlen}")
    try:
        _force_address(interface.name, serial, new)
    except OSError as error:
        raise CameraError(f"{interface.name} cannot be used ({error.strerror})", "run the command with sudo") from error
    return new


def _force_address(interface: str, serial: str, new: IPv4Interface) -> None:
    cameras = announce_all(interface)
    camera = next((info for info in cameras if info.serial == serial), None)
    if camera is None:
        listing = ", ".join(f"{info.serial} at {info.address}" for info in cameras) or "none"
        raise CameraNotFoundError(
            f"no camera {serial} answers at {interface}; found: {listing}", "check power, cable and serial number"
        )
    if any(info.address == str(new.ip) for info in cameras if info is not camera):
        raise InputError(f"{new.ip} is the address of another camera: choose another one")
    # Two bytes, the hardware address, and address and mask after twelve bytes each; at the end no gateway.
    payload = bytes(2) + camera.mac + bytes(12) + new.ip.packed + bytes(12) + new.netmask.packed + bytes(16)
    answer = next(_ask_all(interface, _FORCE_IP, payload, _CONFIRMED_WITHIN_S), None)
    if answer is None or answer.status != 0:
        raise CameraError(
            f"camera {serial} did not confirm {new}", "end the program that controls it, or switch it off"
        )
