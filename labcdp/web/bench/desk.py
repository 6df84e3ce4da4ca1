"""The meter at the live bench: readings of it, or typed ones of another."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from math import hypot
from os.path import exists
from time import monotonic, sleep

from ...acquire import Operator
from ...core.errors import InputError, LabcdpError
from ...core.reading import MeterIdentity, Reading, ReadingSeries
from ...core.roi import Roi
from ...drivers.manual import MeterAccuracy, parse_written, reading_of, stated_accuracy
from ...drivers.meter import Meter, MeterError, MeterLostError
from ...drivers.minolta.models import DRIVERS
from ...metrics.region import measure_region
from ...session import MeterConfiguration, Session, SessionConfiguration
from ..regions.measurements import is_saturated
from ..regions.page_image import PageImage
from .day_log import DayLog, MeterReading

#: Longest wait for a meter that was unplugged, and pause between two attempts.
_METER_S, _PAUSE_S = 60.0, 0.5
#: Highest luminance that any meter shows (Konica Minolta LS-160 at 1/3 degree: 9 999 000 cd/m²).
_MOST_CD_M2 = 1e7


@dataclass(frozen=True)
class BenchOfPage:
    """Devices on the bench beside the camera.

    Parameters
    ----------
    meter : Meter or None
        Open.
    plan : SessionConfiguration or None
        Configuration of the session to record.
    hands : Operator or None
        The simulated bench, which does what a person does at a real one.
    begun : function of a session
        Records in a new session what the devices are.
    """

    meter: Meter | None = None
    plan: SessionConfiguration | None = None
    hands: Operator | None = None
    begun: Callable[[Session], None] = lambda _session: None


def meter_reading(
    taken: ReadingSeries,
    origin: str,
    known: bool,
    region: str,
    time: datetime,
    image: PageImage,
    rois: Sequence[Roi],
) -> MeterReading:
    """Return a record of a meter's reading, with the luminance that the calibrated camera sees in the region now."""
    camera, camera_u, saturated = None, None, False
    for roi in rois:
        if roi.name == region and image.unit == "cd/m^2":
            light = measure_region(image.pixels(roi))
            saturated = is_saturated(light)
            camera, camera_u = (None, None) if saturated else (light.mean, light.u)
    mean = taken.mean_cd_m2
    u = hypot(taken.standard_uncertainty_random_cd_m2, taken.standard_uncertainty_common_rel * mean)
    n, scatter = len(taken.readings), taken.scatter_rel if len(taken.readings) > 1 else None
    return MeterReading(time, origin, mean, region, camera, u if known else None, camera_u, n, scatter, saturated)


def _require_shown(luminance_cd_m2: float, described: MeterConfiguration | None) -> None:
    """Refuse a luminance that no meter, or not this one, can show; 0 is shown in the dark."""
    low, high, which = 0.0, _MOST_CD_M2, "luminance meters show"
    driver = None if described is None else DRIVERS.get(described.model)
    if described is not None and described.certificate is not None and described.certificate.range_cd_m2:
        (low, high), which = described.certificate.range_cd_m2, f"the certificate of the {described.model} covers"
    elif driver is not None:
        sheet = driver.data_sheet
        low, high = min(sheet.slow_range_cd_m2[0], sheet.fast_range_cd_m2[0]), sheet.fast_range_cd_m2[1]
        which = f"the {sheet.model} shows"
    if not low <= luminance_cd_m2 <= high:
        raise InputError(f"{luminance_cd_m2:.12g} cd/m²: {which} {low:.12g} to {high:.12g} cd/m²")


def name_of(meter: MeterIdentity) -> str:
    """Return model and serial number."""
    return f"{meter.model} {meter.serial}"


class MeterDesk:
    """A meter, and its readings in the log of the day.

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
    log : DayLog
        Where readings are kept.
    """

    def __init__(
        self,
        meter: Meter | None,
        hands: Operator | None,
        seen: Callable[[], tuple[PageImage, Sequence[Roi]]],
        ended: Callable[[], bool],
        log: DayLog,
    ) -> None:
        self.meter, self.log = meter, log
        #: Serial port of the meter, if it has one that is a file.
        self._port = port if exists(port := getattr(meter, "port", "")) else ""
        self._hands, self._seen, self._ended = hands, seen, ended

    @property
    def lost(self) -> bool:
        """Whether the meter is unplugged, also while no reading is taken."""
        return bool(self._port) and not exists(self._port)

    @property
    def last(self) -> MeterReading | None:
        """The newest reading that was not deleted."""
        return next((reading for _, reading in self.log.readings), None)

    def note(self, taken: ReadingSeries, origin: str, region: str, known: bool = True) -> None:
        """Add a reading, with the luminance that the camera sees in the region now."""
        self.log.add(meter_reading(taken, origin, known, region, self.log.time(), *self._seen()))

    def enter(self, text: str, region: str, described: MeterConfiguration | None) -> None:
        """Add a reading that a person typed, of the meter whose readings the plan says are typed, or of an unknown one.

        Raises
        ------
        InputError
            If it is no luminance, or none that the meter can show.
        """
        by_hand = described is not None and not described.is_connected
        known = described if by_hand and described is not None else None
        identity = MeterIdentity("unknown", "unknown") if known is None else known.identity
        accuracy = MeterAccuracy(0.0, 0.0, 0) if known is None else stated_accuracy(known)
        written = parse_written(text, comma_is_decimal=True)
        reading = reading_of(written, written.unit or "cd/m2", accuracy, identity, datetime.now(UTC), text)
        _require_shown(reading.luminance_cd_m2, known)
        origin = "typed" if known is None else f"typed, {name_of(identity)}"
        self.note(ReadingSeries((reading,)), origin, region, known=known is not None)

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
                    yield f"The meter is lost; waiting for it: {error}"
                    self._reopen(meter, error)
            self.note(ReadingSeries(tuple(taken)), name_of(meter.identity), region)
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
