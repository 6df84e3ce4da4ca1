"""A GigE Vision camera on loopback whose pixels come from a frame source.

The protocol side is Aravis' own GigE Vision simulator (``ArvGvFakeCamera``), with our GenICam description and
our pixels.
"""

from __future__ import annotations

import ctypes
import errno
import gc
import logging
import socket
import tempfile
import time
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from ..aravis_library import aravis
from ..camera import CameraError
from ..pixel_format import PIXEL_FORMATS, PixelFormat
from ..sockets import own_udp_sockets
from .genicam import GAIN_STEPS_PER_DB, TEMPERATURE_STEPS_PER_C, Address, description

_log = logging.getLogger(__name__)

#: UDP port of the GigE Vision control protocol (GVCP), fixed by the standard.
GVCP_PORT = 3956

#: Formats the simulated Manta offers.
FORMATS: tuple[PixelFormat, ...] = tuple(PIXEL_FORMATS[name] for name in ("Mono8", "Mono12", "Mono12Packed"))

#: Stream packet size in bytes: loopback takes jumbo frames, and fewer packets cost less time.
_PACKET_BYTES = 9000

_FillPattern = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)


class FrameSource(Protocol):
    """Where the simulated camera's pixels come from."""

    @property
    def state(self) -> Hashable:
        """What the pixels depend on beside exposure and gain; rendered frames are kept while it is the same."""

    def expose(self, exposure_s: float, gain_db: float, index: int) -> NDArray[np.uint16]:
        """Render exposure number `index`: 12-bit DN, shape (sensor height, sensor width)."""


@dataclass(frozen=True)
class SimulatedDevice:
    """What the simulated camera says of itself.

    Parameters
    ----------
    serial : str
        At most 15 characters.
    width, height : int
        Sensor size in pixels.
    temperature_c, black_level_dn : float
        What the registers tell.
    vendor, model : str
        At most 31 characters.
    frame_rate_hz : float
        Frame rate after switching on.
    """

    serial: str
    width: int = 2452
    height: int = 2056
    temperature_c: float = 35.0
    black_level_dn: float = 0.0
    vendor: str = "Allied Vision Technologies"
    model: str = "Manta_G-505B"
    frame_rate_hz: float = 15.0


