"""State of a live camera, and a camera whose frames are also shown while an acquisition has it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import monotonic
from typing import Any

from ...core.frame import Frame
from ...drivers.camera import Camera
from ...drivers.camera_settings import CameraSettings, FeatureDescription


@dataclass(frozen=True)
class LiveState:
    """State of a live camera.

    Parameters
    ----------
    frame : Frame or None
        Newest frame.
    settings : CameraSettings or None
        Settings in effect, read back.
    exposure_range_s : (float, float)
        Shortest and longest exposure.
    features : tuple of FeatureDescription
        All features as last read; empty until they are asked for.
    changed : tuple of (str, object, object)
        Settings that the camera or another program changed: name, value before and now.
    n_frames, n_incomplete : int
        Frames received, and frames that were refused as incomplete.
    rate_hz : float
        Frames received per second.
    received_s : float
        When the newest frame arrived, by the monotonic clock.
    streaming : bool
        Whether the camera is open.
    lent : bool
        Whether an acquisition has the camera.
    asked_s : float or None
        When that acquisition began to wait for a frame; None while it does not.
    error : str
        Why there are no frames, or why a setting was rejected.
    """

    frame: Frame | None = None
    settings: CameraSettings | None = None
    exposure_range_s: tuple[float, float] = (0.0, 0.0)
    features: tuple[FeatureDescription, ...] = ()
    changed: tuple[tuple[str, object, object], ...] = ()
    n_frames: int = 0
    n_incomplete: int = 0
    rate_hz: float = 0.0
    received_s: float = 0.0
    streaming: bool = False
    lent: bool = False
    asked_s: float | None = None
    error: str = ""

    @property
    def stale(self) -> bool:
        """Whether the next frame should have arrived more than a second ago."""
        return self._late(self.received_s)

    @property
    def overdue(self) -> bool:
        """Whether the camera is late with a frame that the page, or an acquisition, waits for."""
        since_s = self.asked_s if self.lent else self.received_s
        return self.streaming and since_s is not None and self._late(since_s)

    def _late(self, since_s: float) -> bool:
        if self.settings is None:
            return False
        period_s = 1 / self.settings.frame_rate_hz if self.settings.frame_rate_hz else 0.0
        return monotonic() - since_s > 1 + max(self.settings.exposure_s, period_s)


class WatchedCamera:
    """An open camera that reports its settings, and when a frame is awaited, and shows each frame it delivers."""

    def __init__(self, camera: Camera, tell: Callable[..., None], show: Callable[[Frame], None]) -> None:
        self._camera, self._tell, self._show = camera, tell, show

    def __getattr__(self, name: str) -> Any:
        return getattr(self._camera, name)

    def configure(self, **wanted: Any) -> CameraSettings:
        """Change settings."""
        settings = self._camera.configure(**wanted)
        self._tell(settings=settings)
        return settings

    def grab(self, *arguments: Any, **options: Any) -> Iterator[Frame]:
        """Take frames."""
        try:
            self._tell(asked_s=monotonic())
            for frame in self._camera.grab(*arguments, **options):
                self._tell(asked_s=None)
                self._show(frame)
                yield frame
                self._tell(asked_s=monotonic())
        finally:
            self._tell(asked_s=None)
