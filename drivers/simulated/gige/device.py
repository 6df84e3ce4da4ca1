"""The simulated camera: identity, frame source, and readout by its settings."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ....core.pixel_format import PIXEL_FORMATS, PixelFormat
from .genicam import FeatureTable, feature, standard_features

#: Formats the simulated camera offers.
FORMATS: tuple[PixelFormat, ...] = tuple(PIXEL_FORMATS[name] for name in feature("PixelFormat")["choices"])

#: Depth of the simulated sensor, and its highest DN.
SENSOR_BITS = 12
FULL_SCALE_DN = 2**SENSOR_BITS - 1


class FrameSource(Protocol):
    """Source of the simulated camera's pixels."""

    @property
    def state(self) -> Hashable:
        """State that the pixels depend on besides exposure and gain; frames rendered ahead in another are dropped."""

    def expose(self, exposure_s: float, gain_db: float, index: int) -> NDArray[np.uint16]:
        """Render exposure number `index`: 12-bit DN, shape (sensor height, sensor width)."""


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


@dataclass(frozen=True)
class Readout:
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
