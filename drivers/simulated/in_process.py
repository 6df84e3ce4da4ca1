"""A camera in this process, without Aravis or a network, timed by any clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import ceil
from typing import Final, Protocol, Self

import numpy as np

from ...core.clock import Clock, SystemClock
from ...core.errors import InputError
from ...core.frame import CameraIdentity, Frame, Readout
from ..camera import (
    MOST_REFUSED,
    Camera,
    CameraBusyError,
    CameraError,
    CameraLostError,
    CameraNotFoundError,
    CameraSettingError,
    FrameTimeoutError,
    Gap,
    IncompleteFrameError,
    Refused,
    StreamStatistics,
)
from ..camera_settings import CameraSettings, CameraSetup, FeatureValue
from .device import FULL_SCALE_DN, FrameSource, SimulatedDevice
from .genicam import feature


@dataclass(frozen=True)
class CameraTrouble:
    """Faults of a camera; none without arguments.

    Parameters
    ----------
    loss : float
        Share of the stream's packets that are lost, 0 to 1.
    frozen : bool
        It neither answers nor sends, and continues normally afterwards.
    stalled : bool
        It answers, but sends no frame.
    gone : bool
        It has no power; afterwards all settings are those after power-on.
    wrong_ids : bool
        It repeats frame ids, or sends older ones.
    wrong_size : bool
        Its frames have half the height.
    taken : bool
        Another program controls it, after a power cycle.

    Raises
    ------
    InputError
        If `loss` is not between 0 and 1.
    """

    loss: float = 0.0
    frozen: bool = False
    stalled: bool = False
    gone: bool = False
    wrong_ids: bool = False
    wrong_size: bool = False
    taken: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.loss <= 1:
            raise InputError(f"loss is {self.loss}: give a share from 0 to 1")

    @property
    def out_of_reach(self) -> bool:
        """Whether the connection to the camera is lost."""
        return self.frozen or self.gone or self.taken


#: No fault.
NO_TROUBLE = CameraTrouble()


class TroubledCamera(Protocol):
    """A simulated camera that supports faults."""

    def set_faults(self, trouble: CameraTrouble) -> None:
        """Replace the current trouble."""

    def follow_temperature(self) -> None:
        """Update the temperature registers."""


#: Silence after which a camera is lost.
_NOTICED_AFTER_S: Final = 1.0

#: Heartbeat time-out after which a camera drops the connection, as on the wire.
_HEARTBEAT_S: Final = 3.0

#: Polling interval of the trouble's end.
STEP_S: Final = 0.1


class Link:
    """Connection to a simulated camera.

    Parameters
    ----------
    clock : Clock
        Clock to wait with.
    patience_s : float
        How long to wait for a lost camera to come back; 0 for not at all.
    name : str
        Name of the camera in messages.

    Attributes
    ----------
    trouble : CameraTrouble
        Current trouble.
    cut : str or None
        Why the connection is lost, or None.
    gaps : tuple of Gap
        Interruptions since `connect`.

    Raises
    ------
    InputError
        If `patience_s` is negative.
    """

    def __init__(self, clock: Clock, patience_s: float, name: str) -> None:
        if not patience_s >= 0:
            raise InputError(f"patience_s is {patience_s}: give a number of seconds of at least 0")
        self._clock = clock
        self._patience_s = patience_s
        self._name = name
        self._frozen_at_s = 0.0
        self.trouble = NO_TROUBLE
        self.cut: str | None = None
        self.gaps: tuple[Gap, ...] = ()

    def connect(self) -> None:
        """Connect anew; raises CameraNotFoundError or CameraBusyError as the trouble implies."""
        if self.trouble.gone or self.trouble.frozen:
            raise CameraNotFoundError(f"{self._name} does not answer: let the simulated camera recover")
        if self.trouble.taken:
            raise CameraBusyError(f"another program controls {self._name}: let the simulated camera recover")
        self.cut, self.gaps = None, ()

    def set_faults(self, trouble: CameraTrouble) -> None:
        """Replace the current trouble."""
        if trouble.frozen != self.trouble.frozen:
            now_s = self._clock.monotonic_s()
            if not trouble.frozen and now_s - self._frozen_at_s >= _HEARTBEAT_S:
                self.cut = "it did not answer"
            self._frozen_at_s = now_s
        self.trouble = trouble
        # Loss of power or control ends the connection, however short.
        if trouble.gone:
            self.cut = "it does not answer"
        elif trouble.taken:
            self.cut = "another program took control"

    def await_reconnect(self) -> None:
        """Wait until a lost camera is back; raises CameraLostError after `patience_s`."""
        began_s, lost_at = self._clock.monotonic_s(), self._clock.now()
        self._wait_while(lambda: self.trouble.frozen, _NOTICED_AFTER_S)
        reason = self.cut or ("it does not answer" if self.trouble.frozen else None)
        if reason is None:
            return
        self.cut = reason
        if self._patience_s > 0:
            self._wait_while(lambda: self.trouble.out_of_reach, self._patience_s)
        if self._patience_s == 0 or self.trouble.out_of_reach:
            raise CameraLostError(
                f"{self._name} is lost, {reason}: let the simulated camera recover, then open it again"
            )
        self.cut = None
        duration_s = self._clock.monotonic_s() - began_s
        self.gaps = (*self.gaps, Gap(lost_at, self._clock.now(), duration_s, reason))

    def _wait_while(self, bad: Callable[[], bool], longest_s: float) -> None:
        until_s = self._clock.monotonic_s() + longest_s
        # In whole steps: a rest of rounding would not advance a virtual clock.
        while bad() and self._clock.monotonic_s() < until_s:
            self._clock.sleep(STEP_S)


_EXPOSURE_RANGE_US: Final = feature("ExposureTimeAbs")["range"]
_GAIN_RANGE_DB: Final = feature("Gain")["range"]

#: Pixel data of a stream packet: 9000 bytes less headers.
_PACKET_DATA_BYTES: Final = 8964


class InProcessCamera(Camera):
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
        self._clock = SystemClock() if clock is None else clock
        self._temperature = temperature
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
        self._link = Link(self._clock, patience_s, f"{device.vendor} {device.model} ({device.serial}, simulated)")
        self._statistics = StreamStatistics()

    def open(self) -> Self:
        """Switch on.

        Raises
        ------
        CameraNotFoundError, CameraBusyError
            If its trouble implies so.
        """
        if not self._open:
            self._link.connect()
            self._open = True
            self._statistics = StreamStatistics()
        return self

    def close(self) -> None:
        """Switch off; may be called twice."""
        self._open = False

    def set_faults(self, trouble: CameraTrouble) -> None:
        """Replace the current trouble."""
        self._link.set_faults(trouble)

    def follow_temperature(self) -> None:
        """Do nothing: the temperature is read on demand."""

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

    @property
    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure."""
        return _EXPOSURE_RANGE_US[0] * 1e-6, _EXPOSURE_RANGE_US[1] * 1e-6

    @property
    def temperature_c(self) -> float:
        """Temperature of the device now."""
        return self._device.temperature_c if self._temperature is None else self._temperature()

    @property
    def statistics(self) -> StreamStatistics:
        """Counters since the camera was opened."""
        return self._statistics

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Interruptions since the camera was opened, after which it was reconnected."""
        return self._link.gaps

    def features(self) -> dict[str, FeatureValue]:
        """Return the register values of the camera on the wire, by name."""
        device, settings = self._device, self.settings
        return {
            "DeviceVendorName": device.vendor,
            "DeviceModelName": device.model,
            "DeviceID": device.serial,
            "DeviceTemperature": self.temperature_c,
            "SensorWidth": device.width,
            "SensorHeight": device.height,
            "PixelFormat": settings.pixel_format,
            "ExposureTimeAbs": settings.exposure_s * 1e6,
            "AcquisitionFrameRateAbs": device.frame_rate_hz,
            "Gain": settings.gain_db,
            "BlackLevel": settings.black_level,
        }

    def configure(
        self,
        *,
        exposure_s: float | None = None,
        gain_db: float | None = None,
        pixel_format: str | None = None,
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
        self._link.await_reconnect()
        exposure_us = round((old.exposure_s if exposure_s is None else exposure_s) * 1e6)
        gain = old.gain_db if gain_db is None else gain_db
        if not _EXPOSURE_RANGE_US[0] <= exposure_us <= _EXPOSURE_RANGE_US[1]:
            low, high = self.exposure_range_s
            raise CameraSettingError(f"exposure_s is {exposure_us * 1e-6:g} s: the camera takes {low:g} to {high:g} s")
        if not _GAIN_RANGE_DB[0] <= gain <= _GAIN_RANGE_DB[1]:
            raise CameraSettingError(
                f"gain_db is {gain:g} dB: the camera takes {_GAIN_RANGE_DB[0]} to {_GAIN_RANGE_DB[1]} dB"
            )
        if pixel_format not in (None, old.pixel_format):
            raise CameraSettingError(
                f"the camera in this process has no pixel format {pixel_format!r}: choose {old.pixel_format}"
            )
        self._settings = replace(old, exposure_s=exposure_us * 1e-6, gain_db=gain)
        return self._settings

    def prepare(self, wanted: CameraSetup) -> None:
        """Accept no settings; raises CameraSettingError for any."""
        given = [*wanted.settings, *wanted.features]
        if given:
            raise CameraSettingError(f"the camera in this process cannot set {given[0]}: use the one on loopback")

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
        settings = self.settings
        self._link.await_reconnect()
        wait_s = settings.longest_wait_s(timeout_s)
        until_s = self._clock.monotonic_s() + wait_s
        self._clock.sleep(max(settings.exposure_s, 1 / self._device.frame_rate_hz))
        while self._link.trouble.stalled and not self._link.cut:
            if self._clock.monotonic_s() >= until_s:
                raise FrameTimeoutError(
                    f"no frame came from {self.identity} within {wait_s:.1f} s, though it "
                    "answers: let the simulated camera recover"
                )
            self._clock.sleep(STEP_S)
        if self._link.cut or self._link.trouble.frozen:
            return self._frame(timeout_s)
        index = self._n_taken
        self._n_taken += 1
        self._refuse_incomplete(settings, index)
        dn = self._source.expose(settings.exposure_s, settings.gain_db, index)
        self._statistics = replace(self._statistics, completed=self._statistics.completed + 1)
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
            timestamp=self._clock.now(),
            camera_timestamp_ns=round(self._clock.monotonic_s() * 1e9),
            frame_id=self._n_taken,
            camera=self.identity,
            readout=settings.readout,
            black_level_register=settings.black_level,
        )

    def _refuse_incomplete(self, settings: CameraSettings, index: int) -> None:
        n_packets = ceil(2 * settings.width * settings.height / _PACKET_DATA_BYTES)
        missing = int(np.random.default_rng(index).binomial(n_packets, self._link.trouble.loss))
        if self._link.trouble.wrong_size:
            status, problem = "SIZE_MISMATCH", "its size is not the one announced"
        elif self._link.trouble.wrong_ids:
            status, problem = "", "its frame id was there before"
        elif missing:
            status, problem = "MISSING_PACKETS", f"{missing} packets were lost on the way"
        else:
            return
        counted = self._statistics
        self._statistics = replace(counted, failed=counted.failed + 1, missing=counted.missing + missing)
        raise IncompleteFrameError(
            f"frame {index + 1} from {self.identity} is incomplete, {problem}: it is refused",
            status,
            index + 1,
            round(self._clock.monotonic_s() * 1e9),
            self._clock.now(),
        )

    def _require_open(self) -> None:
        if not self._open:
            raise CameraError("the camera is not open: use it as a context manager or call open() first")
