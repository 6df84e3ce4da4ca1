"""A second program that takes control of a GigE Vision camera, and releases it on request."""

from __future__ import annotations

import socket
import struct
import threading
from typing import Final

from ...aravis import gvcp

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
