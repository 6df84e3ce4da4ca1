"""Options for frames of videos: which are evaluated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ...files.video.selection import Position, Selection
from ..commands import As
from ..values import parse_hertz

#: A frame of a video, by number or time.
FramePosition = Annotated[Position, As(parse=Position.parse, show=lambda position: f"{position.frames}")]


@dataclass(frozen=True)
class FrameOptions:
    """Options for which frames are evaluated.

    Parameters
    ----------
    damaged
        Also evaluate frames that are damaged or depend on damaged ones, with a note.
    start
        First frame, for example 250, 10s or 1:30; the regions refer to it.
    stop
        Frame to stop before; default: the end.
    frame_rate
        Frames a second of images, which state no times, for example 30Hz; default: 1Hz.
    every
        Interval between evaluated frames, for example 25 or 1s; tracking uses all frames.
    """

    damaged: bool = False
    start: FramePosition = Position(0)
    stop: FramePosition | None = None
    every: FramePosition = Position(1)
    frame_rate: Annotated[float | None, As(parse=parse_hertz)] = None

    def selection(self) -> Selection:
        """Return which frames are meant; raises InputError."""
        return Selection(self.start, self.stop, self.every)
