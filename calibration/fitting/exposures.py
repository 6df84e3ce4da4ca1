"""Exposure times that the patches contradict, corrected."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import hypot, sqrt

import numpy as np

from ...core.errors import CalibrationError
from ..camera import EXPOSURE_TIME
from ..exposure_times import ExposureTimes
from .design import Design, SharedError
from .effects import FittedEffect
from .selection import time_factor, with_times_of

#: Source of the error of an offset.
OFFSET = "exposure offset"
#: Of observations that contradict each other so far that no exposure times, or no numbers, are left.
NO_MODEL = (
    "no model fits patches and exposures: check that each frame has its own exposure time (recorded, and as the camera "
    "states it), and that readings and frames belong to the same patches; of a camera with a tone curve (gamma) find "
    "the response by a bracket (labcdp calibrate --response debevec)"
)


def with_times(design: Design, fitted_effects: Iterable[FittedEffect]) -> tuple[Design, ExposureTimes]:
    """Correct exposure times by what was found of them, whose uncertainties are common errors.

    Where others explain the observations as well, nothing says which are as stated.

    Parameters
    ----------
    design : Design
        The observations.
    found : iterable of FittedEffect
        Effects, also of other kinds.

    Raises
    ------
    CalibrationError
        If an exposure would last no time.
    """
    fitted_effects = [fitted for fitted in fitted_effects if fitted.effect.changes_times]
    times = ExposureTimes()
    errors = list(design.shared)
    factor = time_factor(design, fitted_effects)
    for fitted in fitted_effects:
        value, uncertainty = fitted.value, fitted.uncertainty
        if fitted.effect.kind == "exposure" and value <= -1:
            raise CalibrationError(NO_MODEL)
        relative = uncertainty * fitted.effect.around(factor).errors[0].relative
        if fitted.effect.kind == "exposure offset":
            times = replace(times, offset_s=value, offset_u_s=uncertainty)
            errors.append(SharedError(OFFSET, relative))
        else:
            exposure_s = float(design.exposures_s[fitted.effect.number])
            times = replace(times, deviations=(*times.deviations, (exposure_s, value, uncertainty / (1 + value))))
            errors.append(SharedError(EXPOSURE_TIME, relative))
        if any(rival.effect.changes_times for rival in fitted.rivals):
            # None or all of it is an error of the responsivity, with equal probabilities.
            without = time_factor(design, [other for other in fitted_effects if other is not fitted])
            either_rel = float(np.ptp(np.log(factor / without))) / sqrt(2)
            times = replace(times, either_rel=hypot(times.either_rel, either_rel))
    return replace(with_times_of(design, fitted_effects), shared=tuple(errors)), times
