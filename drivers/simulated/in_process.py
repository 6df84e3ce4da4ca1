"""A camera in this process, without Aravis or a network: for machines on which these cannot be had."""

from __future__ import annotations

import time
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Self

from ...frame import CameraIdentity, Frame
from ..camera import CameraError, CameraSettingError, CameraSettings
from .camera import FrameSource, SimulatedDevice
from .genicam import EXPOSURE_RANGE_US, GAIN_RANGE_DB


class InProcessCamera:
    """The simulated camera behind the camera protocol, with no wire between; 12-bit only.

    Parameters
    ----------
    device : SimulatedDevice
        What the camera says of itself.
    source : FrameSource
        Where the pixels come from.
    """

    def __init__(self, device: SimulatedDevice, source: FrameSource) -> None:
        self._device = device
        self._source = source
        self._settings = CameraSettings(0.01, 0.0, "Mono12", device.width, device.height)
        self._open = False
        self._n_taken = 0

    def open(self) -> Self:
        """Switch on."""
        self._open = True
        return self

    def close(self) -> None:
        """Switch off; may be called twice."""
        self._open = False

    def __enter__(self) -> Self:
        """Open."""
        return self.open()

    def __exit__(self, *exc: object) -> None:
        """Close."""
        self.close()

    @property
    def identity(self) -> CameraIdentity:
        """Vendor, model and serial number; raises CameraError if not open."""
        self._require_open()
        device = self._device
        return CameraIdentity(device.vendor, device.model, device.serial, simulated=True)

    @property
    def settings(self) -> CameraSettings:
        """Settings in force."""
        self._require_open()
        return self._settings

    def configure(
        self,
        *,
        exposure_s: float | None = None,
        gain_db: float | None = None,
        pixel_format: str | None = None,
    ) -> CameraSettings:
        """Change what is given, keep the rest; raises CameraSettingError for values out of range."""
        old = self.settings
        exposure_us = round((old.exposure_s if exposure_s is None else exposure_s) * 1e6)
        gain = old.gain_db if gain_db is None else gain_db
        if not EXPOSURE_RANGE_US[0] <= exposure_us <= EXPOSURE_RANGE_US[1]:
            low, high = (us * 1e-6 for us in EXPOSURE_RANGE_US)
            raise CameraSettingError(f"exposure_s is {exposure_us * 1e-6:g} s: the camera takes {low:g} to {high:g} s")
        if not GAIN_RANGE_DB[0] <= gain <= GAIN_RANGE_DB[1]:
            raise CameraSettingError(
                f"gain_db is {gain:g} dB: the camera takes {GAIN_RANGE_DB[0]} to {GAIN_RANGE_DB[1]} dB"
            )
        if pixel_format not in (None, "Mono12"):
            raise CameraSettingError(f"the camera in this process has no pixel format {pixel_format!r}: choose Mono12")
        self._settings = CameraSettings(exposure_us * 1e-6, gain, "Mono12", old.width, old.height)
        return self._settings

    def snap(self, timeout_s: float | None = None) -> Frame:
        """Take one frame; it never times out."""
        settings = self.settings
        dn = self._source.expose(settings.exposure_s, settings.gain_db, self._n_taken)
        self._n_taken += 1
        return Frame(
            dn=dn,
            exposure_s=settings.exposure_s,
            gain_db=settings.gain_db,
            bit_depth=12,
            saturation_dn=4095,
            black_level_dn=self._device.black_level_dn,
            pixel_format="Mono12",
            colour_filter=None,
            temperature_c=self._device.temperature_c,
            timestamp=datetime.now(UTC),
            camera_timestamp_ns=time.monotonic_ns(),
            frame_id=self._n_taken,
            camera=self.identity,
        )

    def grab(self, n: int, timeout_s: float | None = None) -> Iterator[Frame]:
        """Take `n` frames in a row."""
        for _ in range(n):
            yield self.snap(timeout_s)

    def _require_open(self) -> None:
        if not self._open:
            raise CameraError("the camera is not open: use it as a context manager or call open() first")
