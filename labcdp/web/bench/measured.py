"""What the live bench is asked for, and what it measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ...acquire import Operator
from ...drivers.meter import Meter
from ...session import SessionConfiguration
from ..regions.drawing import Drawing
from ..regions.measurements import Evaluated, Evaluation, Measurements


@dataclass(frozen=True)
class Target:
    """What is to be detected.

    Parameters
    ----------
    contrast : float or None
        Weber contrast, a fraction; None for the measured one.
    epsilon : float
        Relative tolerance.
    limit : float
        CDP from which it counts as detected.
    """

    contrast: float | None = None
    epsilon: float = 0.5
    limit: float = 0.9


@dataclass(frozen=True)
class BenchOfPage:
    """What stands on the bench beside the camera.

    Parameters
    ----------
    meter : Meter or None
        Open.
    plan : SessionConfiguration or None
        What is to be recorded.
    hands : Operator or None
        The simulated bench, which does what a person does at a real one.
    """

    meter: Meter | None = None
    plan: SessionConfiguration | None = None
    hands: Operator | None = None


@dataclass(frozen=True)
class MeterReading:
    """A reading of the meter on the page.

    Parameters
    ----------
    luminance_cd_m2 : float
        Reading of the meter, or what a person typed.
    region : str
        Region selected when it was taken; empty if none was.
    camera_cd_m2 : float or None
        Mean luminance of that region by the calibrated camera at the same time.
    """

    luminance_cd_m2: float
    region: str
    camera_cd_m2: float | None

    @property
    def deviation(self) -> float | None:
        """Deviation of the camera from the meter, relative."""
        if self.camera_cd_m2 is None or not self.luminance_cd_m2:
            return None
        return self.camera_cd_m2 / self.luminance_cd_m2 - 1


class LiveMeasurements(Measurements):
    """Measurements of a frame that the next one replaces: uncertainties of the pair and of regions with limits."""

    def evaluations(self, drawing: Drawing) -> Iterator[Evaluated]:
        """Yield the results of the pair and of regions with limits."""
        found = next(super().evaluations(drawing), Evaluated())
        of_pair = (
            {}
            if found.pair is None or found.pair.result is None
            else {one.roi: Evaluation(one) for one in (found.pair.result.a, found.pair.result.b)}
        )
        limited = [roi for shape in drawing.shapes if shape.limits_cd_m2 is not None for roi in shape.rois()]
        judged = {roi: self._evaluated(roi) for roi in limited if roi not in of_pair}
        yield Evaluated({roi: Evaluation(None) for roi in drawing.rois} | judged | of_pair, found.pair)
