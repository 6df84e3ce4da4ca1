"""A sensor with its settings and what is made of its exposures: all that fixes the values of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import hypot

import numpy as np

from ...core.errors import InputError
from ..hdr import ExposureLadder, Hdr
from ..isp import ToneCurve
from ..sensor import Sensor
from ..signal import ExposureSettings
from .readout import Readout


@dataclass(frozen=True)
class CameraModel:
    """Sensor, exposures, merge and tone curve.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    settings : ExposureSettings
        How it is exposed.
    hdr : Hdr or None
        How the exposures are merged; None for a single one.
    tone_curve : ToneCurve or None
        Encodes the merged DN, or the DN of a single exposure with its black level. The code is decoded again.

    Raises
    ------
    InputError
        If there are several exposures without `hdr`.
    """

    sensor: Sensor
    settings: ExposureSettings
    hdr: Hdr | None = None
    tone_curve: ToneCurve | None = None

    def __post_init__(self) -> None:
        count = len(self.settings.exposure_s)
        if self.hdr is None and count > 1:
            raise InputError(f"there are {count} exposures and nothing merges them: give one exposure, or an Hdr")

    @cached_property
    def exposures_s(self) -> tuple[float, ...]:
        """Exposure times in seconds, longest first."""
        return tuple(sorted(self.settings.exposure_s, reverse=True))

    @property
    def k_dn_per_e(self) -> float:
        """Overall system gain at the gain of the settings."""
        return self.sensor.system_gain_dn_per_e(self.settings.gain_db)

    @property
    def offset_spread_e(self) -> float:
        """Standard deviation of the offsets over pixels, columns and rows, electrons."""
        return hypot(self.sensor.dsnu_e, self.sensor.column_dsnu_e, self.sensor.row_dsnu_e)

    def readout(self, *, all_pixels: bool) -> Readout:
        """Readout of all pixels, whose offsets are noise, or of one whose fixed pattern is known."""
        one, offsets_e = self.sensor, self.offset_spread_e if all_pixels else 0.0
        noise_e = hypot(one.read_noise_e, offsets_e)
        return Readout(float(np.float32(one.full_well_e)), self.k_dn_per_e, one.black_level_dn, one.bits, noise_e)

    @property
    def dn_per_e_s(self) -> float:
        """Slope of the mean DN over the rate of photo-electrons: K times the longest exposure."""
        return self.k_dn_per_e * self.exposures_s[0]

    @property
    def dark_e_s(self) -> float:
        """Mean dark current at the temperature of the settings, electrons per second."""
        return self.sensor.dark_current_at(self.settings.temperature_c)

    @property
    def dark_dn(self) -> float:
        """Mean DN of dark signal, on the scale of the values."""
        black_dn = self.sensor.black_level_dn if self.hdr is None else 0.0
        return black_dn + self.dark_e_s * self.dn_per_e_s

    @property
    def saturation_dn(self) -> float:
        """DN before the tone curve from which a pixel counts as saturated."""
        gain_db = self.settings.gain_db
        limit = self.sensor.saturation_dn(gain_db) if self.hdr is None else self.hdr.saturation_dn(self.ladder)
        return limit if self.tone_curve is None else min(limit, self.tone_curve.top_dn)

    @cached_property
    def ladder(self) -> ExposureLadder:
        """The exposures for merging."""
        net_dn = self.sensor.saturation_dn(self.settings.gain_db) - self.sensor.black_level_dn
        return ExposureLadder(self.exposures_s, net_dn, self.k_dn_per_e)
