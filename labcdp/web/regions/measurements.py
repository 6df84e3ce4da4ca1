"""Measurements in the regions of a drawing, in the background: DN, luminance, and the CDP of a pair."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Protocol

from numpy.typing import NDArray

from ...core.errors import LabcdpError
from ...core.result import Finding
from ...core.roi import Roi
from ...metrics.pair import Pair, evaluate_regions, require_apart
from ...metrics.region import RegionLight, measure_region
from ...regions import check_region
from .drawing import Drawing
from .page_image import PageImage

#: With more regions than this only those of the pair are measured, to keep the page responsive.
MOST_MEASURED = 200


def is_saturated(*regions: RegionLight) -> bool:
    """Whether so many pixels of a region are saturated that its luminance is only known to be higher."""
    return any(region.bound for region in regions)


@dataclass(frozen=True)
class RegionNumbers:
    """Numbers of a region: what is computed at once, and its luminance with uncertainty, which takes longer.

    Parameters
    ----------
    n_pixels : int
        Number of its pixels.
    value, value_std : float or None
        Mean and standard deviation (n - 1) of DN or of the values of the file; None if there are not enough pixels.
    light, light_std, lowest, highest : float or None
        Luminance: mean, standard deviation (n - 1), and range of the pixels.
    saturated : float
        Share of saturated pixels.
    evaluated : bool
        Whether the rest is known.
    result : RegionLight or None
        Luminance with its uncertainty; None if it cannot be evaluated.
    findings : tuple of Finding
        Findings for the user.
    error : str
        Why there are none.
    """

    n_pixels: int = 0
    value: float | None = None
    value_std: float | None = None
    light: float | None = None
    light_std: float | None = None
    lowest: float | None = None
    highest: float | None = None
    saturated: float = 0.0
    evaluated: bool = False
    result: RegionLight | None = None
    findings: tuple[Finding, ...] = ()
    error: str = ""


@dataclass(frozen=True)
class PairEvaluation:
    """Contrast of a pair of regions.

    Parameters
    ----------
    first, second : Roi
        The regions.
    contrasts : tuple of float or None
        Target contrasts that were asked for; None for the measured one.
    epsilon : float
        Their tolerance.
    result : Pair or None
        Their contrast and CDP; None if they cannot be evaluated.
    error : str
        Why there is no result.
    """

    first: Roi
    second: Roi
    contrasts: tuple[float, ...] | None
    epsilon: float
    result: Pair | None
    error: str = ""

    def answers(self, pair: Sequence[Roi], contrasts: Sequence[float] | None, epsilon: float) -> bool:
        """Whether it was measured for these two regions as drawn now, and for these contrasts."""
        targets = None if contrasts is None else tuple(contrasts)
        return ((self.first, self.second), self.contrasts, self.epsilon) == (tuple(pair), targets, epsilon)


@dataclass(frozen=True)
class Measured:
    """Results so far.

    Parameters
    ----------
    regions : dict of Roi to RegionNumbers
        Regions.
    pair : PairEvaluation or None
        Last evaluated pair.
    others : tuple of PairEvaluation
        Further pairs.
    taken : (float, float) or None
        Exposure and gain of a live image.
    """

    regions: dict[Roi, RegionNumbers] = field(default_factory=dict)
    pair: PairEvaluation | None = None
    others: tuple[PairEvaluation, ...] = ()
    taken: tuple[float, float] | None = None


class Measurements:
    """Measure drawings of one image, reusing results of unchanged regions.

    Parameters
    ----------
    image : PageImage
        The image.
    contrasts : sequence of float or None
        Target contrasts, fractions; None for the measured contrast of the pair.
    epsilon : float
        Their relative tolerance.
    """

    def __init__(self, image: PageImage, contrasts: Sequence[float] | None, epsilon: float = 0.5) -> None:
        self.image, self.contrasts, self.epsilon = image, contrasts, epsilon
        self._known: dict[Roi, RegionNumbers] = {}
        self._pair: PairEvaluation | None = None

    def measured(self, drawing: Drawing) -> Iterator[Measured]:
        """Yield the results so far: the means, the pair, then the regions one by one; the last one is complete."""
        self._measure(drawing)
        yield Measured(self._known, self._pair)
        self._measure_pair(drawing)
        yield Measured(self._known, self._pair)
        for roi, numbers in self._known.items():
            if not numbers.evaluated:
                self._known = {**self._known, roi: self._evaluated(roi, numbers)}
                yield Measured(self._known, self._pair)

    def _measure(self, drawing: Drawing) -> None:
        wanted = drawing.rois if len(drawing.rois) <= MOST_MEASURED else drawing.pair_rois
        self._known = {roi: self._known.get(roi) or self._numbers(roi) for roi in wanted}

    def _measure_pair(self, drawing: Drawing) -> None:
        chosen = drawing.pair_rois
        if len(chosen) < 2 or (self._pair is not None and self._pair.answers(chosen, self.contrasts, self.epsilon)):
            return
        self._pair = self._evaluated_pair(chosen, self.contrasts, self.epsilon)

    def _evaluated_pair(self, pair: Sequence[Roi], contrasts: Sequence[float] | None, epsilon: float) -> PairEvaluation:
        first, second = pair
        targets = None if contrasts is None else tuple(contrasts)
        done = partial(PairEvaluation, first, second, targets, epsilon)
        try:
            a, b = map(self.image.pixels, pair)
            require_apart(a.placed, b.placed)
            return done(evaluate_regions(a, b, contrasts, epsilon))
        except LabcdpError as error:
            return done(None, str(error))

    def _numbers(self, roi: Roi) -> RegionNumbers:
        try:
            inside = roi.select(self.image.values)
            light = self.image.light_in(roi)
            highest = self.image.saturation_dn
            saturated = float((roi.select(self.image.saturated) if highest is None else inside >= highest).mean())
        except LabcdpError as error:
            return RegionNumbers(error=str(error))
        return RegionNumbers(
            n_pixels=inside.size,
            value=float(inside.mean(dtype=float)),
            value_std=_std(inside),
            light=float(light.mean(dtype=float)),
            light_std=_std(light),
            lowest=float(light.min()),
            highest=float(light.max()),
            saturated=saturated,
        )

    def _evaluated(self, roi: Roi, numbers: RegionNumbers) -> RegionNumbers:
        done = replace(numbers, evaluated=True)
        try:
            done = replace(done, findings=check_region(self.image.values, self.image.saturated, roi))
            return replace(done, result=self._result_in_pair(roi) or measure_region(self.image.pixels(roi)))
        except LabcdpError as error:
            return replace(done, error=str(error))

    def _result_in_pair(self, roi: Roi) -> RegionLight | None:
        """Return the result of a region from that of the pair."""
        pair = None if self._pair is None else self._pair.result
        return None if pair is None else next((region for region in (pair.a, pair.b) if region.roi == roi), None)


def _std(values: NDArray[Any]) -> float | None:
    return float(values.std(dtype=float, ddof=1)) if values.size > 1 else None


class RunElsewhere(Protocol):
    """Run `steps` without blocking the page; pass each result to `then` and call `done` in the page's thread."""

    def __call__(self, steps: Iterator[Any], then: Callable[[Any], None], done: Callable[[], None]) -> None:
        """Start and return immediately."""
