"""Request for the evaluation of a picture: regions, pairs, contrasts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

from ...core.errors import InputError
from ...core.roi import Roi
from .neighbours import Rectangle

#: Most regions for all pairs; with more, pairs must be selected.
MOST_REGIONS_FOR_ALL_PAIRS = 6


@dataclass(frozen=True)
class ImageRequest:
    """Request for the evaluation of a picture.

    Parameters
    ----------
    contrasts : tuple of float or None
        Contrasts to be detected, fractions; None for the measured contrast of each pair.
    epsilon : float
        Their tolerance.
    rois : tuple of Roi
        Regions.
    pairs : tuple of (str, str) or None
        Bright and dark regions, by name; None for all pairs.
    neighbours : bool
        Whether the nearest-neighbour CDP is wanted.
    rectangle : (int, int, int, int) or None
        Corner pixels x0, y0, x1, y1, both in, that it is limited to.

    Raises
    ------
    InputError
        If the request is empty, a pair names an unknown region or one region twice, there is only one region, or there
        are too many for all pairs.
    """

    contrasts: tuple[float, ...] | None = None
    epsilon: float = 0.5
    rois: tuple[Roi, ...] = ()
    pairs: tuple[tuple[str, str], ...] | None = None
    neighbours: bool = False
    rectangle: Rectangle | None = None

    def __post_init__(self) -> None:
        names = [roi.name for roi in self.rois]
        if not names and not self.neighbours:
            raise InputError("no evaluation was chosen: give regions, or ask for the nearest-neighbour CDP")
        for pair in self.pairs or ():
            for name in pair:
                if name not in names:
                    raise InputError(f"there is no region {name!r}: choose from {', '.join(names) or 'none'}")
            if pair[0] == pair[1]:
                raise InputError(f"region {pair[0]!r} is paired with itself: give two regions")
        if self.pairs is None and len(names) == 1 and not self.neighbours:
            raise InputError(f"region {names[0]!r} is alone: a contrast needs two regions")
        if self.pairs is None and len(names) > MOST_REGIONS_FOR_ALL_PAIRS:
            raise InputError(
                f"{len(names)} regions make {len(names) * (len(names) - 1) // 2} pairs: choose pairs among "
                f"{', '.join(names)}"
            )

    @property
    def chosen_pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the pairs, each pair once."""
        if self.pairs is None:
            return tuple(combinations((roi.name for roi in self.rois), 2))
        found: dict[frozenset[str], tuple[str, str]] = {}
        for pair in self.pairs:
            found.setdefault(frozenset(pair), pair)
        return tuple(found.values())
