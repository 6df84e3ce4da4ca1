"""What differs from gain to gain: factor of the responsivity, darkness and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import CalibrationError
from .dark import DarkModel
from .noise import TemporalNoise
from .observations import GAIN_TOLERANCE_DB


@dataclass(frozen=True)
class GainSetting:
    """What differs from gain to gain.

    Parameters
    ----------
    gain_db : float
        The gain.
    factor, factor_random_rel : float
        Responsivity over that at the calibration's own gain, and its relative standard uncertainty.
    dark : DarkModel
        d(t, T) at this gain.
    noise : TemporalNoise
        Noise of a pixel at this gain.
    """

    gain_db: float
    factor: float
    factor_random_rel: float
    dark: DarkModel
    noise: TemporalNoise


def index_of_gain(settings: Sequence[GainSetting], gain_db: float) -> int:
    """Place of a gain among settings; raises CalibrationError, naming the calibrated ones, if it is not there."""
    for index, setting in enumerate(settings):
        if abs(setting.gain_db - gain_db) <= GAIN_TOLERANCE_DB:
            return index
    known = " or ".join(f"{setting.gain_db:g} dB" for setting in settings)
    raise CalibrationError(f"the calibration is for a gain of {known}, not {gain_db:g} dB: calibrate this gain too")
