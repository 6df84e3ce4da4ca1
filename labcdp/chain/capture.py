"""Capture: one exposure of a sensor in digital numbers, with its inverse; and the protocol of sensor models."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from .exposure import ExposureSettings
from .signal import Context, Signal


@dataclass(frozen=True, eq=False)
class Capture:
    """One exposure, or several merged into one, in digital numbers.

    Parameters
    ----------
    dn : ndarray, shape (height, width)
        Digital numbers; whole, or not for some merges.
    exposure_s : float
        Exposure time in seconds; of a merge, that of the exposure whose scale it has.
    black_level_dn : float
        DN of dark signal without dark current; 0 for a merge.
    dark_dn : float
        Mean DN of dark signal at this exposure and temperature, black level and dark current included.
    dn_per_lx : float
        Slope of the mean DN over the illuminance on the pixel.
    saturation_dn : float
        DN from which a pixel counts as saturated.
    k_dn_per_e : float
        Overall system gain, DN per electron.
    dark_noise_dn : float
        Standard deviation of the temporal noise at zero exposure, DN.
    """

    dn: NDArray[Any]
    exposure_s: float
    black_level_dn: float
    dark_dn: float
    dn_per_lx: float
    saturation_dn: float
    k_dn_per_e: float
    dark_noise_dn: float

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Which pixels are saturated, shape (height, width)."""
        return self.dn >= self.saturation_dn

    def illuminance_lx(self, dn: NDArray[Any]) -> NDArray[np.floating[Any]]:
        """Illuminance in lux from digital numbers of this exposure, shape as `dn`; noise may make it negative."""
        return (np.asarray(dn, dtype=np.float32) - np.float32(self.dark_dn)) / np.float32(self.dn_per_lx)


@runtime_checkable
class SensorModel(Protocol):
    """Protocol of sensor models: frozen dataclasses of their parameters with these members."""

    @property
    def pixel_pitch_m(self) -> float:
        """Distance of pixel centres in metres."""

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""

    def capture(self, signal: Signal, context: Context, index: int) -> Capture:
        """Take one exposure.

        Parameters
        ----------
        signal : Signal
            Illuminance on each pixel in lux.
        context : Context
            Spectrum, seed and settings.
        index : int
            Which of the exposures of the settings; the noise of each is its own.

        Raises
        ------
        InputError
            If the signal has another shape than the sensor, or the context no settings.
        """


def digital_signal(capture: Capture, before: Signal) -> Signal:
    """Return the digital numbers of a capture as a signal; `before` is the illuminance that was exposed."""
    # The numbers themselves are not kept alive twice by the inverse.
    without_dn = replace(capture, dn=capture.dn[:0])
    return replace(
        before,
        values=capture.dn,
        quantity="digital number",
        to_luminance=partial(_luminance_of_dn, without_dn, before),
        saturated=capture.saturated,
    )


def _luminance_of_dn(capture: Capture, before: Signal, dn: NDArray[Any]) -> NDArray[Any]:
    return before.to_luminance(capture.illuminance_lx(dn))


def check_shape(signal: Signal, shape: tuple[int, int]) -> None:
    """Refuse a signal that has not one value for each pixel of a sensor; raises InputError."""
    if signal.values.shape != shape:
        raise InputError(
            f"the scene has the shape {signal.values.shape}, the sensor has {shape}: give both the same "
            "width and height"
        )


def settings_of(context: Context) -> ExposureSettings:
    """Return the exposure settings; raises InputError without any."""
    if context.settings is None:
        raise InputError("no exposure is set: add exposure_s, one time in s or several")
    return context.settings
