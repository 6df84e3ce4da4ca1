"""What the live bench is asked for, and what it measured."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import hypot, nan

from ...acquire import Operator
from ...core.reading import ReadingSeries
from ...core.roi import Roi
from ...drivers.meter import Meter
from ...metrics.regions.region import result_of_region
from ...report.digits import Z_95
from ...session import Session, SessionConfiguration
from ..regions.drawing import Drawing
from ..regions.measurements import Evaluated, Evaluation, Measurements
from ..regions.page_image import PageImage


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
    begun : function of a session
        Records in a new session what the devices are.
    """

    meter: Meter | None = None
    plan: SessionConfiguration | None = None
    hands: Operator | None = None
    begun: Callable[[Session], None] = lambda _session: None


@dataclass(frozen=True)
class MeterReading:
    """A reading of the meter on the page.

    Parameters
    ----------
    luminance_cd_m2 : float
        Reading of the meter, mean of several, or what a person typed.
    region : str
        Region selected when it was taken; empty if none was.
    camera_cd_m2 : float or None
        Mean luminance of that region by the calibrated camera at the same time.
    meter_u_cd_m2, camera_u_cd_m2 : float or None
        Their standard uncertainties; None if they are not known.
    n_readings : int
        Number of readings.
    scatter_rel : float
        Standard deviation of the readings, relative to their mean; nan for one.
    """

    luminance_cd_m2: float
    region: str
    camera_cd_m2: float | None
    meter_u_cd_m2: float | None = None
    camera_u_cd_m2: float | None = None
    n_readings: int = 1
    scatter_rel: float = nan

    @property
    def disagrees(self) -> bool:
        """Whether camera and meter differ by more than the U (95 %) of their difference."""
        if self.camera_cd_m2 is None or self.meter_u_cd_m2 is None or self.camera_u_cd_m2 is None:
            return False
        expanded = Z_95 * hypot(self.meter_u_cd_m2, self.camera_u_cd_m2)
        return abs(self.camera_cd_m2 - self.luminance_cd_m2) > expanded

    @property
    def deviation(self) -> float | None:
        """Deviation of the camera from the meter, relative."""
        if self.camera_cd_m2 is None or not self.luminance_cd_m2:
            return None
        return self.camera_cd_m2 / self.luminance_cd_m2 - 1


def meter_reading(taken: ReadingSeries | float, region: str, image: PageImage, rois: Sequence[Roi]) -> MeterReading:
    """Return what the meter said, or a person typed, with what the calibrated camera sees in the region now."""
    camera, camera_u = None, None
    for roi in rois:
        if roi.name == region and image.unit == "cd/m^2":
            found = result_of_region(image.pixels(roi))
            camera, camera_u = found.mean, found.standard_uncertainty
    if isinstance(taken, float):
        return MeterReading(taken, region, camera, None, camera_u)
    mean = taken.mean_cd_m2
    u = hypot(taken.standard_uncertainty_random_cd_m2, taken.standard_uncertainty_common_rel * mean)
    return MeterReading(mean, region, camera, u, camera_u, len(taken.readings), taken.scatter_rel)


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
