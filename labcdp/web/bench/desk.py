"""The meter at the live bench: readings of it, or typed ones of another."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from time import monotonic, sleep

from ...acquire import Operator
from ...core.errors import LabcdpError
from ...core.reading import Reading, ReadingSeries
from ...core.roi import Roi
from ...drivers.meter import Meter, MeterError, MeterLostError
from ..regions.page_image import PageImage
from .measured import MeterReading, meter_reading

#: Longest wait for a meter that was unplugged, and pause between two attempts.
_METER_S, _PAUSE_S = 60.0, 0.5
#: Readings that are kept.
_MOST_KEPT = 20


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
        self._hands, self._seen, self._ended = hands, seen, ended

    def note(self, taken: ReadingSeries | float, region: str) -> None:
        """Add what the meter says, or a person typed, with what the camera sees in the region now."""
        self.readings = (meter_reading(taken, region, *self._seen()), *self.readings[: _MOST_KEPT - 1])

    def take(self, meter: Meter, region: str, n: int) -> Iterator[str]:
        """Take n readings in a region; yield what is waited for, or why there is no reading."""
        try:
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
