"""A camera whose frames are also shown while an acquisition has it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from ...core.frame import Frame
from ...drivers.camera import Camera


class WatchedCamera:
    """An open camera, and who receives what it delivers."""

    def __init__(self, camera: Camera, show: Callable[[Frame], None]) -> None:
        self._camera, self._show = camera, show

    def __getattr__(self, name: str) -> Any:
        return getattr(self._camera, name)

    def snap(self, timeout_s: float | None = None) -> Frame:
        """Take one frame."""
        frame = self._camera.snap(timeout_s)
        self._show(frame)
        return frame

    def grab(self, *arguments: Any, **options: Any) -> Iterator[Frame]:
        """Take frames."""
        for frame in self._camera.grab(*arguments, **options):
            self._show(frame)
            yield frame
