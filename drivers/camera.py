"""The camera protocol: interface, settings and errors of all cameras."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol

from ..core.errors import DeviceError
from ..core.frame import CameraIdentity, Frame
from .camera_settings import CameraSettings, CameraSetup, FeatureDescription, FeatureValue
from .camera_settings import Region as Region
from .camera_settings import Trigger as Trigger
from .device import Device

_log = logging.getLogger(__name__)


class CameraError(DeviceError):
    """A camera is absent, busy, lost or silent, or sent an incomplete frame.

    Examples
    --------
    >>> from labcdp.drivers import CameraError
    >>> print(CameraError("no camera answers", "check its cable"))
    no camera answers: check its cable
    """


class CameraNotFoundError(CameraError):
    """No camera with that serial number, address or model answers.

    Examples
    --------
    >>> from labcdp.drivers import CameraError
    >>> from labcdp.drivers.camera import CameraNotFoundError
    >>> issubclass(CameraNotFoundError, CameraError)
    True
    """


class CameraBusyError(CameraError):
    """Another program controls the camera.

    Examples
    --------
    >>> from labcdp.drivers.camera import CameraBusyError
    >>> print(CameraBusyError("another program controls the camera", "close it"))
    another program controls the camera: close it
    """


class CameraLostError(CameraError):
    """The camera stopped answering after it had been opened.

    Examples
    --------
    >>> from labcdp.drivers.camera import CameraLostError
    >>> CameraLostError("the camera is lost", "check its cable").remedy
    'check its cable'
    """


class FrameTimeoutError(CameraError):
    """No frame arrived within the time-out although the camera answers.

    Examples
    --------
    >>> from labcdp.drivers.camera import FrameTimeoutError
    >>> FrameTimeoutError("no frame within 2 s", "check the trigger").cause
    'no frame within 2 s'
    """


class IncompleteFrameError(CameraError):
    """A frame arrived with missing or wrong data and was refused.

    Parameters
    ----------
    cause : str
        Observed problem.
    remedy : str or None
        Remedy.
    status : str
        Name of the Aravis buffer status, for example ``MISSING_PACKETS``; empty if unknown.
    frame_id : int or None
        The camera's frame counter, if known.
    camera_timestamp_ns : int or None
        The camera's own clock, if known.
    timestamp : datetime or None
        Host time of arrival, with time zone, if known.

    Examples
    --------
    >>> from labcdp.drivers.camera import IncompleteFrameError
    >>> error = IncompleteFrameError("packets are missing", "check the cable", status="MISSING_PACKETS", frame_id=7)
    >>> error.status, error.frame_id
    ('MISSING_PACKETS', 7)
    """

    def __init__(
        self,
        cause: str,
        remedy: str | None = None,
        status: str = "",
        frame_id: int | None = None,
        camera_timestamp_ns: int | None = None,
        timestamp: datetime | None = None,
    ) -> None:
        super().__init__(cause, remedy)
        self.status = status
        self.frame_id = frame_id
        self.camera_timestamp_ns = camera_timestamp_ns
        self.timestamp = timestamp


class CameraSettingError(CameraError):
    """The camera lacks a setting or rejects its value: pixel format, exposure, or gain.

    Examples
    --------
    >>> from labcdp.drivers.camera import CameraSettingError
    >>> print(CameraSettingError("the gain is 50 dB", "give 0 to 33 dB"))
    the gain is 50 dB: give 0 to 33 dB
    """


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
    requested, duplicated, ignored : int
        Packets that were asked for again, packets that came twice, and packets of no frame that is received: too late
        or with a wrong number.

    Examples
    --------
    >>> from labcdp.drivers.camera import StreamStatistics
    >>> StreamStatistics(completed=99, failed=1).failed
    1
    """

    completed: int = 0
    failed: int = 0
    underruns: int = 0
    resent: int = 0
    missing: int = 0
    requested: int = 0
    duplicated: int = 0
    ignored: int = 0


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

    Examples
    --------
    >>> from datetime import UTC, datetime, timedelta
    >>> from labcdp.drivers.camera import Gap
    >>> lost_at = datetime(2026, 3, 1, 12, tzinfo=UTC)
    >>> Gap(lost_at, lost_at + timedelta(seconds=3), duration_s=3.0, reason="no answer").duration_s
    3.0
    """

    lost_at: datetime
    back_at: datetime
    duration_s: float
    reason: str


Refused = Callable[[IncompleteFrameError], None]


def take_again(error: IncompleteFrameError) -> None:
    """Log an incomplete frame, which is repeated: a `Refused`.

    Examples
    --------
    >>> from labcdp.drivers.camera import IncompleteFrameError, take_again
    >>> take_again(IncompleteFrameError("12 packets are missing", frame_id=7))
    """
    _log.warning("%s; taking it again", error)


#: Number of consecutive incomplete frames after which a grab fails.
MOST_REFUSED = 20


class Camera(Device, Protocol):
    """Interface of all cameras: real, simulated in this process, or replayed.

    A camera is a context manager; its constructor does no I/O; `open` raises CameraNotFoundError or CameraBusyError.

    Examples
    --------
    >>> from labcdp.drivers import Camera, ReplayCamera
    >>> from labcdp.session import Session, example_session
    >>> def shortest_s(camera: Camera) -> float:
    ...     with camera:
    ...         return camera.exposure_range_s[0]
    >>> shortest_s(ReplayCamera(Session.open(example_session())))
    0.002
    """

    #: False for a recording, which has no frames but those that were kept.
    live: bool

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
        return ()

    @property
    def driver(self) -> str:
        """Software that brings its frames here, with its version; empty for none but labcdp."""
        return ""

    @property
    def not_understood(self) -> tuple[str, ...]:
        """Names of writable features of which labcdp does not know what they do to a picture."""
        return ()

    def features(self) -> dict[str, FeatureValue]:
        """Read all readable GenICam features by name, as a snapshot for a recording."""

    def describe_features(self) -> tuple[FeatureDescription, ...]:
        """Read all readable GenICam features with range and unit, in the camera's order.

        Without an implementation of their own their values alone, as of features that cannot be changed.
        """
        return tuple(FeatureDescription(name, value) for name, value in self.features().items())

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

    def snap(self, timeout_s: float | None = None, on_refused: Refused | None = None) -> Frame:
        """Take one frame; see `grab`."""
        (frame,) = self.grab(1, timeout_s, on_refused)
        return frame

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
