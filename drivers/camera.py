"""The camera protocol: interface, settings and errors of all cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from datetime import datetime
from typing import Any, Literal, Protocol, Self

from ..core.errors import DeviceError
from ..core.frame import CameraIdentity, Frame


class CameraError(DeviceError):
    """A camera is absent, busy, lost or silent, or sent an incomplete frame."""


class CameraNotFoundError(CameraError):
    """No camera with that serial number, address or model answers."""


class CameraBusyError(CameraError):
    """Another program controls the camera."""


class CameraLostError(CameraError):
    """The camera stopped answering after it had been opened."""


class FrameTimeoutError(CameraError):
    """No frame arrived within the time-out although the camera answers."""


class IncompleteFrameError(CameraError):
    """A frame arrived with missing or wrong data and was refused.

    Parameters
    ----------
    message : str
        Cause and remedy.
    status : str
        Name of the Aravis buffer status, for example ``MISSING_PACKETS``; empty if unknown.
    frame_id : int or None
        The camera's frame counter, if known.
    camera_timestamp_ns : int or None
        The camera's own clock, if known.
    timestamp : datetime or None
        Host time of arrival, with time zone, if known.
    """

    def __init__(
        self,
        message: str,
        status: str = "",
        frame_id: int | None = None,
        camera_timestamp_ns: int | None = None,
        timestamp: datetime | None = None,
    ) -> None:
        super().__init__(message)
        self.status = status
        self.frame_id = frame_id
        self.camera_timestamp_ns = camera_timestamp_ns
        self.timestamp = timestamp


class CameraSettingError(CameraError):
    """The camera lacks a setting or rejects its value: pixel format, exposure, or gain."""


#: Value of a GenICam feature.
FeatureValue = bool | int | float | str


@dataclass(frozen=True)
class FeatureDescription:
    """A GenICam feature as it is now.

    Parameters
    ----------
    name : str
        GenICam name.
    value : bool, int, float or str
        Its value.
    writable : bool
        Whether it can be changed now.
    unit : str
        Unit as the camera states it; empty if it states none.
    limits : (float, float) or None
        Lowest and highest value of a number; None if they are not known.
    choices : tuple of str
        Values of an enumeration.
    """

    name: str
    value: FeatureValue
    writable: bool = False
    unit: str = ""
    limits: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Trigger:
    """Trigger of an exposure.

    Parameters
    ----------
    source : str or None
        None for free-running; ``Software`` for a command from this computer; else the camera's name of a line,
        for example ``Line1`` (SFNC TriggerSource).
    activation : {'RisingEdge', 'FallingEdge', 'AnyEdge', 'LevelHigh', 'LevelLow'}
        Active edge or level of the line (SFNC TriggerActivation); ignored for other sources.
    """

    source: str | None = None
    activation: Literal["RisingEdge", "FallingEdge", "AnyEdge", "LevelHigh", "LevelLow"] = "RisingEdge"


FREE_RUN = Trigger()
SOFTWARE_TRIGGER = Trigger("Software")


@dataclass(frozen=True)
class Region:
    """Part of the sensor that is read out, in pixels after binning (SFNC OffsetX, OffsetY, Width, Height).

    Parameters
    ----------
    x, y : int
        First column and row.
    width, height : int
        Size.
    """

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True)
class CameraSetup:
    """Settings of a measurement besides exposure, gain and pixel format; None leaves those after opening.

    Parameters
    ----------
    binning : (int, int) or None
        Columns and rows to bin.
    region : Region or None
        Part of the sensor to read out.
    frame_rate_hz : float or None
        Frame rate of a free-running camera.
    black_level : float or None
        Register of the black level.
    trigger : Trigger or None
        Trigger of an exposure.
    features : mapping of str to bool, int, float or str
        GenICam features by name, set last.
    """

    binning: tuple[int, int] | None = None
    region: Region | None = None
    frame_rate_hz: float | None = None
    black_level: float | None = None
    trigger: Trigger | None = None
    features: Mapping[str, FeatureValue] = field(default_factory=dict)

    @property
    def settings(self) -> dict[str, Any]:
        """The settings that are given, by name."""
        return {f.name: v for f in fields(self) if f.name != "features" and (v := getattr(self, f.name)) is not None}


#: Tolerated delay of a frame beyond its exposure and period, for a busy computer. A camera that stops answering is
#: noticed earlier.
FRAME_ALLOWANCE_S = 10.0


@dataclass(frozen=True)
class CameraSettings:
    """Settings in effect.

    Parameters
    ----------
    exposure_s, gain_db : float
        Exposure time in seconds and analogue gain in decibels.
    pixel_format : str
        GenICam PFNC name.
    width, height : int
        Size of a frame in pixels.
    offset_x, offset_y : int
        First column and row of the sensor that is read out, in pixels after binning.
    binning : (int, int)
        Columns and rows binned into one pixel.
    black_level : float
        Value of the camera's register, in its own unit, which need not be DN of the pixel format; 0 without one.
    frame_rate_hz : float or None
        Frame rate of a free-running camera; None if unknown.
    trigger : Trigger
        Trigger of an exposure.
    """

    exposure_s: float
    gain_db: float
    pixel_format: str
    width: int
    height: int
    offset_x: int = 0
    offset_y: int = 0
    binning: tuple[int, int] = (1, 1)
    black_level: float = 0.0
    frame_rate_hz: float | None = None
    trigger: Trigger = FREE_RUN

    def longest_wait_s(self, timeout_s: float | None = None, overload: float = 1.0) -> float:
        """Return how long to wait for a frame: the exposure time and `timeout_s`, None for a default.

        The default leaves the frame period and `FRAME_ALLOWANCE_S`, longer by the factor of the computer's `overload`.
        """
        if timeout_s is not None:
            return self.exposure_s + timeout_s
        period_s = 1 / self.frame_rate_hz if self.frame_rate_hz and self.trigger == FREE_RUN else 0.0
        return self.exposure_s + period_s + FRAME_ALLOWANCE_S * overload


@dataclass(frozen=True)
class StreamStatistics:
    """Counters of the received data since the camera was opened.

    Parameters
    ----------
    completed, failed : int
        Complete and incomplete frames.
    underruns : int
        Packets of frames without a free buffer: the program was too slow.
    resent, missing : int
        Packets resent on request, and packets that Aravis counts as missing: for an abandoned frame, all after its
        first gap.
    """

    completed: int = 0
    failed: int = 0
    underruns: int = 0
    resent: int = 0
    missing: int = 0


@dataclass(frozen=True)
class Gap:
    """An interruption during which the camera was lost.

    Parameters
    ----------
    lost_at, back_at : datetime
        Host time, with time zone: when the loss was noticed, and when the camera was ready again.
    duration_s : float
        Duration by a monotonic clock.
    reason : str
        Symptom of the loss.
    """

    lost_at: datetime
    back_at: datetime
    duration_s: float
    reason: str


Refused = Callable[[IncompleteFrameError], None]

#: Number of consecutive incomplete frames after which a grab fails.
MOST_REFUSED = 20


class Camera(Protocol):
    """Interface of all cameras: real, simulated in this process, or replayed.

    A camera is a context manager; its constructor does no I/O, `open` does.
    """

    #: False for a recording, which has no frames but those that were kept.
    live: bool

    def open(self) -> Self:
        """Connect; raises CameraNotFoundError or CameraBusyError."""

    def close(self) -> None:
        """Stop and disconnect; may be called twice."""

    def __enter__(self) -> Self:
        """Open."""

    def __exit__(self, *exc: object) -> None:
        """Close."""

    @property
    def identity(self) -> CameraIdentity:
        """Vendor, model and serial number; raises CameraError if not open."""

    @property
    def settings(self) -> CameraSettings:
        """Settings in force."""

    @property
    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure of the camera, in seconds."""

    @property
    def temperature_c(self) -> float | None:
        """Current temperature of the device in degrees Celsius; None if not available."""

    @property
    def statistics(self) -> StreamStatistics:
        """Counters since the camera was opened."""

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Interruptions since the camera was opened, after which it was reconnected."""

    @property
    def not_understood(self) -> tuple[str, ...]:
        """Names of writable features of which labcdp does not know what they do to a picture."""

    def features(self) -> dict[str, FeatureValue]:
        """Read all readable GenICam features by name, as a snapshot for a recording."""

    def describe_features(self) -> tuple[FeatureDescription, ...]:
        """Read all readable GenICam features with range and unit, in the camera's order."""

    def configure(
        self,
        *,
        exposure_s: float | None = None,
        gain_db: float | None = None,
        pixel_format: str | None = None,
    ) -> CameraSettings:
        """Change the given settings and return those in effect.

        All frames returned afterwards are taken with these settings.

        Raises
        ------
        CameraSettingError
            If the camera rejects a value; the message states its range.
        """

    def prepare(self, wanted: CameraSetup) -> None:
        """Apply the settings of a measurement, and verify all of them by reading back.

        Raises
        ------
        CameraSettingError
            If the camera has no such setting, rejects a value, or keeps another one.
        """

    def snap(self, timeout_s: float | None = None) -> Frame:
        """Take one frame; `timeout_s` beyond the exposure time, None for the driver's own."""

    def grab(self, n: int, timeout_s: float | None = None, on_refused: Refused | None = None) -> Iterator[Frame]:
        """Take `n` complete consecutive frames, yielding each as it arrives.

        Parameters
        ----------
        n : int
            Number of frames.
        timeout_s : float or None
            Longest wait for a frame beyond the exposure time; None for the driver's own.
        on_refused : callable or None
            Called for each incomplete frame, which is then repeated; None raises the error instead.
        """