class SimulatedGigECamera:
    """Serve a frame source as a GigE Vision camera, from `start` to `stop`.

    Frames are rendered when first asked for; once `pool_size` of them exist for one exposure, gain and state,
    they are sent in turn, so that the camera keeps its frame rate.

    Parameters
    ----------
    device : SimulatedDevice
        What the camera says of itself.
    source : FrameSource
        Where the pixels come from.
    address : str
        Loopback address to serve; one camera each.
    pool_size : int
        Rendered frames kept.
    """

    def __init__(
        self, device: SimulatedDevice, source: FrameSource, address: str = "127.0.0.1", pool_size: int = 4
    ) -> None:
        self.device = device
        self.address = address
        self._source = source
        self._pool_size = pool_size
        self._pool_key: Hashable = None
        self._pool: list[NDArray[np.uint8]] = []
        self._n_sent = 0
        self._gv: Any = None
        self._lib: Any = None
        # Aravis keeps only the pointer: the callback must live as long as the camera.
        self._callback = _FillPattern(self._fill)

    def __enter__(self) -> Self:
        """Start."""
        return self.start()

    def __exit__(self, *exc: object) -> None:
        """Stop."""
        self.stop()

    def start(self) -> Self:
        """Begin to answer.

        Raises
        ------
        CameraError
            If Aravis is missing, or another camera or program has the address.
        """
        arv = aravis()
        _check_free(self.address)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "camera.xml")
            path.write_text(description(self.device.vendor, self.device.model, FORMATS), encoding="utf-8")
            self._gv = arv.GvFakeCamera.new_full(self.address, self.device.serial, str(path))
        if not self._gv.is_running():
            self._gv = None
            raise CameraError(f"the simulated camera cannot use {self.address}: no network interface has this address")
        _keep_discovery_on_loopback()
        self._write_registers()
        self._lib = ctypes.CDLL("libaravis-0.8.so.0")
        self._lib.arv_buffer_get_data.restype = ctypes.c_void_p
        self._lib.arv_buffer_get_data.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        self._set_fill_pattern(self._callback)
        return self

    def stop(self) -> None:
        """Stop answering, as if the cable were pulled; may be called twice."""
        self._gv = None
        # Aravis' thread ends when the last reference goes, which may sit in a cycle.
        gc.collect()

    def set_packet_loss(self, ratio: float) -> None:
        """Lose this share of the stream's packets, 0 to 1, to see what a bad network does."""
        self._gv.set_property("gvsp-lost-ratio", float(ratio))

    def _set_fill_pattern(self, callback: Any) -> None:
        # PyGObject's binding of this function crashes (wrong annotation); the C function works.
        function = self._lib.arv_fake_camera_set_fill_pattern
        function.argtypes = [ctypes.c_void_p, _FillPattern, ctypes.c_void_p]
        function.restype = None
        function(hash(self._gv.get_fake_camera()), callback, None)

    def _write_registers(self) -> None:
        device = self.device
        self._write_text(Address.VENDOR, device.vendor, 32)
        self._write_text(Address.MODEL, device.model, 32)
        self._write_text(Address.MANUFACTURER_INFO, "labcdp simulated camera", 48)
        registers = {
            Address.SENSOR_WIDTH: device.width,
            Address.SENSOR_HEIGHT: device.height,
            Address.WIDTH: device.width,
            Address.HEIGHT: device.height,
            Address.PIXEL_FORMAT: PIXEL_FORMATS["Mono12"].code,
            Address.FRAME_PERIOD_US: round(1e6 / device.frame_rate_hz),
            Address.BLACK_LEVEL: round(device.black_level_dn),
            Address.TEMPERATURE: round(device.temperature_c * TEMPERATURE_STEPS_PER_C),
            Address.GAIN: 0,
            Address.PACKET_SIZE: _PACKET_BYTES,
        }
        for address, value in registers.items():
            self._gv.get_fake_camera().write_register(address, value)

    def _write_text(self, address: int, text: str, length: int) -> None:
        raw = text.encode("ascii")
        if len(raw) >= length:
            raise CameraError(f"{text!r} is too long for the camera's register: use up to {length - 1} letters")
        for start in range(0, length, 4):
            word = int.from_bytes(raw.ljust(length, b"\0")[start : start + 4], "big")
            self._gv.get_fake_camera().write_register(address + start, word)

    def _fill(self, buffer: int, _user_data: int | None, exposure_us: int, gain_steps: int, format_code: int) -> None:
        """Write the pixels of the next frame; called in Aravis' thread before it is sent."""
        if self._gv is None:
            return  # being stopped
        try:
            payload = self._payload(exposure_us, gain_steps, format_code)
            ctypes.memmove(self._lib.arv_buffer_get_data(buffer, None), payload.ctypes.data, payload.nbytes)
            period_us = self._register(Address.FRAME_PERIOD_US)
            time.sleep(max(0, exposure_us - period_us) * 1e-6)
        except Exception:
            _log.exception("the simulated camera could not render a frame")

    def _register(self, address: Address) -> int:
        return int(self._gv.get_fake_camera().read_register(address).value)

    def _payload(self, exposure_us: int, gain_steps: int, format_code: int) -> NDArray[np.uint8]:
        region = tuple(self._register(a) for a in (Address.OFFSET_X, Address.OFFSET_Y, Address.WIDTH, Address.HEIGHT))
        key = (self._source.state, exposure_us, gain_steps, format_code, region)
        if key != self._pool_key:
            self._pool, self._pool_key = [], key
        index = self._n_sent
        self._n_sent += 1
        if len(self._pool) < self._pool_size:
            dn = self._source.expose(exposure_us * 1e-6, gain_steps / GAIN_STEPS_PER_DB, index)
            self._pool = [*self._pool, _payload_of(dn, region, format_code)]
            return self._pool[-1]
        return self._pool[index % self._pool_size]


def _payload_of(dn: NDArray[np.uint16], region: tuple[int, ...], format_code: int) -> NDArray[np.uint8]:
    x, y, width, height = region
    layout = next(form for form in FORMATS if form.code == format_code)
    window = np.zeros((height, width), dtype=np.uint16)
    part = dn[y : y + height, x : x + width]
    window[: part.shape[0], : part.shape[1]] = part
    # A 12-bit sensor sends its eight most significant bits in an 8-bit format.
    return layout.pack(np.right_shift(window, 12 - layout.bit_depth, dtype=np.uint16))


def _check_free(address: str) -> None:
    """Aravis does not notice a taken port and one would reach somebody else's camera."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, GVCP_PORT))
        except OSError as error:
            remedy = (
                "end the other simulated camera or program that uses it"
                if error.errno == errno.EADDRINUSE
                else "give an address of this machine, best a loopback one"
            )
            raise CameraError(
                f"the simulated camera cannot use {address}, UDP port {GVCP_PORT} ({error.strerror}): {remedy}"
            ) from error


def _keep_discovery_on_loopback() -> None:
    """Let only loopback discover the camera.

    Aravis' simulator also listens to broadcasts, which come from every network. Answering there would show the
    camera to other machines, and make clients on this one look for its frames on the wrong interface.
    """
    for listener, address in own_udp_sockets():
        if address == ("255.255.255.255", GVCP_PORT):
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo\0")
