"""A GigE Vision camera on loopback whose pixels come from a frame source.

The protocol side is Aravis' own GigE Vision simulator (``ArvGvFakeCamera``), with our GenICam description and
our pixels.
"""

from __future__ import annotations

import ctypes
import gc
import logging
import tempfile
import threading
import time
from collections.abc import Callable, Hashable
from functools import cache
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from ..aravis.gvcp import STREAM_CHANNEL_PORT
from ..aravis.library import aravis, aravis_c
from ..camera import CameraError
from ..device import Device, on_error
from .commands import RESEND_KINDS, CameraFaults
from .control import ControlPort, check_free, request_filter
from .device import TEMPERATURE_STEPS_PER_C, FrameRenderer, FrameSource, Registers, SimulatedDevice, Wanted
from .genicam import CHUNK_IDS, RegisterAddress, chunk_bytes, description, writable_registers
from .path import TestPackets
from .resend import CAN_RESEND, CAPABILITY, ResendPort
from .sender import ImageLeader, SentFrame, StreamSender, with_chunks

__all__ = ["SimulatedDevice", "SimulatedGigECamera"]

_log = logging.getLogger(__name__)

#: Offset of wrong frame ids: Aravis treats ids up to 100 behind the last one as late packets.
_BACKWARD: Final = 1000


_FillPattern = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)


