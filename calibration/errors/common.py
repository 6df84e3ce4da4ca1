"""Common errors of a calibration, each an unknown factor times a known pattern."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import ArrayLike

from ...core.luminance import CommonError
from ..gains import index_of_gain
from ..model import Calibration

#: Standard uncertainty of one exposure time relative to the others, and least relative one. Cameras report the applied
#: exposure (GenICam SFNC, ExposureTime), a multiple of the sensor's clock: 0.05 us are a few periods of tens of MHz,
#: which start and end of an exposure jitter by. Larger errors make the exposures inconsistent, and the fit includes
#: them as scatter.
EXPOSURE_TIME_S, EXPOSURE_TIME_REL = 5e-8, 5e-5
#: Source of errors by flicker of the light, common to all patches of the same frames.
FLICKER = "lamp flicker"
#: Source of the error by glare of unknown size, where the fit found some.
GLARE = "glare"
#: Source of the error by setting focus and aperture anew.
REFOCUS = "focus and aperture"


def exposure_time_rel(exposure_s: float) -> float:
    """Relative standard uncertainty of an exposure time."""
    return max(EXPOSURE_TIME_REL, EXPOSURE_TIME_S / exposure_s)


def common_errors(
    calibration: Calibration,
    net_dn: ArrayLike,
    exposure_s: float,
    gain_db: float | None = None,
    temperature_c: float | None = None,
) -> tuple[CommonError, ...]:
    """Mutually independent errors common to the luminances of one frame, as signed patterns.

    Those of meter, lens and exposure time, and of the fit one for each eigenvector of a covariance. In a contrast of
    two luminances the difference of their patterns remains. Number and order are the same for all frames of one gain.

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
        `relative` has the shape of `net_dn`, or is a number. It changes sign with the signal and is infinite at zero.

    Raises
    ------
    CalibrationError
        If the gain was not calibrated.
    """
    n = np.asarray(net_dn, dtype=float)
    index = index_of_gain(calibration.settings, calibration.state.gain_db if gain_db is None else gain_db)
    setting = calibration.settings[index]
    scale = calibration.meter_scale
    errors = [
        CommonError("meter scale", scale.standard_uncertainty_rel, rectangular=scale.certificate is None),
        *((CommonError("meter f1'", scale.mismatch_rel, rectangular=True),) if scale.mismatch_rel else ()),
        *((CommonError(REFOCUS, calibration.lens.refocus_rel),) if calibration.lens.refocus_rel else ()),
        CommonError("exposure time", exposure_time_rel(exposure_s)),
    ]
    with np.errstate(divide="ignore"):
        by_dark_dn = -calibration.response.slope(n) / calibration.response.linearise(n)
    if calibration.responsivity.glare_cd_m2:
        per_light = calibration.responsivity.responsivity_dn_s_cd_m2 * setting.factor * exposure_s
        with np.errstate(divide="ignore"):
            relative = calibration.responsivity.glare_cd_m2 * per_light / calibration.response.linearise(n)
        errors.append(CommonError(GLARE, relative))
    sensitivities = setting.dark.sensitivities(exposure_s, temperature_c)
    for error in calibration.fit_errors:
        gain_rel = error.gain_rel[index - 1] if index and error.gain_rel else 0.0
        relative = np.interp(n, error.net_dn, error.relative) + gain_rel
        if error.dark and error.dark_gain_db == setting.gain_db:
            relative = relative + by_dark_dn * float(sensitivities @ np.array(error.dark))
        errors.append(CommonError(error.source, relative, dof=error.dof or inf))
    return tuple(errors)
