"""The CDP of a pair over time, and its verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

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
#: Share of saturated pixels from which a region's luminance means nothing.
_SATURATED = 0.001
#: Range of a curve over the measured contrast, and number of its points.
_RANGE, _N_POINTS = (0.05, 20.0), 60


@dataclass(frozen=True)
class Target:
    """What is to be detected.

    Parameters
    ----------
    contrast : float or None
        Weber contrast, a fraction; None for the measured one.
    epsilon : float
        Relative tolerance.
    """

    contrast: float | None = None
    epsilon: float = 0.5


@dataclass(frozen=True)
class PairPoint:
    """The pair in one frame.

    Parameters
    ----------
    time_s : float
        When the frame arrived, by the monotonic clock.
    cdp, low, high : float
        CDP of the first target contrast with its 95 % interval.
    verdict : str
        As of `verdict`; ``saturated`` if a region is, whatever its contrast.
    """

    time_s: float
    cdp: float
    low: float
    high: float
    verdict: Verdict


@dataclass(frozen=True)
class Trace:
    """CDP of a pair over the last minutes.

    Parameters
    ----------
    points : tuple of PairPoint
        The oldest first.
    pair : tuple of str
        Names of the regions.
    newest : PairPoint or None
        That of the newest image; None if it has none.
    """

    points: tuple[PairPoint, ...] = ()
    pair: tuple[str, ...] = ()
    newest: PairPoint | None = None

    def after(self, point: PairPoint | None, pair: tuple[str, ...]) -> Trace:
        """Return the trace with another point; it begins anew with another pair."""
        kept = self.points if pair == self.pair else ()
        if point is not None:
            kept = (*(one for one in kept if point.time_s - one.time_s < TRACE_S), point)
        return Trace(kept, pair, point)


def is_saturated(*regions: RegionResult) -> bool:
    """Whether so many pixels of a region are saturated that its luminance means nothing."""
    return any(region.invalid_shares.get("saturated", 0.0) > _SATURATED for region in regions)


def pair_point(pair: PairResult, time_s: float) -> PairPoint | None:
    """Return a pair's point; None without a target contrast."""
    if not pair.results:
        return None
    one = pair.results[0]
    low, high = one.confidence_interval
    found = "saturated" if is_saturated(pair.a, pair.b) else verdict(one.result.below, one.result.above, (low, high))
    return PairPoint(time_s, one.result.cdp, low, high, found)


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
