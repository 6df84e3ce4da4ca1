"""Devices whose frames and readings are also shown while an acquisition has them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from ...core.frame import Frame
from ...core.reading import Reading


class _Watched:
    """An open device, and who receives what it delivers."""

    def __init__(self, device: Any, show: Callable[[Any], None]) -> None:
        self._device, self._show = device, show

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)


class WatchedCamera(_Watched):
    """A camera whose frames are also shown."""

    def snap(self, timeout_s: float | None = None) -> Frame:
        """Take one frame."""
        frame: Frame = self._device.snap(timeout_s)
        self._show(frame)
        return frame

    def grab(self, *arguments: Any, **options: Any) -> Iterator[Frame]:
        """Take frames."""
        for frame in self._device.grab(*arguments, **options):
            self._show(frame)
            yield frame


class WatchedMeter(_Watched):
    """A meter whose readings are also shown."""

    def measure(self) -> Reading:
        """Take one reading."""
        reading: Reading = self._device.measure()
        self._show(reading)
        return reading
