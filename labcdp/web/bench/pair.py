"""The CDP of a pair over time, and its verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from math import isfinite, nan
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.roi import Roi
from ...metrics import cdp
from ...metrics.pair import Pair
from ...session import SessionConfiguration
from ..regions.drawing import Drawing
from ..regions.measurements import Measured, Measurements, PairEvaluation, is_saturated
from ..regions.page_image import PageImage
from .day_log import Snapshot

#: Tolerance where nothing else is said.
EPSILON = 0.5

Verdict = Literal["detected", "too weak", "too strong", "too noisy", "undecided", "saturated"]

#: CDP from which a contrast counts as detected.
LIMIT = 0.9
#: Length of the trace of the CDP.
TRACE_S = 180.0
#: Most contrasts: a row of the table and a line of the trace for each.
_MOST_CONTRASTS = 50
#: Range of a curve over the measured contrast, and number of its points.
_RANGE, _N_POINTS = (0.05, 20.0), 60


@dataclass(frozen=True)
class Target:
    """Target contrasts and their tolerance.

    Parameters
    ----------
    contrasts : tuple of float or None
        Weber contrasts, fractions, up to 50; None for the measured one.
    epsilon : float
        Relative tolerance.

    Raises
    ------
    InputError
        If there are more contrasts.
    """

    contrasts: tuple[float, ...] | None = None
    epsilon: float = EPSILON

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
        Its CDP with the 95 % interval; nan if a region is saturated.
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
    of : tuple
        The regions and what was to be detected.
    newest : tuple of PairPoint
        Those of the newest image; empty if it has none.
    """

    frames: tuple[tuple[PairPoint, ...], ...] = ()
    of: tuple[object, ...] = ()
    newest: tuple[PairPoint, ...] = ()

    def after(self, points: tuple[PairPoint, ...], of: tuple[object, ...]) -> Trace:
        """Return the trace with the points of another frame; it begins anew with another pair or number of them."""
        kept = self.frames if of == self.of else ()
        if points:
            now_s, n = points[0].time_s, len(points)
            kept = (
                *(
                    frame_points
                    for frame_points in kept
                    if now_s - frame_points[0].time_s < TRACE_S and len(frame_points) == n
                ),
                points,
            )
        return Trace(kept, of, points)


def pair_points(pair: Pair, time_s: float) -> tuple[PairPoint, ...]:
    """Return a pair's point for each target contrast; no number of saturated regions."""
    if is_saturated(pair.a, pair.b):
        return tuple(PairPoint(time_s, cdp.contrast, nan, nan, nan, "saturated") for cdp in pair.cdp)
    return tuple(
        PairPoint(
            time_s,
            cdp.contrast,
            cdp.cdp,
            *cdp.interval,
            verdict(pair.contrast.value, cdp.detected_range, cdp.interval),
        )
        for cdp in pair.cdp
    )


def verdict(measured: float, counting: tuple[float, float], interval: tuple[float, float]) -> Verdict:
    """Say whether a contrast is detected; if not, whether the measured one is beyond what counts, or pixels scatter."""
    low, high = interval
    if low < LIMIT <= high or low != low:
        return "undecided"
    if low >= LIMIT:
        return "detected"
    lowest, highest = counting
    return "too weak" if measured < lowest else "too strong" if measured > highest else "too noisy"


def snapshots_of(pair: PairEvaluation, time: datetime, taken: tuple[float, float], unit: str) -> list[Snapshot]:
    """Return the log entries of a pair with a result, one for each target contrast, without numbers if saturated."""
    result = pair.result
    assert result is not None, "it was measured"
    saturated = is_saturated(result.a, result.b)

    def known(value: float) -> float | None:
        return None if saturated or not isfinite(value) else value

    contrast = result.contrast
    return [
        Snapshot(
            time=time,
            first=pair.first.name,
            second=pair.second.name,
            contrast=known(contrast.value),
            contrast_u=known(contrast.u),
            target_contrast=point.contrast,
            epsilon=pair.epsilon,
            cdp=known(point.cdp),
            low=known(point.low),
            high=known(point.high),
            verdict=point.verdict,
            exposure_s=taken[0],
            gain_db=taken[1],
            unit=unit,
        )
        for point in pair_points(result, 0.0)
    ]


def cdp_curve(
    image: PageImage, pair: Sequence[Roi], contrast: float, epsilon: float
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return contrasts around the measured one, fractions, and the CDP of two regions at each."""
    contrasts = np.geomspace(*_RANGE, _N_POINTS) * max(contrast, 0.01)
    values = [image.light_in(roi) for roi in pair]
    bright, dark = sorted(values, key=lambda pixels: float(pixels.mean()), reverse=True)
    return contrasts, cdp(bright, dark, contrasts, epsilon).cdp


@dataclass(frozen=True)
class PlannedPair:
    """Two regions whose contrast the plan asks for.

    Parameters
    ----------
    first, second : str
        Names of the regions.
    target : Target
        Target contrasts and tolerance.
    """

    first: str
    second: str
    target: Target

    def rois(self, drawing: Drawing) -> tuple[Roi, ...]:
        """Its regions in a drawing, as far as there are any."""
        known = {roi.name: roi for roi in drawing.rois}
        return tuple(known[name] for name in (self.first, self.second) if name in known)


def planned_pairs(
    plan: SessionConfiguration | None, contrasts: tuple[float, ...] | None, epsilon: float | None
) -> tuple[PlannedPair, ...]:
    """Return the pairs of a plan, with its contrasts and tolerances unless others are given for all pairs."""
    pairs = () if plan is None else plan.contrasts
    by_plan = {
        PlannedPair(
            pair.bright,
            pair.dark,
            Target(contrasts or (pair.contrast,), pair.epsilon if epsilon is None else epsilon),
        ): None
        for pair in pairs
    }
    return tuple(by_plan)


class LiveMeasurements(Measurements):
    """Measurements of a frame that the next one replaces: uncertainties of the pair and of regions with limits.

    Parameters
    ----------
    image : PageImage
        The frame.
    target_of : function of a drawing
        Return what is to be detected of its pair.
    besides : PlannedPair or None
        Another pair that is measured, too.
    """

    def __init__(
        self, image: PageImage, target_of: Callable[[Drawing], Target], besides: PlannedPair | None = None
    ) -> None:
        super().__init__(image, None)
        self._target_of, self._besides = target_of, besides

    def measured(self, drawing: Drawing) -> Iterator[Measured]:
        """Yield all results at once: there may be no time for a second step."""
        target = self._target_of(drawing)
        self.contrasts, self.epsilon = target.contrasts, target.epsilon
        self._measure(drawing)
        self._measure_pair(drawing)
        limited = {roi for shape in drawing.shapes if shape.limits_cd_m2 is not None for roi in shape.rois()}
        judged = {roi: self._evaluated(roi, numbers) for roi, numbers in self._known.items() if roi in limited}
        others = {
            roi: replace(numbers, evaluated=True, result=self._result_in_pair(roi))
            for roi, numbers in self._known.items()
        }
        yield Measured(others | judged, self._pair, tuple(self._measured_besides(drawing)), self.image.taken)

    def _measured_besides(self, drawing: Drawing) -> Iterator[PairEvaluation]:
        rois = () if self._besides is None else self._besides.rois(drawing)
        if self._besides is not None and len(rois) == 2:
            target = self._besides.target
            yield self._evaluated_pair(rois, target.contrasts, target.epsilon)
