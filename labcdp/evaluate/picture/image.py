"""A measured picture: contrasts of its regions, and of neighbouring pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from ...core.luminance import LuminanceMap
from ...core.result import Finding, info, unique, warning
from ...files.read import read_picture
from ...metrics.pair import VIGNETTING_CODE, Pair, evaluate_pair
from ...metrics.region import RegionLight, evaluate_region
from .converter import PictureSource
from .neighbours import NeighbourPair, evaluate_neighbours
from .settings import ImageSettings

if TYPE_CHECKING:
    from ..chart.measure import MeasuredChart
    from ..colour.measure import PairColours

#: Contrast of two regions, or of neighbouring pixels.
AnyContrast: TypeAlias = Pair | NeighbourPair


@dataclass(frozen=True, eq=False)
class MeasuredPicture:
    """A picture with what was measured in it, or the reason why nothing was.

    Parameters
    ----------
    file : str
        Its file, as it was given.
    source : PictureSource or None
        Facts about the picture; None if it could not be evaluated.
    regions : tuple of RegionLight
        All regions, in the order of the settings.
    pairs : tuple of Pair
        In the order of the settings.
    neighbours : NeighbourPair or None
        Of neighbouring pixels.
    findings : tuple of Finding
        Findings about the picture.
    number : int
        Its number, in the order the pictures were given.
    folder : str
        Folder of its page next to the overview; empty for a single picture.
    failure : str
        Why it could not be evaluated.
    chart : MeasuredChart or None
        Its chart, if one was asked for.
    colours : tuple of PairColours
        Colours of its pairs, if they were asked for.
    """

    file: str
    source: PictureSource | None
    regions: tuple[RegionLight, ...] = ()
    pairs: tuple[Pair, ...] = ()
    neighbours: NeighbourPair | None = None
    findings: tuple[Finding, ...] = ()
    number: int = 1
    folder: str = ""
    failure: str = ""
    chart: MeasuredChart | None = None
    colours: tuple[PairColours, ...] = ()

    @property
    def contrasts(self) -> tuple[AnyContrast, ...]:
        """The pairs, then the neighbouring pixels."""
        return self.pairs if self.neighbours is None else (*self.pairs, self.neighbours)

    @property
    def unit(self) -> str:
        """Unit of the luminance; empty if it could not be evaluated."""
        return "" if self.source is None else self.source.unit


def measure_picture(luminance: LuminanceMap, source: PictureSource, settings: ImageSettings) -> MeasuredPicture:
    """Measure the contrasts of a picture.

    Parameters
    ----------
    luminance : LuminanceMap
        Its luminance.
    source : PictureSource
        Facts about the picture.
    settings : ImageSettings
        Settings of the evaluation.

    Raises
    ------
    InputError
        As `evaluate_pair` and `evaluate_neighbours`.
    """
    rois = {roi.name: roi for roi in settings.rois}
    targets = settings.contrasts, settings.epsilon
    pairs = [
        evaluate_pair(luminance, rois[a], rois[b], settings.target_contrasts(a, b), settings.epsilon)
        for a, b in settings.chosen_pairs
    ]
    evaluated = {region.roi.name: region for pair in pairs for region in (pair.a, pair.b)}
    regions = [evaluated.get(name) or evaluate_region(luminance, roi) for name, roi in rois.items()]
    neighbours = None
    if settings.neighbours:
        neighbours = evaluate_neighbours(luminance, *targets, settings.rectangle)
    findings = [*source.findings]
    if any(pair.targets_measured_contrast for pair in pairs) and settings.contrasts is None:
        findings.append(info("contrast-is-measured"))
    findings += [
        warning("pair-swapped", bright=pair.b.roi.name, dark=pair.a.roi.name)
        for pair in pairs
        if settings.pairs is not None and pair.bright == "b"
    ]
    findings += _pair_findings(pairs)
    findings += neighbours.findings if neighbours is not None else ()
    chart = None
    if settings.chart is not None:
        from ..chart.measure import measure_chart

        dark = settings.dark_surroundings
        other = None if dark is None else settings.converter.luminance(read_picture(dark, settings.converter.options))
        where = settings.chart, settings.rois
        chart = measure_chart(luminance, source.unit, *where, *targets, settings.cdp_limit, other)
        findings += chart.findings
        # The file need not state from which DN on pixels are saturated: the chart shows it.
        full = {region.roi.name for region, clipped in zip(chart.regions, chart.saturated, strict=True) if clipped}
        pairs = [pair.clipped(full) for pair in pairs]
        regions = [region.clipped() if region.roi.name in full else region for region in regions]
    return MeasuredPicture(
        str(source.path), source, tuple(regions), tuple(pairs), neighbours, unique(findings), chart=chart
    )


def _pair_findings(pairs: Sequence[Pair]) -> list[Finding]:
    """Return the findings of pairs; of the vignetting, one about the pair for which it matters most."""
    findings = [finding for pair in pairs for finding in pair.findings]
    lens = [finding for finding in findings if finding.code == VIGNETTING_CODE]
    if len(lens) < 2:
        return findings
    largest = max(lens, key=lambda finding: float(str(finding.values["share"])))
    values = {**largest.values, "count": len(lens)}
    joined = warning("contrasts-with-vignetting", largest.subject, **values)
    return [*(finding for finding in findings if finding.code != VIGNETTING_CODE), joined]
