"""The CDP of a pair over time, and its verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.roi import Roi
from ...metrics import cdp
from ...metrics.pair import PairResult
from ...metrics.region import RegionResult
from ..regions.drawing import Drawing
from ..regions.measurements import Measured, Measurements
from ..regions.page_image import PageImage

Verdict = Literal["detected", "too weak", "too strong", "undecided", "saturated"]

#: CDP from which a contrast counts as detected.
LIMIT = 0.9
#: Length of the trace of the CDP.
TRACE_S = 180.0
#: Most contrasts: a row of the table and a line of the trace for each.
_MOST_CONTRASTS = 50
#: Share of saturated pixels from which a region's luminance means nothing.
_SATURATED = 0.001
#: Range of a curve over the measured contrast, and number of its points.
_RANGE, _N_POINTS = (0.05, 20.0), 60


@dataclass(frozen=True)
class Target:
    """What is to be detected.

    Parameters
    ----------
    contrasts : sequence of float or None
        Weber contrasts, fractions, up to 50; None for the measured one.
    epsilon : float
        Relative tolerance.

    Raises
    ------
    InputError
        If there are more contrasts.
    """

    contrasts: Sequence[float] | None = None
    epsilon: float = 0.5

    def __post_init__(self) -> None:
        if self.contrasts is not None and len(self.contrasts) > _MOST_CONTRASTS:
            raise InputError(f"{len(self.contrasts)} target contrasts: the page shows at most {_MOST_CONTRASTS}")


@dataclass(frozen=True)
class PairPoint:
    """The pair in one frame, at one target contrast.

    Parameters
    ----------
    time_s : float
        When the frame arrived, by the monotonic clock.
    contrast : float
        Target contrast.
    cdp, low, high : float
        Its CDP with the 95 % interval.
    verdict : str
        As of `verdict`; ``saturated`` if a region is, whatever its contrast.
    """

    time_s: float
    contrast: float
    cdp: float
    low: float
    high: float
    verdict: Verdict


@dataclass(frozen=True)
class Trace:
    """CDP of a pair over the last minutes.

    Parameters
    ----------
    frames : tuple of tuple of PairPoint
        A point for each target contrast; the oldest frame first.
    pair : tuple of str
        Names of the regions.
    newest : tuple of PairPoint
        Those of the newest image; empty if it has none.
    """

    frames: tuple[tuple[PairPoint, ...], ...] = ()
    pair: tuple[str, ...] = ()
    newest: tuple[PairPoint, ...] = ()

    def after(self, points: tuple[PairPoint, ...], pair: tuple[str, ...]) -> Trace:
        """Return the trace with the points of another frame; it begins anew with another pair or number of them."""
        kept = self.frames if pair == self.pair else ()
        if points:
            now_s, n = points[0].time_s, len(points)
            kept = (*(one for one in kept if now_s - one[0].time_s < TRACE_S and len(one) == n), points)
        return Trace(kept, pair, points)


def is_saturated(*regions: RegionResult) -> bool:
    """Whether so many pixels of a region are saturated that its luminance means nothing."""
    return any(region.invalid_shares.get("saturated", 0.0) > _SATURATED for region in regions)


def pair_points(pair: PairResult, time_s: float) -> tuple[PairPoint, ...]:
    """Return a pair's point for each target contrast."""
    saturated, points = is_saturated(pair.a, pair.b), []
    for result, (low, high) in ((one.result, one.confidence_interval) for one in pair.results):
        found = "saturated" if saturated else verdict(result.below, result.above, (low, high))
        points.append(PairPoint(time_s, result.contrast, result.cdp, low, high, found))
    return tuple(points)


def verdict(below: float, above: float, interval: tuple[float, float]) -> Verdict:
    """Say whether a contrast is detected; if not, whether more pairs show less, or more, than what counts."""
    low, high = interval
    if low < LIMIT <= high or low != low:
        return "undecided"
    if low >= LIMIT:
        return "detected"
    return "too weak" if below >= above else "too strong"


def cdp_curve(
    image: PageImage, pair: Sequence[Roi], contrast: float, epsilon: float
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return contrasts around the measured one, fractions, and the CDP of two regions at each."""
    contrasts = np.geomspace(*_RANGE, _N_POINTS) * max(contrast, 0.01)
    values = [image.light_in(roi) for roi in pair]
    bright, dark = sorted(values, key=lambda one: float(one.mean()), reverse=True)
    return contrasts, cdp(bright, dark, contrasts, epsilon).cdp


class LiveMeasurements(Measurements):
    """Measurements of a frame that the next one replaces: uncertainties of the pair and of regions with limits."""

    def measured(self, drawing: Drawing) -> Iterator[Measured]:
        """Yield all results at once: there may be no time for a second step."""
        self._measure(drawing)
        self._measure_pair(drawing)
        limited = {roi for shape in drawing.shapes if shape.limits_cd_m2 is not None for roi in shape.rois()}
        judged = {roi: self._evaluated(roi, numbers) for roi, numbers in self._known.items() if roi in limited}
        others = {roi: replace(one, evaluated=True, result=self._of_pair(roi)) for roi, one in self._known.items()}
        yield Measured(others | judged, self._pair)
