"""The simulated camera: identity, frame source, registers, and readout and rendering of its frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.dn import PIXEL_FORMATS, PixelFormat
from ..camera import CameraError
from .genicam import FeatureTable, RegisterAddress, feature, initial_values, standard_features

#: Formats the simulated camera may offer, by code.
FORMATS: Mapping[int, PixelFormat] = {form.code: form for form in PIXEL_FORMATS.values()}

#: Depth of the simulated sensor, and its highest DN.
SENSOR_BITS = 12
FULL_SCALE_DN = 2**SENSOR_BITS - 1


class FrameSource(Protocol):
    """Source of the simulated camera's pixels."""

    @property
    def state(self) -> Hashable:
        """State that the pixels depend on besides exposure and gain; frames rendered ahead in another are dropped."""

    def next_key(self) -> tuple[int, ...]:
        """Return the key of the noise of the next exposure."""

    def expose(self, exposure_s: float, gain_db: float, key: tuple[int, ...]) -> NDArray[np.uint16]:
        """Render an exposure with the noise of a key: 12-bit DN, shape (sensor height, sensor width)."""


@dataclass(frozen=True)
class SimulatedDevice:
    """Identity of the simulated camera.

    Parameters
    ----------
    serial : str
        At most 15 characters.
    width, height : int
        Sensor size in pixels.
    temperature_c, black_level_dn : float
        Register values after power-on.
    vendor, model : str
        At most 31 characters.
    frame_rate_hz : float
        Frame rate after power-on.
    features : FeatureTable
        Its GenICam features.
    colour_filter : str or None
        First two pixels of its Bayer pattern; None for a monochrome camera.
    first_frame_id : int or None
        Id of the first frame after power-on; None for that of Aravis' simulator.
    bare_chunks : bool
        Whether the leader of frames with chunks says nothing of their image, as that of older cameras.
    """

    serial: str
    width: int = 2452
    height: int = 2056
    temperature_c: float = 35.0
    black_level_dn: float = 0.0
    vendor: str = "Allied Vision Technologies"
    model: str = "Manta_G-505B"
    frame_rate_hz: float = 15.0
    features: FeatureTable = field(default_factory=standard_features)
    colour_filter: str | None = None
    first_frame_id: int | None = None
    bare_chunks: bool = False


@dataclass(frozen=True)
class FrameReadout:
    """Readout of an exposure as a frame.

    Parameters
    ----------
    x, y, width, height : int
        Part of the sensor that is sent, in pixels after binning.
    binning : (int, int)
        Columns and rows averaged into one pixel.
    black_level_change_dn : int
        Added to the sensor's own black level.
    mirrored : (bool, bool)
        Whether columns and rows are sent in reverse order.
    """

    x: int
    y: int
    width: int
    height: int
    binning: tuple[int, int] = (1, 1)
    black_level_change_dn: int = 0
    mirrored: tuple[bool, bool] = (False, False)

    def payload(self, dn: NDArray[np.uint16], layout: PixelFormat) -> NDArray[np.uint8]:
        """Read out an exposure, shape (sensor height, sensor width), as the bytes of a frame."""
        window = np.zeros((self.height, self.width), dtype=np.uint16)
        part = self._shifted(_averaged(dn, self.binning))[self.y :, self.x :][: self.height, : self.width]
        window[: part.shape[0], : part.shape[1]] = part
        columns, rows = self.mirrored
        window = np.ascontiguousarray(window[:: -1 if rows else 1, :: -1 if columns else 1])
        # The most significant bits of an 8-bit format are those of the sensor, and of a 16-bit one too; there the
        # others repeat them, so that full scale is full scale.
        if layout.bit_depth == 16:
            wide: NDArray[np.uint16] = window * np.uint16(16) + window // np.uint16(256)
            return layout.pack(wide)
        return layout.pack(np.right_shift(window, 12 - layout.bit_depth, dtype=np.uint16))

    def _shifted(self, dn: NDArray[np.uint16]) -> NDArray[np.uint16]:
        if self.black_level_change_dn == 0:
            return dn
        shifted = np.clip(dn.astype(np.int32) + self.black_level_change_dn, 0, FULL_SCALE_DN)
        moved: NDArray[np.uint16] = shifted.astype(np.uint16)
        # The converter saturates whatever is subtracted.
        moved[dn == FULL_SCALE_DN] = FULL_SCALE_DN
        return moved


