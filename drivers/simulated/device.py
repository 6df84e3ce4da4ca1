"""What the simulated camera is: its specimen, its pixel source, and the pixels that its settings make of them."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...pixel_format import PIXEL_FORMATS, PixelFormat
from .genicam import Naming

#: Formats the simulated camera offers.
FORMATS: tuple[PixelFormat, ...] = tuple(PIXEL_FORMATS[n] for n in ("Mono8", "Mono12", "Mono12Packed", "Mono16"))

#: Highest DN of the simulated sensor.
FULL_SCALE_DN = 4095


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
        What the registers tell after switching on.
    vendor, model : str
        At most 31 characters.
    frame_rate_hz : float
        Frame rate after switching on.
    naming : {'prosilica', 'sfnc'}
        Whose names the GenICam features have.
    """

    serial: str
    width: int = 2452
    height: int = 2056
    temperature_c: float = 35.0
    black_level_dn: float = 0.0
    vendor: str = "Allied Vision Technologies"
    model: str = "Manta_G-505B"
    frame_rate_hz: float = 15.0
    naming: Naming = "prosilica"


@dataclass(frozen=True)
class Readout:
    """How an exposure becomes a frame.

    Parameters
    ----------
    x, y, width, height : int
        Part of the sensor that is sent, in pixels after binning.
    binning : (int, int)
        Columns and rows joined into one pixel, by averaging.
    black_level_change_dn : int
        Added to the sensor's own black level.
    """

    x: int
    y: int
    width: int
    height: int
    binning: tuple[int, int] = (1, 1)
    black_level_change_dn: int = 0

    def payload(self, dn: NDArray[np.uint16], layout: PixelFormat) -> NDArray[np.uint8]:
        """Read out an exposure, shape (sensor height, sensor width), as the bytes of a frame."""
        window = np.zeros((self.height, self.width), dtype=np.uint16)
        part = self._shifted(_averaged(dn, self.binning))[self.y :, self.x :][: self.height, : self.width]
        window[: part.shape[0], : part.shape[1]] = part
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
        # The converter is full whatever is subtracted.
        moved[dn == FULL_SCALE_DN] = FULL_SCALE_DN
        return moved


def _averaged(dn: NDArray[np.uint16], binning: tuple[int, int]) -> NDArray[np.uint16]:
    columns, rows = binning
    if binning == (1, 1):
        return dn
    height, width = dn.shape[0] // rows, dn.shape[1] // columns
    blocks = dn[: height * rows, : width * columns].reshape(height, rows, width, columns)
    # Half up, as an adder followed by a shift does.
    total = blocks.sum(axis=(1, 3), dtype=np.uint32)
    average: NDArray[np.uint16] = ((2 * total + rows * columns) // (2 * rows * columns)).astype(np.uint16)
    return average
