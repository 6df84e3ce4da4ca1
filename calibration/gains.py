"""Properties of each gain: factor of the responsivity, dark signal and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..core.errors import CalibrationError
from .dark.signal import DarkModel
from .frames.observations import GAIN_TOLERANCE_DB
from .noise import TemporalNoise


@dataclass(frozen=True)
class GainSetting:
    """Properties of a gain.

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
    """Index of a gain among settings; raises CalibrationError, naming the calibrated ones, if not found."""
    for index, setting in enumerate(settings):
        if abs(setting.gain_db - gain_db) <= GAIN_TOLERANCE_DB:
            return index
    known = " or ".join(f"{setting.gain_db:g} dB" for setting in settings)
    raise CalibrationError(f"the calibration is for a gain of {known}, not {gain_db:g} dB: calibrate this gain too")
