"""What the contrast of two regions would be in all frames, if the values were read otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

from ...core.result import Finding
from ...files.doubts import MOSAIC, Doubts, contrast_matters
from ..picture.converter import Converter


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
    converter : Converter
        To relative values.
    doubts : Doubts
        What is doubtful about them.
    """

    def __init__(self, converter: Converter, doubts: Doubts) -> None:
        self._doubts, self._n = doubts, 0
        self._seen = {code: _Seen() for code in converter.doubt_codes(doubts) if code != MOSAIC}

    def add(self, row: Mapping[str, Any], names: tuple[str, str]) -> None:
        """Take note of a row, and of the names of its regions."""
        self._n += 1
        dark, bright = sorted(zip(row["mean"], names, strict=True))
        if not (self._seen and isfinite(dark[0]) and isfinite(bright[0]) and dark[0] > 0):
            return
        taken = bright[0] / dark[0] - 1
        for code, seen in self._seen.items():
            low, high = (self._doubts.light(mean, code) for mean, _ in (dark, bright))
            if low <= 0:
                continue
            otherwise = high / low - 1
            if contrast_matters(taken, otherwise):
                seen.count += 1
                if abs(otherwise - taken) / (1 + taken) > abs(seen.otherwise - seen.taken) / (1 + seen.taken):
                    seen.frame, seen.pair = row["frame"], f"{bright[1]} / {dark[1]}"
                    seen.taken, seen.otherwise = taken, otherwise

    @property
    def findings(self) -> tuple[Finding, ...]:
        """A warning for each other reading that matters in a frame."""
        return tuple(
            self._doubts.finding(
                code, seen.taken, seen.otherwise, seen.pair, count=seen.count, n_frames=self._n, frame=seen.frame
            )
            for code, seen in self._seen.items()
            if seen.count
        )
