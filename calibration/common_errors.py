"""Errors that all luminances of one calibration share, each an unknown number times a known pattern."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..luminance import CommonError
from .gains import index_of_gain

if TYPE_CHECKING:
    from .model import Calibration

#: Relative standard uncertainty of one exposure time against the others. Cameras report the exposure they applied
#: (GenICam SFNC, ExposureTime), a multiple of the sensor's clock: 0.05 us in 1 ms are a few periods of tens of MHz. A
#: camera that is worse shows it: its exposures contradict each other, and the fit takes that up as scatter.
EXPOSURE_TIME_REL = 5e-5


@dataclass(frozen=True)
class FitError:
    """One independent error of a fit, for one standard uncertainty.

    An error of the darkness acts twice: on the frames that are converted, by `dark`, and on the fit, by `relative`.

    Parameters
    ----------
    source : str
        ``fit``, ``gain``, ``linearity`` or ``dark and temperature``.
    net_dn : tuple of float
        Signals above dark, ascending.
    relative : tuple of float
        Relative error of the luminance at these signals, at the calibration's own gain; straight lines between.
    gain_rel : tuple of float
        What is added at each further gain, in their order.
    dark : tuple of float
        Errors of the dark model's offset_dn, rate_dn_s and 1 / T_d at the gain `dark_gain_db`; empty for none.
    dark_gain_db : float or None
        Gain of that dark model.
    """

    source: str
    net_dn: tuple[float, ...]
    relative: tuple[float, ...]
    gain_rel: tuple[float, ...] = ()
    dark: tuple[float, ...] = ()
    dark_gain_db: float | None = None


def common_errors(
    calibration: Calibration,
    net_dn: ArrayLike,
    exposure_s: float,
    gain_db: float | None = None,
    temperature_c: float | None = None,
) -> tuple[CommonError, ...]:
    """Independent errors that the luminances of one frame share, as signed patterns.

    ``meter scale`` (rectangular), ``exposure time``, and those of the fit: ``fit``, ``gain``, ``linearity`` and ``dark
    and temperature``, one for each eigenvector of a covariance. In a contrast of two luminances the difference of their
    patterns is left. Number and order of the errors are the same for all frames of one gain.

    Parameters
    ----------
    calibration : Calibration
        Of these frames.
    net_dn : array_like of float, any shape
        DN above dark at the pixels, V not removed.
    exposure_s : float
        Exposure time.
    gain_db : float or None
        Gain; None for the calibration's own.
    temperature_c : float or None
        Temperature of the frame; None for that of the dark frames.

    Returns
    -------
    tuple of CommonError
        `relative` has the shape of `net_dn`, or is a number. At or below zero signal the pattern is that of the same
        absolute error, so it changes sign with the signal and is infinite at zero.

    Raises
    ------
    CalibrationError
        If the gain was not calibrated.
    """
    n = np.asarray(net_dn, dtype=float)
    index = index_of_gain(calibration.settings, calibration.state.gain_db if gain_db is None else gain_db)
    setting = calibration.settings[index]
    errors = [
        CommonError("meter scale", calibration.meter_scale.half_width_rel / sqrt(3), rectangular=True),
        CommonError("exposure time", EXPOSURE_TIME_REL),
    ]
    with np.errstate(divide="ignore"):
        by_dark_dn = -calibration.response.slope(n) / calibration.response.linearise(n)
    sensitivities = setting.dark.sensitivities(exposure_s, temperature_c)
    for error in calibration.fit_errors:
        gain_rel = error.gain_rel[index - 1] if index and error.gain_rel else 0.0
        relative = np.interp(n, error.net_dn, error.relative) + gain_rel
        if error.dark and error.dark_gain_db == setting.gain_db:
            relative = relative + by_dark_dn * float(sensitivities @ np.array(error.dark))
        errors.append(CommonError(error.source, relative))
    return tuple(errors)
