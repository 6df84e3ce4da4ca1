"""Evaluation of a picture: contrasts of its regions, and of neighbouring pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

from ...core.luminance import LuminanceMap
from ...core.result import Finding, info, unique, warning
from ...metrics.pair import VIGNETTING_CODE, Pair, evaluate_pair
from ...metrics.region import RegionLight, evaluate_region
from .converter import PictureSource
from .neighbours import NeighbourEvaluation, evaluate_neighbours
from .settings import ImageSettings

#: Contrast of two regions, or of neighbouring pixels.
AnyContrast: TypeAlias = Pair | NeighbourEvaluation


@dataclass(frozen=True, eq=False)
class ImageEvaluation:
    """Contrasts of a picture.

    Parameters
    ----------
    source : PictureSource
        The picture.
    regions : tuple of RegionLight
        All regions, in the order of the request.
    pairs : tuple of Pair
        In the order of the request.
    neighbours : NeighbourEvaluation or None
        Of neighbouring pixels.
    findings : tuple of Finding
        What a user should know.
    """

    source: PictureSource
    regions: tuple[RegionLight, ...]
    pairs: tuple[Pair, ...]
    neighbours: NeighbourEvaluation | None
    findings: tuple[Finding, ...]

    @property
    def contrasts(self) -> tuple[AnyContrast, ...]:
        """The pairs, then the neighbouring pixels."""
        return self.pairs if self.neighbours is None else (*self.pairs, self.neighbours)


def evaluate_image(luminance: LuminanceMap, source: PictureSource, settings: ImageSettings) -> ImageEvaluation:
    """Evaluate a picture.

    Parameters
    ----------
    luminance : LuminanceMap
        Its luminance.
    source : PictureSource
        What is known of it.
    settings : ImageSettings
        What is to be evaluated.

    Raises
    ------
    InputError
        As `evaluate_pair` and `evaluate_neighbours`.
    """
    rois = {roi.name: roi for roi in settings.rois}
    asked = settings.contrasts, settings.epsilon
    pairs = [evaluate_pair(luminance, rois[a], rois[b], *asked) for a, b in settings.chosen_pairs]
    evaluated = {region.roi.name: region for pair in pairs for region in (pair.a, pair.b)}
    regions = [evaluated.get(name) or evaluate_region(luminance, roi) for name, roi in rois.items()]
    neighbours = None
    if settings.neighbours:
        neighbours = evaluate_neighbours(luminance, *asked, settings.rectangle)
    found = [*source.findings]
    if any(pair.targets_measured_contrast for pair in pairs) and settings.contrasts is None:
        found.append(info("contrast-is-measured"))
    found += [
        warning("pair-swapped", bright=pair.b.roi.name, dark=pair.a.roi.name)
        for pair in pairs
        if settings.pairs is not None and pair.bright == "b"
    ]
    found += _of_pairs(pairs)
    found += neighbours.findings if neighbours is not None else ()
    return ImageEvaluation(source, tuple(regions), tuple(pairs), neighbours, unique(found))


def _of_pairs(pairs: Sequence[Pair]) -> list[Finding]:
    """Return the findings of pairs; of the vignetting, one about the pair for which it matters most."""
    found = [one for pair in pairs for one in pair.findings]
    lens = [one for one in found if one.code == VIGNETTING_CODE]
    if len(lens) < 2:
        return found
    largest = max(lens, key=lambda one: float(str(one.values["share"])))
    values = {**largest.values, "count": len(lens)}
    joined = warning("contrasts-with-vignetting", largest.subject, **values)
    return [*(one for one in found if one.code != VIGNETTING_CODE), joined]