def _averaged(dn: NDArray[np.uint16], binning: tuple[int, int]) -> NDArray[np.uint16]:
    columns, rows = binning
    if binning == (1, 1):
        return dn
    height, width = dn.shape[0] // rows, dn.shape[1] // columns
    blocks = dn[: height * rows, : width * columns].reshape(height, rows, width, columns)
    # Rounds half up, like an adder followed by a shift.
    total = blocks.sum(axis=(1, 3), dtype=np.uint32)
    average: NDArray[np.uint16] = ((2 * total + rows * columns) // (2 * rows * columns)).astype(np.uint16)
    return average


#: Steps of the register of the temperature.
TEMPERATURE_STEPS_PER_C = feature("DeviceTemperature")["steps"]


class Registers:
    """Registers of Aravis' simulator.

    Parameters
    ----------
    fake : Aravis.FakeCamera
        Camera of Aravis' simulator.
    """

    def __init__(self, fake: Any) -> None:
        self._fake = fake

    def read(self, address: int) -> int:
        """Return a number."""
        return int(self._fake.read_register(address).value)

    def write(self, address: int, value: int) -> None:
        """Store a number."""
        self._fake.write_register(address, value)

    def write_text(self, address: RegisterAddress, text: str, length: int) -> None:
        """Store text of less than `length` letters; raises CameraError if it is longer."""
        raw = text.encode("ascii")
        if len(raw) >= length:
            raise CameraError(f"{text!r} is too long for the camera's register", f"use up to {length - 1} letters")
        for start in range(0, length, 4):
            self.write(address + start, int.from_bytes(raw.ljust(length, b"\0")[start : start + 4], "big"))

    def switch_on(self, device: SimulatedDevice) -> None:
        """Store the values of a device after power-on."""
        self.write_text(RegisterAddress.VENDOR, device.vendor, 32)
        self.write_text(RegisterAddress.MODEL, device.model, 32)
        self.write_text(RegisterAddress.MANUFACTURER_INFO, "labcdp simulated camera", 48)
        numbers = initial_values(device.features) | {
            RegisterAddress.SENSOR_WIDTH: device.width,
            RegisterAddress.SENSOR_HEIGHT: device.height,
            RegisterAddress.WIDTH: device.width,
            RegisterAddress.HEIGHT: device.height,
            RegisterAddress.FRAME_PERIOD_US: round(1e6 / device.frame_rate_hz),
            RegisterAddress.BLACK_LEVEL: round(device.black_level_dn),
            RegisterAddress.TEMPERATURE: round(device.temperature_c * TEMPERATURE_STEPS_PER_C),
            RegisterAddress.TICK_FREQUENCY_HIGH: 0,
        }
        for address, value in numbers.items():
            self.write(address, value)

    def readout(self, device: SimulatedDevice) -> FrameReadout:
        """Return the current readout of a device."""
        return FrameReadout(
            x=self.read(RegisterAddress.OFFSET_X),
            y=self.read(RegisterAddress.OFFSET_Y),
            width=self.read(RegisterAddress.WIDTH),
            height=self.read(RegisterAddress.HEIGHT),
            binning=(self.read(RegisterAddress.BINNING_HORIZONTAL), self.read(RegisterAddress.BINNING_VERTICAL)),
            black_level_change_dn=self.read(RegisterAddress.BLACK_LEVEL) - round(device.black_level_dn),
            mirrored=(self.read(RegisterAddress.REVERSE_X) != 0, self.read(RegisterAddress.REVERSE_Y) != 0),
        )


_GAIN_STEPS_PER_DB: Final = feature("Gain")["steps"]

#: Frames rendered ahead: one to send while the next is made.
_AHEAD: Final = 2

#: Exposure of the frame that is rendered before the camera answers.
_FIRST_EXPOSURE_S: Final = 0.01

#: A frame as bytes, with the state of the source that it shows; None if the state changed while it was rendered.
_Rendered = tuple[Hashable, NDArray[np.uint8] | None]


@dataclass(frozen=True)
class Wanted:
    """Specification of a frame.

    Parameters
    ----------
    exposure_us, gain_steps, format_code : int
        Values of the registers.
    readout : FrameReadout
        Readout of the sensor.
    """

    exposure_us: int
    gain_steps: int
    format_code: int
    readout: FrameReadout


class FrameRenderer:
    """Frames rendered ahead, each sent once.

    Parameters
    ----------
    source : FrameSource
        Source of the pixels.
    """

    def __init__(self, source: FrameSource) -> None:
        self._source = source
        self._executor: ThreadPoolExecutor | None = None
        self._kind: Hashable = None
        self._coming: deque[Future[_Rendered]] = deque()

    def open(self) -> None:
        """Start rendering, once what is compiled or calculated for the first frame is there: it may take long."""
        self._source.expose(_FIRST_EXPOSURE_S, 0.0, (0,))
        self._executor = ThreadPoolExecutor(1, "simulated camera")

    def close(self) -> None:
        """Stop rendering; may be called twice."""
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
            self._executor = None
            self._coming.clear()

    def next(self, wanted: Wanted) -> NDArray[np.uint8] | None:
        """Return the next frame, or None if it is not rendered yet."""
        state = self._source.state
        if (state, wanted) != self._kind:
            self._kind = (state, wanted)
            for outdated in self._coming:
                outdated.cancel()
            self._coming.clear()
        frame = None
        if self._coming and self._coming[0].done():
            shown, rendered = self._coming.popleft().result()
            frame = rendered if shown == state else None
        while len(self._coming) < _AHEAD and self._executor is not None:
            self._coming.append(self._executor.submit(self._render, wanted, self._source.next_key()))
        return frame

    def _render(self, wanted: Wanted, key: tuple[int, ...]) -> _Rendered:
        state = self._source.state
        dn = self._source.expose(wanted.exposure_us * 1e-6, wanted.gain_steps / _GAIN_STEPS_PER_DB, key)
        if self._source.state != state:
            return state, None
        return state, wanted.readout.payload(dn, FORMATS[wanted.format_code])
