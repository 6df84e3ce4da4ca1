"""Receiving frames through Aravis: one stream, its buffers, and what is refused."""

from __future__ import annotations

import contextlib
import logging
import socket
import time
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..frame import CameraIdentity
from .aravis_library import aravis, losing
from .camera import CameraError, CameraLostError, FrameTimeoutError, IncompleteFrameError
from .sockets import own_udp_sockets

_log = logging.getLogger(__name__)

#: Frames in flight: at 15 frames/s this bridges 0.4 s in which the caller does something else.
_N_BUFFERS = 6

#: What each way to fail means, by the name of the Aravis buffer status.
_INCOMPLETE = {
    "TIMEOUT": "packets stopped coming in the middle of it",
    "MISSING_PACKETS": "packets were lost on the way",
    "WRONG_PACKET_ID": "its packets were numbered wrongly",
    "SIZE_MISMATCH": "its size is not the one announced",
    "FILLING": "it was still being received",
    "ABORTED": "its reception was broken off",
    "CLEARED": "nothing of it was received",
}


class Reception:
    """One stream and its buffers, from the start of acquisition to its stop; a context manager.

    Parameters
    ----------
    camera : Aravis.Camera
        Open, with its settings made.
    identity : CameraIdentity
        For messages.
    """

    def __init__(self, camera: Any, identity: CameraIdentity) -> None:
        self._arv = aravis()
        self._camera = camera
        self._identity = identity
        self._arrays: dict[int, NDArray[np.uint8]] = {}
        self._stream: Any = None

    def __enter__(self) -> Self:
        camera = self._camera
        with losing(self._identity, "no stream can be opened"):
            self._stream = camera.create_stream(None, None)
            if camera.is_gv_device():
                # The default socket buffer holds a fraction of a frame and loses the rest.
                self._stream.set_property("socket-buffer", self._arv.GvStreamSocketBuffer.AUTO)
                _enlarge_receive_buffer(self._stream.get_port(), camera.get_payload())
            self._payload_bytes = camera.get_payload()
            for _ in range(_N_BUFFERS):
                self._push()
            camera.set_acquisition_mode(self._arv.AcquisitionMode.CONTINUOUS)
            self._started_ns = time.time_ns()
            camera.start_acquisition()
        return self

    def __exit__(self, kind: type[BaseException] | None, *exc: object) -> None:
        # A camera that is lost cannot be told to stop.
        if kind is CameraLostError:
            self._stream = None
        self.stop()

    def stop(self) -> None:
        """Stop the acquisition and give up the stream; may be called twice."""
        if self._stream is not None:
            # Leaving in mid-acquisition can abort the process.
            with contextlib.suppress(CameraLostError), losing(self._identity, "acquisition cannot be stopped"):
                self._camera.stop_acquisition()
        self._stream = None
        self._camera = None
        self._arrays = {}

    def _push(self) -> None:
        array = np.empty(self._payload_bytes, dtype=np.uint8)
        buffer = self._arv.Buffer.new(array.nbytes, array.ctypes.data)
        self._arrays[hash(buffer)] = array
        self._stream.push_buffer(buffer)

    def next(self, wait_s: float) -> tuple[Any, NDArray[np.uint8]]:
        """Wait for the next whole frame and return the Aravis buffer and its bytes.

        Raises
        ------
        FrameTimeoutError, IncompleteFrameError, CameraLostError
            As `AravisCamera.grab`.
        """
        while True:
            if self._stream is None:
                raise CameraError(f"{self._identity} was closed while it was grabbing: open it again and grab anew")
            buffer = self._stream.timeout_pop_buffer(int(wait_s * 1e6))
            if buffer is None:
                self._explain_silence(wait_s)
            payload = self._arrays.pop(hash(buffer))
            self._push()
            status = buffer.get_status()
            if status != self._arv.BufferStatus.SUCCESS:
                self._refuse(buffer, status)
            if buffer.get_system_timestamp() >= self._started_ns:
                return buffer, payload
            _log.warning("frame %d arrived before acquisition began: left out", buffer.get_frame_id())

    def _explain_silence(self, wait_s: float) -> None:
        with losing(self._identity, "no frame came"):
            self._camera.get_exposure_time()
        raise FrameTimeoutError(
            f"no frame came from {self._identity} within {wait_s:.1f} s, though it answers: check trigger mode, "
            f"packet size and firewall ({self.statistics()})"
        )

    def _refuse(self, buffer: Any, status: Any) -> None:
        name = status.value_nick.upper().replace("-", "_")
        raise IncompleteFrameError(
            f"frame {buffer.get_frame_id()} from {self._identity} is incomplete, "
            f"{_INCOMPLETE.get(name, name)}: it is refused; lower the frame rate or packet size, or raise "
            f"net.core.rmem_max ({self.statistics()})"
        )

    def statistics(self) -> str:
        """Counters that say what went wrong, as a short text."""
        stream = self._stream
        counters = {stream.get_info_name(i): stream.get_info_uint64(i) for i in range(stream.get_n_infos())}
        names = ("n_completed_buffers", "n_failures", "n_missing_packets", "n_underruns")
        return ", ".join(f"{name[2:].replace('_', ' ')} {counters[name]}" for name in names if name in counters)


def _enlarge_receive_buffer(port: int, payload_bytes: int) -> None:
    """Set the buffer of a stream's socket now: Aravis does so at the first packet, too late for the first frame."""
    for receiver, (_, bound) in own_udp_sockets():
        if bound == port:
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, payload_bytes)
