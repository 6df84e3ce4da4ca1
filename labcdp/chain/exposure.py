"""How a sensor is exposed: times, gain and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.errors import InputError
from .parameters import check_number


@dataclass(frozen=True)
class ExposureSettings:
    """One exposure, or a bracket of several of the same scene.

    Parameters
    ----------
    exposure_s : float or sequence of float
        Exposure time in seconds, or several different ones. Held as a tuple.
    gain_db : float
        Analogue gain in dB.
    temperature_c : float
        Temperature of the sensor in degrees Celsius.

    Raises
    ------
    InputError
        If no time is given, one is not above 0, two are equal, or another value is out of its range.
    """

    exposure_s: tuple[float, ...]
    gain_db: float = 0.0
    temperature_c: float = 25.0

    def __post_init__(self) -> None:
        given: Any = self.exposure_s
        given = given.tolist() if isinstance(given, np.ndarray) else given
        times = tuple(given) if isinstance(given, Sequence) and not isinstance(given, str) else (given,)
        if not times:
            raise InputError("exposure_s is empty: give one exposure time in s, or several")
        for time in times:
            check_number("exposure_s", time, "s", 1e-9, 3600)
        if len(set(times)) < len(times):
            raise InputError(f"exposure_s has the times {list(times)} s, of which two are equal: give each time once")
        check_number("gain_db", self.gain_db, "dB", -100, 100)
        check_number("temperature_c", self.temperature_c, "degC", -100, 200)
        object.__setattr__(self, "exposure_s", tuple(float(time) for time in times))
