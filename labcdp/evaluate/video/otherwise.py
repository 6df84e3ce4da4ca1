"""What the contrast of two regions would be in all frames, if the values were read otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

from ...core.result import Finding
from ...files.doubts import Doubts
from ..picture.conversion import MOSAIC, OtherReading, PictureConversion


@dataclass
class _Seen:
    """Frames in which it matters, and that in which it matters most, with the contrasts there."""

    count: int = 0
    frame: int = 0
    pair: str = ""
    taken: float = 0.0
    otherwise: float = 0.0


class ReadOtherwise:
    """Contrasts of two regions as they would be by another encoding or black level, gathered row by row.

    They follow from the means of the regions, as if each were of one value.

    Parameters
    ----------
    conversion : PictureConversion
        To relative values.
    doubts : Doubts
        What is doubtful about them.
    """

    def __init__(self, conversion: PictureConversion, doubts: Doubts) -> None:
        self._doubts, self._n = doubts, 0
        self._seen: list[tuple[OtherReading, _Seen]] = [
            (one, _Seen()) for one in conversion.other_readings(doubts) if one.code != MOSAIC
        ]

    def add(self, row: Mapping[str, Any], names: tuple[str, str]) -> None:
        """Take note of a row, and of the names of its regions."""
        self._n += 1
        dark, bright = sorted(zip(row["mean"], names, strict=True))
        if not (self._seen and isfinite(dark[0]) and isfinite(bright[0]) and dark[0] > 0):
            return
        taken = bright[0] / dark[0] - 1
        for reading, seen in self._seen:
            low, high = (self._doubts.light(mean, **reading.reading) for mean, _ in (dark, bright))
            if low <= 0:
                continue
            otherwise = high / low - 1
            if reading.matters(taken, otherwise):
                seen.count += 1
                if abs(otherwise - taken) / (1 + taken) > abs(seen.otherwise - seen.taken) / (1 + seen.taken):
                    seen.frame, seen.pair = row["frame"], f"{bright[1]} / {dark[1]}"
                    seen.taken, seen.otherwise = taken, otherwise

    @property
    def findings(self) -> tuple[Finding, ...]:
        """A warning for each other reading that matters in a frame."""
        return tuple(
            reading.finding(seen.pair, seen.taken, seen.otherwise, count=seen.count, n_frames=self._n, frame=seen.frame)
            for reading, seen in self._seen
            if seen.count
        )
