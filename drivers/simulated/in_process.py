"""The simulated camera in this process, without Aravis or a network, timed by any clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import ceil
from typing import Final, Self

import numpy as np

from ...core.clock import Clock, SystemClock
from ...core.frame import CameraIdentity, Frame, Readout
from ..camera import (
    MOST_REFUSED,
    Camera,
    CameraError,
    CameraSettingError,
    FrameTimeoutError,
    IncompleteFrameError,
    Refused,
    StreamStatistics,
)
from ..camera_settings import CameraSettings, CameraSetup, FeatureValue
from .device import FULL_SCALE_DN, FrameSource, SimulatedDevice
from .faults import STEP_S, Reach
from .genicam import feature

_EXPOSURE_RANGE_US: Final = feature("ExposureTimeAbs")["range"]
_GAIN_RANGE_DB: Final = feature("Gain")["range"]
_FRAME_RATE_RANGE_HZ: Final = feature("AcquisitionFrameRateAbs")["range"]
#: Pixel data of a stream packet: 9000 bytes less headers.
_PACKET_DATA_BYTES: Final = 8964


class InProcessCamera(Reach, Camera):
    """The simulated camera with the camera protocol, without a network; 12-bit only.

    Parameters
    ----------
    device : SimulatedDevice
        Identity of the camera.
    source : FrameSource
        Source of the pixels.
    clock : Clock or None
        Clock of the frames, each of which takes the exposure time or the frame period, whichever is longer; None for
        the system clock.
    temperature : callable or None
        Returns the temperature of the device in degrees Celsius; None for a constant one.
    patience_s : float
        How long to wait for a lost camera to come back; 0 raises CameraLostError at once.

    Raises
    ------
    InputError
        If `patience_s` is negative.
    """

    live = True

    def __init__(
        self,
        device: SimulatedDevice,
        source: FrameSource,
        clock: Clock | None = None,
        *,
        temperature: Callable[[], float] | None = None,
        patience_s: float = 0.0,
    ) -> None:
        self._device = device
        self._source = source
        self._name = CameraIdentity(device.vendor, device.model, device.serial, simulated=True)
        super().__init__(clock or SystemClock(), patience_s, str(self._name))
        self._temperature = temperature or (lambda: device.temperature_c)
        self._settings = CameraSettings(
            0.01,
            0.0,
            "Mono12" if device.colour_filter is None else f"Bayer{device.colour_filter}12",
            device.width,
            device.height,
            Readout(sensor_size=(device.width, device.height)),
            black_level=device.black_level_dn,
            frame_rate_hz=device.frame_rate_hz,
        )
        self._open = False
        self._n_taken = 0
        self._statistics = StreamStatistics()

    def open(self) -> Self:
        """Switch on.

        Raises
        ------
        CameraNotFoundError, CameraBusyError
            If its faults imply so.
        """
        if not self._open:
            self._connect()
            self._open, self._statistics = True, StreamStatistics()
        return self

    def close(self) -> None:
        """Switch off; may be called twice."""
        self._open = False

    def follow_temperature(self) -> None:
        """Do nothing: the temperature is read on demand."""

    @property
    def identity(self) -> CameraIdentity:
        """Vendor, model and serial number; raises CameraError if not open."""
        self._require_open()
        return self._name

    @property
    def settings(self) -> CameraSettings:
        """Settings in force."""
        self._require_open()
        return self._settings

    @property
    def _frame_rate_hz(self) -> float:
        return self._settings.frame_rate_hz or self._device.frame_rate_hz

    @property
    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure."""
        return _EXPOSURE_RANGE_US[0] * 1e-6, _EXPOSURE_RANGE_US[1] * 1e-6

    @property
    def temperature_c(self) -> float:
        """Temperature of the device now."""
        return self._temperature()

    @property
    def statistics(self) -> StreamStatistics:
        """Counters since the camera was opened."""
        return self._statistics

    def features(self) -> dict[str, FeatureValue]:
        """Return the register values of the camera on the wire, by name."""
        device, settings = self._device, self.settings
        return {
            "DeviceVendorName": device.vendor,
            "DeviceModelName": device.model,
            "DeviceID": device.serial,
            "SensorWidth": device.width,
            "SensorHeight": device.height,
            "PixelFormat": settings.pixel_format,
            "DeviceTemperature": self.temperature_c,
            "ExposureTimeAbs": settings.exposure_s * 1e6,
            "AcquisitionFrameRateAbs": self._frame_rate_hz,
            "Gain": settings.gain_db,
            "BlackLevel": settings.black_level,
        }

    def configure(
        self, *, exposure_s: float | None = None, gain_db: float | None = None, pixel_format: str | None = None
    ) -> CameraSettings:
        """Change the given settings, keep the rest.

        Raises
        ------
        CameraSettingError
            For values out of range.
        CameraLostError
            If the camera is lost.
        """
        old = self.settings
        self._await_reconnect()
        exposure_us = round((old.exposure_s if exposure_s is None else exposure_s) * 1e6)
        gain = old.gain_db if gain_db is None else gain_db
        low, high = self.exposure_range_s
        if not _EXPOSURE_RANGE_US[0] <= exposure_us <= _EXPOSURE_RANGE_US[1]:
            raise CameraSettingError(
                f"exposure_s is {exposure_us * 1e-6:g} s", f"the camera takes {low:g} to {high:g} s"
            )
        low, high = _GAIN_RANGE_DB
        if not low <= gain <= high:
            raise CameraSettingError(f"gain_db is {gain:g} dB", f"the camera takes {low} to {high} dB")
        if pixel_format not in (None, old.pixel_format):
            raise CameraSettingError(
                f"the camera in this process has no pixel format {pixel_format!r}", f"choose {old.pixel_format}"
            )
        self._settings = replace(old, exposure_s=exposure_us * 1e-6, gain_db=gain)
        return self._settings

    def prepare(self, wanted: CameraSetup) -> None:
        """Set the frame rate, in whole microseconds; raises CameraSettingError for any other setting."""
        self._require_open()
        given = [name for name in (*wanted.settings, *wanted.features) if name != "frame_rate_hz"]
        if given:
            raise CameraSettingError(
                f"the camera in this process cannot set {given[0]}", "use the one on loopback, without --virtual-clock"
            )
        if wanted.frame_rate_hz is not None:
            low, high = _FRAME_RATE_RANGE_HZ
            if not low <= wanted.frame_rate_hz <= high:
                raise CameraSettingError(
                    f"frame_rate_hz is {wanted.frame_rate_hz:g} Hz", f"the camera takes {low:g} to {high:g} Hz"
                )
            self._settings = replace(self._settings, frame_rate_hz=1e6 / round(1e6 / wanted.frame_rate_hz))

    def grab(self, n: int, timeout_s: float | None = None, on_refused: Refused | None = None) -> Iterator[Frame]:
        """Take `n` complete consecutive frames, yielding each as it arrives.

        Raises
        ------
        FrameTimeoutError, IncompleteFrameError, CameraLostError
            As the camera on the wire.
        """
        n_taken = n_refused = 0
        while n_taken < n:
            try:
                frame = self._frame(timeout_s)
            except IncompleteFrameError as error:
                n_refused += 1
                if on_refused is None or n_refused >= MOST_REFUSED:
                    raise
                on_refused(error)
                continue
            n_taken, n_refused = n_taken + 1, 0
            yield frame

    def _frame(self, timeout_s: float | None) -> Frame:
        """Wait for the next frame; raises IncompleteFrameError if it is incomplete."""
        settings, clock = self.settings, self._clock
        self._await_reconnect()
        wait_s = settings.longest_wait_s(timeout_s)
        until_s = clock.monotonic_s() + wait_s
        clock.sleep(max(settings.exposure_s, 1 / self._frame_rate_hz))
        while "stall" in self._faults and not self._cut:
            if clock.monotonic_s() >= until_s:
                raise FrameTimeoutError(
                    f"no frame came from {self._name} within {wait_s:.1f} s, though it answers",
                    "let the simulated camera recover",
                )
            clock.sleep(STEP_S)
        if self._cut or "freeze" in self._faults:
            return self._frame(timeout_s)
        self._n_taken += 1
        frame_id, stamp_ns = self._n_taken, round(clock.monotonic_s() * 1e9)
        status, problem, n_missing = self._fault_of_frame(settings, frame_id - 1)
        counted = self._statistics
        if problem:
            self._statistics = replace(counted, failed=counted.failed + 1, missing=counted.missing + n_missing)
            cause = f"frame {frame_id} from {self._name} is incomplete, {problem}"
            raise IncompleteFrameError(cause, "it was discarded", status, frame_id, stamp_ns, clock.now())
        # It has no chunk data that say so.
        exposure_s = settings.exposure_s * (2 if "wrong exposure" in self._faults else 1)
        dn = self._source.expose(exposure_s, settings.gain_db, self._source.next_key())
        self._statistics = replace(counted, completed=counted.completed + 1)
        return Frame(
            dn=dn,
            exposure_s=settings.exposure_s,
            gain_db=settings.gain_db,
            bit_depth=12,
            saturation_dn=FULL_SCALE_DN,
            black_level_dn=None,
            pixel_format=settings.pixel_format,
            colour_filter=self._device.colour_filter,
            temperature_c=self.temperature_c,
            timestamp=clock.now(),
            camera_timestamp_ns=stamp_ns,
            frame_id=frame_id,
            camera=self._name,
            readout=settings.readout,
            black_level_register=settings.black_level,
        )

    def _fault_of_frame(self, settings: CameraSettings, index: int) -> tuple[str, str, int]:
        """Return status, problem and missing packets of a frame; empty and 0 for a complete one."""
        n_packets = ceil(2 * settings.width * settings.height / _PACKET_DATA_BYTES)
        n_missing = int(np.random.default_rng(index).binomial(n_packets, self._faults.get("lose", 0.0)))
        if "wrong size" in self._faults:
            return "SIZE_MISMATCH", "its size is not the announced one", n_missing
        if "wrong ids" in self._faults:
            return "", "its frame id has occurred before", n_missing
        return "MISSING_PACKETS", f"{n_missing} packets were lost on the way" if n_missing else "", n_missing

    def _require_open(self) -> None:
        if not self._open:
            raise CameraError("the camera is not open", "use it as a context manager or call open() first")
