"""The camera protocol: what every camera offers, its settings, and its errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, Self

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
    """A frame arrived with missing or wrong data and was refused."""


class CameraSettingError(CameraError):
    """The camera does not have or take a setting: pixel format, exposure, or gain."""


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
    """

    exposure_s: float
    gain_db: float
    pixel_format: str
    width: int
    height: int


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

    def grab(self, n: int, timeout_s: float | None = None) -> Iterator[Frame]:
        """Take `n` frames in a row, yielding each as it arrives."""
