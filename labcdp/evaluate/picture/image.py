"""Evaluation of a picture: contrasts of its regions, and of neighbouring pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, TypeAlias

from ...core.errors import InputError
from ...core.luminance import LuminanceMap
from ...core.result import Finding, info, unique, warning
from ...core.roi import Rectangle, Roi
from ...metrics.pair import VIGNETTING_CODE, PairResult, evaluate_pair
from ...metrics.region import RegionLight, evaluate_region
from ..requirement import Requirement
from ..verdict import CDP_LIMIT, require_limit
from .conversion import PictureSource
from .neighbours import NeighbourEvaluation, evaluate_neighbours

#: Contrast of two regions, or of neighbouring pixels.
AnyContrast: TypeAlias = PairResult | NeighbourEvaluation


@dataclass(frozen=True, eq=False)
class ImageEvaluation:
    """Contrasts of a picture.

    Parameters
    ----------
    source : PictureSource
        The picture.
    regions : tuple of RegionLight
        All regions, in the order of the request.
    pairs : tuple of PairResult
        In the order of the request.
    neighbours : NeighbourEvaluation or None
        Of neighbouring pixels.
    findings : tuple of Finding
        What a user should know.
    """

    source: PictureSource
    regions: tuple[RegionLight, ...]
    pairs: tuple[PairResult, ...]
    neighbours: NeighbourEvaluation | None
    findings: tuple[Finding, ...]

    @property
    def contrasts(self) -> tuple[AnyContrast, ...]:
        """The pairs, then the neighbouring pixels."""
        return self.pairs if self.neighbours is None else (*self.pairs, self.neighbours)


def evaluate_image(luminance: LuminanceMap, source: PictureSource, request: ImageRequest) -> ImageEvaluation:
    """Evaluate a picture.

    Parameters
    ----------
    luminance : LuminanceMap
        Its luminance.
    source : PictureSource
        What is known of it.
    request : ImageRequest
        The request.

    Raises
    ------
    InputError
        As `evaluate_pair` and `evaluate_neighbours`.
    """
    rois = {roi.name: roi for roi in request.rois}
    asked = request.contrasts, request.epsilon
    pairs = [evaluate_pair(luminance, rois[a], rois[b], *asked) for a, b in request.chosen_pairs]
    evaluated = {region.roi.name: region for pair in pairs for region in (pair.a, pair.b)}
    regions = [evaluated.get(name) or evaluate_region(luminance, roi) for name, roi in rois.items()]
    neighbours = None
    if request.neighbours:
        neighbours = evaluate_neighbours(luminance, *asked, request.rectangle)
    found = [*source.findings]
    if any(pair.targets_measured_contrast for pair in pairs) and request.contrasts is None:
        found.append(info("contrast-is-measured"))
    found += [
        warning("pair-swapped", bright=pair.b.roi.name, dark=pair.a.roi.name)
        for pair in pairs
        if request.pairs is not None and pair.bright == "b"
    ]
    found += _of_pairs(pairs)
    found += neighbours.findings if neighbours is not None else ()
    return ImageEvaluation(source, tuple(regions), tuple(pairs), neighbours, unique(found))


def _of_pairs(pairs: Sequence[PairResult]) -> list[Finding]:
    """Return the findings of pairs; of the vignetting, one about the pair for which it matters most."""
    found = [one for pair in pairs for one in pair.findings]
    lens = [one for one in found if one.code == VIGNETTING_CODE]
    if len(lens) < 2:
        return found
    largest = max(lens, key=lambda one: float(str(one.values["share"])))
    values = {**largest.values, "count": len(lens)}
    joined = warning("contrasts-with-vignetting", largest.subject, **values)
    return [*(one for one in found if one.code != VIGNETTING_CODE), joined]


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
    cdp_limit : float
        CDP from which a contrast counts as detected.
    requirement : Requirement or None
        What the pairs are judged by; contrast, tolerance and limit are then its own.

    Raises
    ------
    InputError
        If the request is empty, a pair names an unknown region or one region twice, there is only one region, or there
        are too many for all pairs; or if the limit is no probability.
    """

    contrasts: tuple[float, ...] | None = None
    epsilon: float = 0.5
    rois: tuple[Roi, ...] = ()
    pairs: tuple[tuple[str, str], ...] | None = None
    neighbours: bool = False
    rectangle: Rectangle | None = None
    cdp_limit: float = CDP_LIMIT
    requirement: Requirement | None = None

    def __post_init__(self) -> None:
        require_limit(self.cdp_limit)
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
            raise InputError(f"region {names[0]!r} is the only one: a contrast needs two regions")
        if self.pairs is None and len(names) > MOST_REGIONS_FOR_ALL_PAIRS:
            raise InputError(
                f"{len(names)} regions make {len(names) * (len(names) - 1) // 2} pairs: choose pairs among "
                f"{', '.join(names)}"
            )

    @property
    def configuration(self) -> dict[str, Any]:
        """Return it but for the corners of the regions, as values JSON can hold."""
        names = ("contrasts", "epsilon", "neighbours", "rectangle", "cdp_limit")
        required = {} if self.requirement is None else {"requirement": self.requirement.model_dump(mode="json")}
        return {**{name: getattr(self, name) for name in names}, "pairs": self.chosen_pairs, **required}

    @property
    def chosen_pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the pairs, each pair once."""
        if self.pairs is None:
            return tuple(combinations((roi.name for roi in self.rois), 2))
        found: dict[frozenset[str], tuple[str, str]] = {}
        for pair in self.pairs:
            found.setdefault(frozenset(pair), pair)
        return tuple(found.values())
