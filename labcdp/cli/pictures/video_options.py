"""Regions, pairs and references of videos, as they are typed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import InputError
from ..options import parse_pair
from ..terminal import fraction_of_percent

if TYPE_CHECKING:
    from ...core.roi import Roi
    from ...evaluate.video.settings import Reference


def rois_of_pair(rois: Sequence[Roi], pair: tuple[str, str]) -> tuple[Roi, ...]:
    """Return the two regions of a pair."""
    named = {one.name: one for one in rois}
    return tuple(named[name] for name in pair)


def rois_and_pairs(
    path: Path | None, pairs: Sequence[str], neighbours: bool
) -> tuple[tuple[Roi, ...], tuple[tuple[str, str], ...]]:
    """Regions, and the pairs of them that are evaluated; none for nearest-neighbour CDP. Raises InputError."""
    from ...regions import load_regions, rois_of

    if neighbours:
        if path is not None or pairs:
            raise InputError("--neighbours needs no regions: leave --roi and --pair out, or --neighbours")
        return (), ()
    if path is None:
        raise InputError("no regions given: give a file with --roi (see labcdp rois), or --neighbours")
    found = {one.name: one for one in rois_of(load_regions(path))}
    if not pairs:
        if len(found) != 2:
            raise InputError(
                f"{path} holds {len(found)} regions ({', '.join(found)}): choose pairs with --pair BRIGHT:DARK"
                if len(found) > 2
                else f"{path} holds one region: draw a second one, a CDP is of two"
            )
        first, second = found
        return tuple(found.values()), ((first, second),)
    chosen = tuple(dict.fromkeys(parse_pair(pair, list(found)) for pair in pairs))
    return tuple(found.values()), chosen


def parse_reference(text: str) -> Reference:
    """Return a reference contrast, or where it is; raises InputError."""
    if text == "first":
        return "first"
    if text.endswith("%"):
        contrast = fraction_of_percent(text, "--reference")
        if not 0 < contrast < float("inf"):
            raise InputError(f"--reference is {text!r}: give a contrast above 0%")
        return contrast
    if not Path(text).is_file():
        raise InputError(
            f"--reference is {text!r}: give a contrast such as 1000%, first, or results.nc of another video"
        )
    return Path(text)
