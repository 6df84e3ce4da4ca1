"""The camera protocol: what every camera offers, its settings, and its errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Literal, Protocol, Self

from ..errors import DeviceError
from ..frame import CameraIdentity, Frame


class CameraError(DeviceError):
    """A camera is absent, busy, lost, silent, or sent something that is not a whole frame."""


class CameraNotFoundError(CameraError):
    """No camera answers to that serial number, address or model."""


class CameraBusyError(CameraError):
    """Another program controls the camera."""


class CameraLostError(CameraError):
    """The camera stopped answering after it had been opened."""


class FrameTimeoutError(CameraError):
    """No frame came within the time-out, though the camera still answers."""


class IncompleteFrameError(CameraError):
    """A frame arrived with missing or wrong data and was refused.

    Parameters
    ----------
    message : str
        What is wrong with it, and what to do.
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
    """The camera does not have or take a setting: pixel format, exposure, or gain."""


#: Value of a GenICam feature.
FeatureValue = bool | int | float | str


@dataclass(frozen=True)
class Trigger:
    """What starts an exposure.

    Parameters
    ----------
    source : str or None
        None for free-running; ``Software`` for a command from this computer; else the camera's name of a line,
        for example ``Line1`` (SFNC TriggerSource).
    activation : {'RisingEdge', 'FallingEdge', 'AnyEdge', 'LevelHigh', 'LevelLow'}
        Which change of the line counts (SFNC TriggerActivation); of no meaning for the other sources.
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
class CameraSettings:
    """Settings as the camera applied them.

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
        Columns and rows joined into one pixel.
    black_level_dn : float
        DN added to each pixel, as set in the camera; 0 where it has no such setting.
    frame_rate_hz : float or None
        Frame rate of a free-running camera; None if it does not tell.
    trigger : Trigger
        What starts an exposure.
    """

    exposure_s: float
    gain_db: float
    pixel_format: str
    width: int
    height: int
    offset_x: int = 0
    offset_y: int = 0
    binning: tuple[int, int] = (1, 1)
    black_level_dn: float = 0.0
    frame_rate_hz: float | None = None
    trigger: Trigger = FREE_RUN


@dataclass(frozen=True)
class StreamStatistics:
    """Counters of all that was received since the camera was opened.

    Parameters
    ----------
    completed, failed : int
        Frames that came whole, and that did not.
    underruns : int
        Packets of frames that found no free buffer: the program did not keep up.
    resent, missing : int
        Packets the camera sent again on request, and that Aravis counts as missing: of a frame given up, all after
        its first gap.
    """

    completed: int = 0
    failed: int = 0
    underruns: int = 0
    resent: int = 0
    missing: int = 0


@dataclass(frozen=True)
class Gap:
    """A time in which the camera was lost, and after which it came back.

    Parameters
    ----------
    lost_at, back_at : datetime
        Host time, with time zone: when the loss was noticed, and when the camera was ready again.
    duration_s : float
        From one to the other on a clock that nobody sets.
    reason : str
        How the loss showed.
    """

    lost_at: datetime
    back_at: datetime
    duration_s: float
    reason: str


Refused = Callable[[IncompleteFrameError], None]


class Camera(Protocol):
    """What every camera offers: real, simulated in this process, or replayed.

    A camera is a context manager; its constructor does no I/O, `open` does.
    """

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
        """Shortest and longest exposure the camera takes, in seconds."""

    @property
    def temperature_c(self) -> float | None:
        """Temperature of the device now, in degrees Celsius; None if it does not tell."""

    @property
    def statistics(self) -> StreamStatistics:
        """Counters since the camera was opened."""

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Times in which the camera was lost since it was opened, and survived."""

    def features(self) -> dict[str, FeatureValue]:
        """Read all GenICam features that can be read, by name: a snapshot to keep with what is recorded."""

    def configure(
        self,
        *,
        exposure_s: float | None = None,
        gain_db: float | None = None,
        pixel_format: str | None = None,
    ) -> CameraSettings:
        """Change what is given, keep the rest, and return what the camera applied.

        Frames returned afterwards are surely taken with these settings.

        Raises
        ------
        CameraSettingError
            If the camera cannot take a value; the message gives the range it takes.
        """

    def snap(self, timeout_s: float | None = None) -> Frame:
        """Take one frame; `timeout_s` beyond the exposure time, None for the driver's own."""

    def grab(self, n: int, timeout_s: float | None = None, on_refused: Refused | None = None) -> Iterator[Frame]:
        """Take `n` whole frames in a row, yielding each as it arrives.

        Parameters
        ----------
        n : int
            How many.
        timeout_s : float or None
            Longest wait for a frame beyond the exposure time; None for the driver's own.
        on_refused : callable or None
            Told of each frame that came incomplete, which is then taken again; None raises the error instead.
        """
