"""GigE Vision Control Protocol (GVCP): requests without control of the camera, on a separate socket.

Aravis retries five times over 2.5 s before it gives up, and cannot query a camera controlled by another program. Layout
of the messages and bootstrap registers: GigE Vision 2.0, sections 14 to 16 and 28 (AIA, 2012).
"""

from __future__ import annotations

import socket
import struct
import time
from dataclasses import dataclass

#: UDP port of the protocol, fixed by the standard.
GVCP_PORT = 3956

#: Bootstrap register Control Channel Privilege: 0 if no program controls the camera.
CONTROL_CHANNEL_PRIVILEGE = 0x0A00

#: Bootstrap register Stream Channel Port: its lower 16 bits are the port that the stream is sent to.
STREAM_CHANNEL_PORT = 0x0D00

#: Tries of 0.25 s after which a camera is lost: as long as Aravis retries itself (5 x 500 ms).
PATIENT_TRIES = 10

_KEY = 0x42
_ACKNOWLEDGE = 0x01
_DISCOVERY = 0x0002
READ_REGISTER = 0x0080
WRITE_REGISTER = 0x0082
#: The acknowledgement of a command has the next number; a busy camera sends PENDING_ACK first.
_PENDING = 0x0089
_LARGEST_MESSAGE = 576


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


@dataclass(frozen=True)
class Announcement:
    """Identity of a camera, from its discovery acknowledgement.

    Parameters
    ----------
    vendor, model, serial, address : str
        As the camera announced them.
    """

    vendor: str
    model: str
    serial: str
    address: str


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
    client.send(struct.pack(">BBHHH", _KEY, _ACKNOWLEDGE, command, len(payload), request_id) + payload)
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


def announce(address: str, timeout_s: float = 0.25, tries: int = 3) -> Announcement | None:
    """Query one address for a camera; None if none answers. Parameters as `read_register`."""
    answer = ask(address, _DISCOVERY, b"", timeout_s, tries)
    if answer is None or answer.status != 0 or len(answer.payload) < 0xE8:
        return None

    def text(start: int, length: int) -> str:
        return answer.payload[start : start + length].split(b"\0")[0].decode("utf-8", "replace")

    return Announcement(text(0x48, 32), text(0x68, 32), text(0xD8, 16), socket.inet_ntoa(answer.payload[0x24:0x28]))