@cache
def _aravis_c() -> ctypes.CDLL:
    """Load Aravis' C library, with the types of the functions used of it."""
    library, pointer, number = aravis_c(), ctypes.c_void_p, ctypes.c_uint64
    for name, result, arguments in (
        ("arv_buffer_get_data", pointer, (pointer, pointer)),
        ("arv_buffer_get_frame_id", number, (pointer,)),
        ("arv_buffer_get_timestamp", number, (pointer,)),
        ("arv_buffer_set_frame_id", None, (pointer, number)),
        ("arv_fake_camera_set_fill_pattern", None, (pointer, _FillPattern, pointer)),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


class SimulatedGigECamera(Device):
    """Serve a frame source as a GigE Vision camera, from `start` to `stop`.

    Each frame is rendered for itself and sent at the first tick of the frame rate after its exposure.

    Parameters
    ----------
    device : SimulatedDevice
        Identity of the camera.
    source : FrameSource
        Source of the pixels.
    address : str
        Loopback address to serve; one camera each.
    temperature : callable or None
        Returns the temperature of the device in degrees Celsius; None for a constant one.
    """

    def __init__(
        self,
        device: SimulatedDevice,
        source: FrameSource,
        address: str = "127.0.0.1",
        temperature: Callable[[], float] | None = None,
    ) -> None:
        self.device = device
        self.address = address
        self._renderer = FrameRenderer(source)
        self._sender = StreamSender(address, bare_chunks=device.bare_chunks)
        self._resend: ResendPort | None = None
        self._path: TestPackets | None = None
        self._temperature = temperature
        self._has_chunk_data = "ChunkSelector" in device.features.get("ChunkDataControl", {})
        self._frame_id: int | None = None
        self._exposing: Hashable = None
        self._exposed_at_s = 0.0
        self._triggered_at_s: float | None = None
        self._faults: CameraFaults = {}
        self._right_height: int | None = None
        self._started = False
        # Held by all users of the camera: its last reference must not be dropped in the thread that its destruction
        # joins.
        self._lock = threading.RLock()
        self._gv: Any = None
        self._registers: Registers | None = None
        self._control: ControlPort | None = None
        # Aravis keeps only the pointer: the callback must live as long as the camera.
        self._callback = _FillPattern(self._fill)

    def open(self) -> Self:
        """Start answering, with the current faults; does nothing if it answers.

        Raises
        ------
        CameraError
            If Aravis is missing, or another camera or program has the address.
        """
        if not self._started:
            faults, self._faults = self._faults, {}
            self._renderer.open()
            if "vanish" not in faults:
                with on_error(self._renderer.close):
                    self._switch_on()
            self._started = True
            self.set_faults(faults)
        return self

    def close(self) -> None:
        """Stop answering, as with the cable pulled; may be called twice."""
        self._started = False
        self._switch_off()
        self._renderer.close()
        self._sender.close()
        for helper in (self._resend, self._path):
            if helper is not None:
                helper.close()
        self._resend = self._path = None

    def set_faults(self, faults: CameraFaults) -> None:
        """Replace the current faults.

        Raises
        ------
        CameraError
            If it is to be restored but its address is in use.
        """
        before, self._faults = self._faults, faults
        if not self._started:
            return
        gone = "vanish" in faults
        if gone and "vanish" not in before:
            self._switch_off()
        elif not gone and "vanish" in before:
            self._switch_on()
        with self._lock:
            if self._control is not None:
                self._control.deaf("freeze" in faults)
            self._set_height("wrong size" in faults)
            self._set_resend()
            self._set_path()
            self._lose(self._share_lost())

    def follow_temperature(self) -> None:
        """Update the temperature register."""
        with self._lock:
            if self._temperature is not None and self._registers is not None:
                self._registers.write(RegisterAddress.TEMPERATURE, round(self._temperature() * TEMPERATURE_STEPS_PER_C))

    def _switch_on(self) -> None:
        arv = aravis()
        check_free(self.address)
        device = self.device
        text = description(device.vendor, device.model, device.features).encode()
        writable = writable_registers(device.features, device.width, device.height)
        control = ControlPort(self.address, request_filter(writable, len(text)))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "camera.xml")
            path.write_bytes(text)
            gv = arv.GvFakeCamera.new_full(self.address, device.serial, str(path))
        if not gv.is_running():
            raise CameraError(
                f"the simulated camera cannot use {self.address}", "no network interface has this address"
            )
        control.find()
        with self._lock:
            self._gv, self._control = gv, control
            self._registers = Registers(gv.get_fake_camera())
            self._registers.switch_on(device)
            self._frame_id, self._exposing, self._triggered_at_s = None, None, None
            self._right_height = None
            self.follow_temperature()
            # PyGObject's binding of this function crashes (wrong annotation); the C function works.
            _aravis_c().arv_fake_camera_set_fill_pattern(hash(gv.get_fake_camera()), self._callback, None)

    def _switch_off(self) -> None:
        with self._lock:
            gone, self._gv = self._gv, None
            self._registers = self._control = None
        # Aravis' thread, which may wait for the lock, ends with the last reference, possibly in a reference cycle.
        del gone
        gc.collect()

    def _set_resend(self) -> None:
        """Send packets again on request, or no longer."""
        kind = self._faults.get("resend")
        if self._registers is not None:
            able = self._registers.read(CAPABILITY) & ~CAN_RESEND
            self._registers.write(CAPABILITY, able if kind is None else able | CAN_RESEND)
        if kind is None and self._resend is not None:
            self._resend.close()
            self._resend = None
        if kind is not None:
            self._resend = self._resend or ResendPort(self.address)
            self._resend.kind = RESEND_KINDS[int(kind)]

    def _set_path(self) -> None:
        """Let packets up to a size through, and answer to test packets."""
        largest = self._faults.get("path")
        if self._path is not None:
            self._path.close()
            self._path = None
        if largest is not None and self._registers is not None:
            self._path = TestPackets(self.address, self._registers, int(largest))

    def _share_lost(self) -> float:
        faults = self._faults
        if self._path is not None and self._path.is_blocked():
            return 1.0
        return 1.0 if "stall" in faults or "freeze" in faults else faults.get("lose", 0.0)

    def _lose(self, share: float) -> None:
        if self._gv is not None:
            self._gv.set_property("gvsp-lost-ratio", share)

    def _set_height(self, wrong: bool) -> None:
        """Halve or restore the height of the frames."""
        if self._registers is None:
            return
        if wrong and self._right_height is None:
            self._right_height = self._registers.read(RegisterAddress.HEIGHT)
            self._registers.write(RegisterAddress.HEIGHT, max(1, self._right_height // 2))
        elif not wrong and self._right_height is not None:
            self._registers.write(RegisterAddress.HEIGHT, self._right_height)
            self._right_height = None

    def _fill(self, buffer: int, _user_data: int | None, exposure_us: int, gain_steps: int, format_code: int) -> None:
        """Write the pixels of the next frame; called in Aravis' thread before it is sent."""
        with self._lock:
            if self._registers is None:
                return  # being stopped
            try:
                self._send(self._registers, buffer, exposure_us, gain_steps, format_code)
            except Exception:
                _log.exception("the simulated camera could not render a frame")

    def _send(self, registers: Registers, buffer: int, exposure_us: int, gain_steps: int, format_code: int) -> None:
        triggered = registers.read(RegisterAddress.TRIGGER_MODE) != 0
        if "wrong exposure" in self._faults:
            exposure_us *= 2
        payload, wanted = None, Wanted(exposure_us, gain_steps, format_code, registers.readout(self.device))
        if not (self._exposing_triggered(exposure_us) if triggered else self._exposing_freely(registers, exposure_us)):
            payload = self._renderer.next(wanted)
        if payload is None:
            self._lose(1.0)
            if triggered:  # repeat
                registers.write(RegisterAddress.TRIGGER_SOFTWARE, 1)
            return
        self._triggered_at_s = None
        self._exposed_at_s = time.monotonic()
        self._lose(self._share_lost())
        self.follow_temperature()
        # Bits of a pixel stand in the code of its format (PFNC 2.1); Aravis' simulator rounds the size down.
        n_bytes = wanted.readout.width * wanted.readout.height * (format_code >> 16 & 0xFF) // 8
        frame = self._sent_frame(registers, payload, self._next_id(registers, buffer), wanted)
        if self._resend is not None:
            self._resend.keep(registers, frame)
        if frame.has_chunks or frame.long_ids or n_bytes < payload.nbytes:
            share = self._share_lost()
            self._lose(1.0)
            size = (wanted.readout.width, wanted.readout.height, wanted.readout.x, wanted.readout.y)
            stamp_ns = int(_aravis_c().arv_buffer_get_timestamp(buffer))
            self._sender.send(registers, frame, ImageLeader(stamp_ns, format_code, *size), share)
            return
        ctypes.memmove(_aravis_c().arv_buffer_get_data(buffer, None), payload.ctypes.data, n_bytes)
        _aravis_c().arv_buffer_set_frame_id(buffer, frame.frame_id)

    def _sent_frame(self, registers: Registers, pixels: NDArray[np.uint8], frame_id: int, wanted: Wanted) -> SentFrame:
        """Return a frame with the chunks that are switched on."""
        long_ids = registers.read(RegisterAddress.LONG_IDS) != 0
        if not (self._has_chunk_data and registers.read(RegisterAddress.CHUNK_MODE)):
            return SentFrame(pixels, frame_id, long_ids=long_ids)
        values = {
            "ExposureTime": wanted.exposure_us,
            "Gain": wanted.gain_steps,
            "Timestamp": time.monotonic_ns(),
            "FrameID": frame_id & 0xFFFFFFFF,
        }
        enabled = [registers.read(RegisterAddress.CHUNKS_ENABLED + 4 * number) for number in range(len(CHUNK_IDS))]
        chunks = {
            CHUNK_IDS[name]: value.to_bytes(chunk_bytes(name), "big")
            for (name, value), is_enabled in zip(values.items(), enabled, strict=True)
            if is_enabled
        }
        return SentFrame(with_chunks(pixels, chunks), frame_id, has_chunks=True, long_ids=long_ids)

    def _exposing_triggered(self, exposure_us: int) -> bool:
        """Whether the exposure of a triggered frame is in progress; triggers are ignored meanwhile."""
        now_s = time.monotonic()
        if self._triggered_at_s is None:
            self._triggered_at_s = now_s
        return now_s - self._triggered_at_s < exposure_us * 1e-6

    def _exposing_freely(self, registers: Registers, exposure_us: int) -> bool:
        """Whether a frame of this exposure cannot be ready yet; in between, the camera sends nothing."""
        now_s = time.monotonic()
        period_us = registers.read(RegisterAddress.FRAME_PERIOD_US)
        # A stream has its own port.
        exposing = (registers.read(STREAM_CHANNEL_PORT), exposure_us)
        if exposing != self._exposing:
            self._exposing, self._exposed_at_s = exposing, now_s
            return exposure_us > period_us
        # Tolerance of half a period: ticks are not exactly equidistant.
        return now_s - self._exposed_at_s < (exposure_us - period_us / 2) * 1e-6

    def _next_id(self, registers: Registers, buffer: int) -> int:
        """Return the id to send; ids of GigE Vision have 16 or 64 bits and leave out 0."""
        largest = 0xFFFF if registers.read(RegisterAddress.LONG_IDS) == 0 else 0xFFFFFFFFFFFFFFFF
        if self._frame_id is None:
            first = self.device.first_frame_id
            self._frame_id = int(_aravis_c().arv_buffer_get_frame_id(buffer)) if first is None else first
        else:
            self._frame_id = self._frame_id % largest + 1
        if "wrong ids" not in self._faults:
            return self._frame_id
        # Alternately the previous id, and one far behind.
        back = 1 if self._frame_id % 2 else _BACKWARD
        return (self._frame_id - 1 - back) % largest + 1
