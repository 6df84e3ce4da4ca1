"""A second program that takes control of a GigE Vision camera, and releases it on request.

Protocol: GigE Vision's control protocol (GVCP), as in its public descriptions: a request of key 0x42, flags,
command, length and request id, all big-endian; an answer of status, command, length and id.
"""

from __future__ import annotations

import socket
import struct
import threading
from typing import Final

from .genicam import Address

_READ_REGISTER: Final = 0x0080
_WRITE_REGISTER: Final = 0x0082
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
        self._socket.settimeout(_ANSWER_WITHIN_S)
        self._socket.connect(address)
        self._request_id = 0
        self._released = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="second controller", daemon=True)

    def take(self) -> bool:
        """Request control; returns whether it was granted."""
        if not self._ask(_WRITE_REGISTER, struct.pack(">II", Address.CONTROL_PRIVILEGE, _CONTROL_ACCESS)):
            return False
        self._thread.start()
        return True

    def release(self) -> None:
        """Release control, if the camera still exists, and end."""
        self._released.set()
        if self._thread.is_alive():
            self._thread.join()
            self._ask(_WRITE_REGISTER, struct.pack(">II", Address.CONTROL_PRIVILEGE, 0))
        self._socket.close()

    def _keep(self) -> None:
        while not self._released.wait(_HEARTBEAT_S):
            self._ask(_READ_REGISTER, struct.pack(">I", Address.CONTROL_PRIVILEGE))

    def _ask(self, command: int, payload: bytes) -> bool:
        """Send one request; returns whether it succeeded."""
        self._request_id = self._request_id % 0xFFFF + 1
        try:
            self._socket.send(struct.pack(">BBHHH", 0x42, 0x01, command, len(payload), self._request_id) + payload)
            status, answered, _, request_id = struct.unpack(">HHHH", self._socket.recv(576)[:8])
        except OSError:  # no answer, or no camera
            return False
        return bool(status == 0 and answered == command + 1 and request_id == self._request_id)
