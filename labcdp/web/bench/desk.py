"""The meter at the live bench: readings of it, or typed ones of another."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import hypot, nan
from os.path import exists
from time import monotonic, sleep

from ...acquire import Operator
from ...core.errors import LabcdpError
from ...core.reading import MeterIdentity, Reading, ReadingSeries
from ...core.roi import Roi
from ...drivers.manual import MeterAccuracy, stated_accuracy, typed_reading
from ...drivers.meter import Meter, MeterError, MeterLostError
from ...metrics.region import result_of_region
from ...report.text import Z_95
from ...session import MeterConfiguration, Session, SessionConfiguration
from ..regions.page_image import PageImage
from .pair import is_saturated

#: Longest wait for a meter that was unplugged, and pause between two attempts.
_METER_S, _PAUSE_S = 60.0, 0.5
#: Readings that are kept.
_MOST_KEPT = 20


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
    saturated : bool
        Whether the region was saturated, so that the camera says nothing about its luminance.
    """

    luminance_cd_m2: float
    region: str
    camera_cd_m2: float | None
    meter_u_cd_m2: float | None = None
    camera_u_cd_m2: float | None = None
    n_readings: int = 1
    scatter_rel: float = nan
    saturated: bool = False

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


def meter_reading(
    taken: ReadingSeries, known: bool, region: str, image: PageImage, rois: Sequence[Roi]
) -> MeterReading:
    """Return what a meter of known accuracy, or not, said, with what the calibrated camera sees in the region now."""
    camera, camera_u, saturated = None, None, False
    for roi in rois:
        if roi.name == region and image.unit == "cd/m^2":
            found = result_of_region(image.pixels(roi))
            saturated = is_saturated(found)
            camera, camera_u = (None, None) if saturated else (found.mean, found.standard_uncertainty)
    mean = taken.mean_cd_m2
    u = hypot(taken.standard_uncertainty_random_cd_m2, taken.standard_uncertainty_common_rel * mean)
    n, scatter = len(taken.readings), taken.scatter_rel
    return MeterReading(mean, region, camera, u if known else None, camera_u, n, scatter, saturated)


class MeterDesk:
    """A meter and its readings, the newest first.

    Parameters
    ----------
    meter : Meter or None
        Open; None if readings are only typed.
    hands : Operator or None
        The simulated bench, which points its meter at the region.
    seen : function
        Return the image of the camera and the regions of this moment.
    ended : function
        Whether to stop waiting for a meter.
    """

    def __init__(
        self,
        meter: Meter | None,
        hands: Operator | None,
        seen: Callable[[], tuple[PageImage, Sequence[Roi]]],
        ended: Callable[[], bool],
    ) -> None:
        self.meter = meter
        self.readings: tuple[MeterReading, ...] = ()
        #: Serial port of the meter, if it has one that is a file.
        self._port = port if exists(port := getattr(meter, "port", "")) else ""
        self._hands, self._seen, self._ended = hands, seen, ended

    @property
    def lost(self) -> bool:
        """Whether the meter is unplugged, also while no reading is taken."""
        return bool(self._port) and not exists(self._port)

    def note(self, taken: ReadingSeries, region: str, known: bool = True) -> None:
        """Add what a meter of known accuracy, or not, says, with what the camera sees in the region now."""
        self.readings = (meter_reading(taken, known, region, *self._seen()), *self.readings[: _MOST_KEPT - 1])

    def enter(self, text: str, region: str, described: MeterConfiguration | None) -> None:
        """Add a reading that a person typed, of the meter whose readings the plan says are typed, or of an unknown one.

        Raises
        ------
        InputError
            If it is no luminance.
        """
        if described is None or described.entry == "serial":
            reading = typed_reading(text, MeterAccuracy(0.0, 0.0, 0), MeterIdentity("unknown", "unknown"))
            self.note(ReadingSeries((reading,)), region, known=False)
        else:
            self.note(ReadingSeries((typed_reading(text, stated_accuracy(described), described.identity),)), region)

    def take(self, meter: Meter, region: str, n: int) -> Iterator[str]:
        """Take n readings in a region; yield what is waited for, or why there is no reading."""
        try:
            # One that did not come back in time was closed.
            meter.open()
            if self._hands is not None and region:
                self._hands.point_meter(region)
            taken: list[Reading] = []
            while len(taken) < n:
                try:
                    taken.append(meter.measure())
                except MeterLostError as error:
                    yield f"The meter is lost and waited for: {error}"
                    self._reopen(meter, error)
            self.note(ReadingSeries(tuple(taken)), region)
            yield ""
        except LabcdpError as error:
            yield f"No reading: {error}"

    def _reopen(self, meter: Meter, lost: MeterLostError) -> None:
        """Wait for a meter that was unplugged; raises `lost` if it does not come back."""
        until_s = monotonic() + _METER_S
        while monotonic() < until_s and not self._ended():
            meter.close()
            sleep(_PAUSE_S)
            with suppress(MeterError):
                meter.open()
                return
        raise lost
