"""Exposure times as a camera applies them, where a calibration has found them to differ from those that it states."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import hypot

from ..core.errors import InputError, require_not_negative

#: Relative difference up to which two exposures are one.
_SAME_REL = 1e-3


@dataclass(frozen=True)
class ExposureTimes:
    """Applied exposure times: stated ones, with an offset common to all, or a deviation of some.

    Parameters
    ----------
    offset_s, offset_u_s : float
        Added to each stated exposure, with its standard uncertainty.
    deviations : tuple of (float, float, float)
        Stated exposure in s, its relative deviation, and the standard uncertainty of that.
    either_rel : float
        Relative standard uncertainty of the responsivity, and of other exposures than the calibrated ones, where others
        may deviate as well: at those, responsivity times exposure is what the patches show.

    Raises
    ------
    InputError
        If an uncertainty is negative, or a deviation -1 or less.

    Examples
    --------
    >>> times = ExposureTimes(offset_s=50e-6)
    >>> round(1e3 * times.applied_s(1e-3), 6)
    1.05
    """

    offset_s: float = 0.0
    offset_u_s: float = 0.0
    deviations: tuple[tuple[float, float, float], ...] = ()
    either_rel: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(either_rel=self.either_rel)
        require_not_negative(offset_u_s=self.offset_u_s, deviations=[u for _, _, u in self.deviations])
        if any(deviation <= -1 for _, deviation, _ in self.deviations):
            raise InputError("an exposure would last no time: give relative deviations above -1")

    def applied_s(self, exposure_s: float) -> float:
        """Return the exposure time that a stated one has; never below a hundredth of it."""
        return max(exposure_s * (1 + self._deviation(exposure_s)[0]) + self.offset_s, exposure_s / 100)

    def offset_u_rel(self, exposure_s: float) -> float:
        """Relative standard uncertainty by the offset: an error of all exposures with one sign."""
        return self.offset_u_s / self.applied_s(exposure_s)

    def u_rel(self, exposure_s: float, jitter_rel: float, calibrated_s: Iterable[float]) -> float:
        """Relative standard uncertainty of one exposure by its own deviation, by jitter and by that of all."""
        either_rel = 0.0 if any(_same(exposure_s, other_s) for other_s in calibrated_s) else self.either_rel
        return hypot(self._deviation(exposure_s)[1], jitter_rel, either_rel)

    def more_uncertain(self, exposure_s: float, u_rel: float) -> ExposureTimes:
        """Return times of which one has a further relative standard uncertainty."""
        deviation, known = self._deviation(exposure_s)
        others = (deviation for deviation in self.deviations if not _same(exposure_s, deviation[0]))
        return replace(self, deviations=(*others, (exposure_s, deviation, hypot(known, u_rel))))

    def _deviation(self, exposure_s: float) -> tuple[float, float]:
        known = [(rel, u) for t, rel, u in self.deviations if _same(exposure_s, t)]
        return known[0] if known else (0.0, 0.0)


def _same(exposure_s: float, other_s: float) -> bool:
    return abs(exposure_s / other_s - 1) <= _SAME_REL


#: Exposure times that are as the camera states them.
AS_STATED = ExposureTimes()
