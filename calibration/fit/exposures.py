"""Exposure times that the patches contradict, corrected."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ...core.errors import CalibrationError
from ..converter import EXPOSURE_TIME
from ..exposure_times import ExposureTimes
from .design import Array, Design, SharedError
from .selection import Found

#: Source of the error of an offset.
OFFSET = "exposure offset"
#: Of observations that contradict each other so far that no exposure times, or no numbers, are left.
NO_MODEL = (
    "no model fits patches and exposures: check that each frame has its own exposure time (recorded, and as the camera "
    "states it), and that readings and frames belong to the same patches; of a camera with a tone curve (gamma) find "
    "the response by a bracket (labcdp calibrate --response debevec)"
)


def with_times(design: Design, found: Iterable[Found]) -> tuple[Design, ExposureTimes]:
    """Correct exposure times by what was found of them, whose uncertainties are common errors.

    Where no two exposures agree, nothing says which is as stated: the deviations are an error of all luminances, too.

    Parameters
    ----------
    design : Design
        The observations.
    found : iterable of Found
        Effects, also of other kinds.

    Raises
    ------
    CalibrationError
        If an exposure would last no time.
    """
    times, stated = ExposureTimes(), design.exposures_s[design.exposure]
    factor: Array = np.ones_like(stated)
    errors = list(design.shared)
    for one in found:
        value, uncertainty = one.assessed.value, one.assessed.uncertainty
        if one.effect.kind == "exposure" and value <= -1:
            raise CalibrationError(NO_MODEL)
        if one.effect.kind == "exposure offset":
            times = replace(times, offset_s=value, offset_u_s=uncertainty)
            factor = factor + value / stated
            errors.append(SharedError(OFFSET, uncertainty / stated))
        elif one.effect.kind == "exposure":
            exposure_s = float(design.exposures_s[one.effect.number])
            times = replace(times, deviations=(*times.deviations, (exposure_s, value, uncertainty)))
            own = stated == exposure_s
            factor = factor + np.where(own, value, 0.0)
            errors.append(SharedError(EXPOSURE_TIME, np.where(own, uncertainty, 0.0)))
    deviations = [deviation for _, deviation, _ in times.deviations]
    if deviations and len(deviations) >= design.exposures_s.size - 1:
        errors.append(SharedError(EXPOSURE_TIME, float(np.sqrt(np.mean(np.square(deviations))))))
    signals = replace(design.signals, scale_per_s=design.signals.scale_per_s / factor)
    return replace(design, signals=signals, shared=tuple(errors)), times
