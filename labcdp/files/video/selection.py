"""Which frames of a video: from, to and how many, in frames or in seconds."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

from ...core.disk.files import shown
from ...core.errors import InputError

#: Times closer than this are equal: containers count in ticks of 10 us or longer.
TIME_TOLERANCE_S = 5e-6

_UNITS_S = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_POSITION = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(ms|s|min|h)?\s*")
_CLOCK = re.compile(r"\s*(?:(\d+):)?(\d+):(\d+(?:\.\d*)?)\s*")


@dataclass(frozen=True)
class Position:
    """A place in a video, or a distance between two: a number of frames, or a time.

    Parameters
    ----------
    frames : int or None
        Frames, counted from 0.
    seconds : float or None
        Time since the first frame.

    Raises
    ------
    InputError
        If not just one of them is given, or it is below 0.
    """

    frames: int | None = None
    seconds: float | None = None

    def __post_init__(self) -> None:
        if (self.frames is None) == (self.seconds is None):
            raise InputError(f"a position is {self.frames} frames and {self.seconds} s: give one of them")
        if (self.frames or self.seconds or 0) < 0:
            raise InputError(f"a position is {self}: give 0 or more")

    @classmethod
    def parse(cls, text: str, name: str) -> Position:
        """Read ``250`` (frames), ``2.5s``, ``500ms``, ``10min``, ``2h`` or ``1:30``; `name` is for the message.

        Raises
        ------
        InputError
            If it is none of these.
        """
        clock = _CLOCK.fullmatch(text)
        if clock:
            hours, minutes, seconds = clock.groups()
            return cls(seconds=3600 * int(hours or 0) + 60 * int(minutes) + float(seconds))
        number = _POSITION.fullmatch(text)
        if not number or (number[2] is None and "." in number[1]):
            raise InputError(
                f"{name} is {shown(text)}: give a number of frames, for example 250, or a time, for example 10s, "
                "500ms or 1:30"
            )
        if number[2] is None:
            return cls(frames=int(number[1]))
        return cls(seconds=float(number[1]) * _UNITS_S[number[2]])

    def reached(self, number: int, time_s: float) -> bool:
        """Whether a frame is at this place or behind it."""
        if self.frames is not None:
            return number >= self.frames
        assert self.seconds is not None
        return time_s >= self.seconds - TIME_TOLERANCE_S

    def __str__(self) -> str:
        """Return it as `parse` reads it."""
        return f"{self.frames}" if self.frames is not None else f"{self.seconds:g}s"


@dataclass(frozen=True)
class Selection:
    """Frames of a video.

    Parameters
    ----------
    start : Position
        First frame; that of a time is the first one at it or after it.
    stop : Position or None
        First frame that is not taken any more; None for the end of the video.
    every : Position
        Distance from one frame to the next. In seconds, the first frame at or after each multiple of it is taken.

    Raises
    ------
    InputError
        If `every` is 0, or `stop` is not behind `start` and both are in one unit.
    """

    start: Position = field(default_factory=lambda: Position(frames=0))
    stop: Position | None = None
    every: Position = field(default_factory=lambda: Position(frames=1))

    def __post_init__(self) -> None:
        if not (self.every.frames or self.every.seconds):
            raise InputError(f"every is {self.every}: give a distance above 0, for example 10 or 1s")
        stop = self.stop
        if stop is None:
            return
        pairs = ((self.start.frames, stop.frames), (self.start.seconds, stop.seconds))
        if any(a is not None and b is not None and b <= a for a, b in pairs):
            raise InputError(f"stop {stop} is not after start {self.start}: choose a later one")

    def expected(self, frame_count: int | None, frame_rate: float | None) -> int | None:
        """Return how many frames are going to be taken, as far as can be known: for a progress bar."""
        first = _in_frames(self.start, frame_rate)
        step = _in_frames(self.every, frame_rate)
        last = frame_count
        if self.stop is not None:
            stop = _in_frames(self.stop, frame_rate)
            last = stop if last is None or stop is None else min(last, stop)
        if first is None or step is None or last is None:
            return None
        return max(-(-(last - first) // max(step, 1)), 0)

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        return {name: None if at is None else str(at) for name, at in vars(self).items()}


def _in_frames(position: Position, frame_rate: float | None) -> int | None:
    if position.frames is not None:
        return position.frames
    assert position.seconds is not None
    return None if not frame_rate else round(position.seconds * frame_rate)
