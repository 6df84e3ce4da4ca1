"""A calibrated camera: its DN as cd/m^2, and the errors that its luminances have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import hypot, inf, sqrt
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.dn import Response
from ..core.errors import InputError, require_not_negative
from ..core.frame import Frame
from ..core.luminance import CommonError
from ..core.vignetting import AnyVignetting, Cos4Vignetting, FlatField, cropped
from ..session.tables import EXPOSURE_JITTER_S
from .exposure_times import AS_STATED, ExposureTimes
from .fit_records import FitError, ResponsivityFit
from .frames.defects import DefectMap
from .frames.nonuniformity import slow_rel
from .frames.observations import CameraState
from .sensor.dark import DarkModel
from .sensor.dark_library import DarkLibrary
from .sensor.noise import GainSetting, TemporalNoise, find_gain
from .setup import METER_SOURCES, LensIdentity, MeterScale

#: Least relative standard uncertainty of one exposure time relative to the others. Cameras report the applied exposure
#: (GenICam SFNC, ExposureTime). Larger errors make the exposures inconsistent, and the fit includes them as scatter.
EXPOSURE_TIME_REL = 5e-5
#: Sources of common errors: flicker of the light and drift of the black level, common to all patches of the same
#: frames; an intercept, where the fit found some; setting focus and aperture anew; another day; vignetting that is
#: assumed, or measured by a flat field; a temperature of the camera that is not stated.
OF_FRAMES = FLICKER, BLACK_LEVEL = "lamp flicker", "black level"
INTERCEPT, DARK_OFFSET, REFOCUS, STABILITY = "intercept", "dark offset", "focus and aperture", "stability"
VIGNETTING, FLAT_FIELD = "vignetting", "flat field"
TEMPERATURE, EXPOSURE_TIME = "unknown temperature", "exposure time"

#: Relative standard uncertainty of the responsivity by kelvin: limits of 0.1 % to either side, as of good photometers
#: (DIN 5032-7, class L).
_REL_PER_K = 0.001 / sqrt(3)
#: Cached, as each frame of a part of the sensor asks for the same.
_cropped_vignetting = lru_cache(maxsize=8)(cropped)


def exposure_time_rel(exposure_s: float, jitter_s: float) -> float:
    """Relative standard uncertainty of an exposure time whose start and end jitter."""
    return max(EXPOSURE_TIME_REL, jitter_s / exposure_s)


def vignetting_source(vignetting: AnyVignetting | None) -> str:
    """Source of the errors that depend on the place in the image."""
    return VIGNETTING if isinstance(vignetting, Cos4Vignetting) else FLAT_FIELD


@dataclass(frozen=True, kw_only=True)
class CalibratedCamera:
    """DN to cd/m^2 for one camera, setting and lens: h(DN - d(t, T)) = R t V(x, y) L.

    Parameters
    ----------
    state : CameraState
        Camera, pixel format, bit depth, image size and gain it is valid for.
    lens : LensIdentity
        The lens.
    meter_scale : MeterScale
        The meter, its certificate or data sheet, and the error that is common to all luminances.
    responsivity : ResponsivityFit
        R.
    response : Response
        Linearisation h of the DN above dark.
    fit_errors : tuple of FitError
        Independent errors of R, h, the gains and the dark signal; see `labcdp.calibration.common_errors`.
    dark : DarkModel
        d(t, T) at the calibration's own gain, `state.gain_db`.
    noise : TemporalNoise
        Noise of a pixel at this gain.
    gains : tuple of GainSetting
        The other gains it is valid for too; empty for one gain.
    vignetting : AnyVignetting or None
        V, None for 1.
    defects : DefectMap or None
        Pixels that must not be used.
    dark_library : DarkLibrary or None
        Dark pattern to subtract from each frame.
    range_cd_m2 : (float, float)
        Lowest and highest luminance of the patches.
    range_net_dn : (float, float)
        Lowest and highest DN above dark of the fit.
    exposures_s : tuple of float
        Exposures that were used, ascending.
    exposure_jitter_s : float
        Standard uncertainty of one exposure time relative to the others.
    exposure_times : ExposureTimes
        Where the patches have shown other exposures than the camera states.
    light_temperature_c : float or None
        Mean temperature of the camera when the patches were recorded; None if unknown.
    of_another_day : bool
        Whether it converts frames of another day than its own.
    warmer_k : float
        How much warmer the camera is in the frames that it converts.

    Raises
    ------
    InputError
        If the range is not ascending, there is no exposure, or one is not positive.
    """

    state: CameraState
    lens: LensIdentity
    meter_scale: MeterScale
    responsivity: ResponsivityFit
    response: Response
    fit_errors: tuple[FitError, ...]
    dark: DarkModel
    noise: TemporalNoise
    gains: tuple[GainSetting, ...]
    vignetting: AnyVignetting | None
    defects: DefectMap | None
    dark_library: DarkLibrary | None
    range_cd_m2: tuple[float, float]
    range_net_dn: tuple[float, float]
    exposures_s: tuple[float, ...]
    exposure_jitter_s: float = EXPOSURE_JITTER_S
    exposure_times: ExposureTimes = AS_STATED
    light_temperature_c: float | None = None
    of_another_day: bool = False
    warmer_k: float = 0.0

    def __post_init__(self) -> None:
        low, high = self.range_cd_m2
        if not 0 < low <= high < float("inf"):
            raise InputError(f"range_cd_m2 is {low:g} to {high:g}: give two positive luminances, the lower first")
        if not self.exposures_s:
            raise InputError("a calibration has at least one exposure in exposures_s")
        if min(self.exposures_s) <= 0:
            raise InputError(f"exposures_s has {min(self.exposures_s):g} s: give times above 0 s")
        require_not_negative(exposure_jitter_s=self.exposure_jitter_s)

    @property
    def stability_rel(self) -> float:
        """Relative standard uncertainty of the responsivity by another day, and by another temperature."""
        return hypot(self.lens.stability_rel if self.of_another_day else 0.0, _REL_PER_K * self.warmer_k)

    @property
    def field_rel(self) -> float:
        """Relative standard uncertainty of slow residuals of a flat field."""
        return slow_rel(self.vignetting)

    def pixel_rel(self, gain_db: float | None = None) -> float:
        """Relative standard uncertainty of a pixel by its own sensitivity (EMVA 1288: PRNU), the same in all frames.

        That is what the patches show, of which a flat field leaves its noise. None for the calibration's own gain.
        """
        noise = self.noise if gain_db is None else self.setting(gain_db).noise
        return max(noise.prnu_rel, self.vignetting.random_rel if isinstance(self.vignetting, FlatField) else 0.0)

    @cached_property
    def settings(self) -> tuple[GainSetting, ...]:
        """Every calibrated gain, the calibration's own first, with factor 1."""
        return (GainSetting(self.state.gain_db, 1.0, 0.0, self.dark, self.noise), *self.gains)

    def setting(self, gain_db: float) -> GainSetting:
        """Return the properties of a gain; raises CalibrationError, naming the calibrated ones, for another."""
        settings = self.settings
        return settings[find_gain(settings, gain_db)]

    def require(self, state: CameraState, theirs: str) -> None:
        """Refuse a camera state that this calibration is not valid for.

        Parameters
        ----------
        state : CameraState
            The state to check.
        theirs : str
            Name of the state in messages.

        Raises
        ------
        CalibrationError
            If it is another camera or setting, or a gain that was not calibrated.
        """
        # A frame need not know that the pixels are full below the end of its scale.
        saturation_dn = min(state.saturation_dn, self.state.saturation_dn)
        theirs_below = replace(state, saturation_dn=saturation_dn)
        self.state.require(theirs_below, "the calibration", theirs, [gain.gain_db for gain in self.gains])

    def dn_per_cd_m2(self, exposure_s: float, gain_db: float | None = None) -> float:
        """Linearised DN per cd/m^2 on the axis, R t times the factor of a gain; None for the calibration's own."""
        factor = 1.0 if gain_db is None else self.setting(gain_db).factor
        return self.responsivity.responsivity_dn_s_cd_m2 * factor * self.exposure_times.applied_s(exposure_s)

    def luminance_cd_m2(self, net_dn: ArrayLike, exposure_s: float) -> NDArray[np.float64]:
        """L V = h(n) / (R t) of pixels with a DN n above dark, any shape; V is not removed."""
        return self.response.linearise(net_dn) / self.dn_per_cd_m2(exposure_s)

    def net_dn(self, luminance_cd_m2: float, exposure_s: float) -> float:
        """DN above dark that a luminance gives on the optical axis: h(n) = R t L solved for n."""
        return float(self.response.inverse(luminance_cd_m2 * self.dn_per_cd_m2(exposure_s)))

    def dark_spread_cd_m2(self, frame: Frame) -> float:
        """Return what dark signal non-uniformity and drift of the black level make of a dark pixel's luminance."""
        dark = self.setting(frame.gain_db).dark
        dn = hypot(dark.pattern_dn(frame.exposure_s), dark.drift_dn)
        return dn * float(self.response.slope(0.0)) / self.dn_per_cd_m2(frame.exposure_s, frame.gain_db)

    def at_their_temperature(self) -> Self:
        """Return it for frames of the session of its dark frames, at whose temperature they were taken."""
        gains = tuple(replace(setting, dark=replace(setting.dark, unknown_within_k=0.0)) for setting in self.gains)
        return replace(self, dark=replace(self.dark, unknown_within_k=0.0), gains=gains)

    def in_region(self, state: CameraState) -> Self:
        """Return it for the part of the sensor that frames of a state show.

        The same where the state does not say which part, shows the whole, or has pixels that are not those of the
        calibration; `require` then judges it.
        """
        whole, part = self.state, state
        if part.readout is None or whole.readout is None or whole.image_shape == part.image_shape:
            return self
        window = part.readout.window_in(part.image_shape, whole.readout, whole.image_shape)
        if window is None:
            return self
        top, left = (axis.start for axis in window)
        return self._cropped((left, top), part)

    def _cropped(self, corner: tuple[int, int], part: CameraState) -> Self:
        whole, shape = self.state, part.image_shape
        v, defects, library = self.vignetting, self.defects, self.dark_library
        return replace(
            self,
            state=replace(whole, image_shape=shape, readout=part.readout),
            vignetting=None if v is None else _cropped_vignetting(v, whole.image_shape, corner, shape),
            defects=None if defects is None else defects.cropped(corner, shape),
            dark_library=None if library is None else library.cropped(corner, shape),
        )


def common_errors(
    calibration: CalibratedCamera,
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
    calibration : CalibratedCamera
        Of these frames.
    net_dn : array_like of float, any shape
        DN above dark at the pixels, V not removed.
    exposure_s : float
        Exposure time.
    gain_db, temperature_c : float or None
        Gain and temperature of the frame; None for the calibration's own gain, and for an unknown temperature.

    Returns
    -------
    tuple of CommonError
        `relative` has the shape of `net_dn`, or is a number. It changes sign with the signal and is infinite at zero.

    Raises
    ------
    CalibrationError
        If the gain was not calibrated.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp import Session
    >>> from labcdp.calibration import common_errors
    >>> from labcdp.session import example_session
    >>> calibration = Session.open(example_session()).calibrate().calibration
    >>> errors = common_errors(calibration, np.array([100.0, 1000.0]), exposure_s=0.01)
    >>> errors[0].source, float(np.ravel(errors[0].relative)[0]) > 0
    ('meter scale', True)
    """
    n = np.asarray(net_dn, dtype=float)
    index = find_gain(calibration.settings, calibration.state.gain_db if gain_db is None else gain_db)
    setting = calibration.settings[index]
    scale, times = calibration.meter_scale, calibration.exposure_times
    jitter_rel = exposure_time_rel(exposure_s, calibration.exposure_jitter_s)
    errors = [
        CommonError("meter scale", scale.u_rel, scale.certificate is None, scale.degrees_of_freedom),
        *(
            CommonError(source, part, rectangular=True)
            for source, part in zip(METER_SOURCES[1:], scale.rectangular_rel[1:], strict=True)
            if part
        ),
        *((CommonError(REFOCUS, calibration.lens.refocus_rel),) if calibration.lens.refocus_rel else ()),
        *((CommonError(STABILITY, calibration.stability_rel),) if calibration.stability_rel else ()),
        CommonError(EXPOSURE_TIME, times.u_rel(exposure_s, jitter_rel, calibration.exposures_s)),
        *((CommonError("exposure offset", times.offset_u_rel(exposure_s)),) if times.offset_u_s else ()),
    ]
    fit = calibration.responsivity
    glare_dn = fit.glare_cd_m2 * calibration.dn_per_cd_m2(exposure_s, setting.gain_db)
    linear_dn = calibration.response.linearise(n)
    with np.errstate(divide="ignore", invalid="ignore"):
        by_dark_dn, by_glare = -calibration.response.slope(n) / linear_dn, glare_dn / linear_dn
    if glare_dn:
        errors.append(CommonError(INTERCEPT, by_glare))
    for offset_dn in (fit.dark_offset_dn, fit.dark_rate_dn_s * exposure_s):
        if offset_dn:
            errors.append(CommonError(DARK_OFFSET, by_dark_dn * offset_dn))
    unknown_dn = setting.dark.unknown_growth_dn(exposure_s, temperature_c)
    errors.append(CommonError(TEMPERATURE, by_dark_dn * unknown_dn if unknown_dn else 0.0))
    sensitivities = setting.dark.sensitivities(exposure_s, temperature_c)
    for error in calibration.fit_errors:
        gain_rel = error.gain_rel[index - 1] if index and error.gain_rel else 0.0
        relative = np.interp(n, error.net_dn, error.relative) + gain_rel
        if error.dark and error.dark_gain_db == setting.gain_db:
            relative = relative + by_dark_dn * float(sensitivities @ np.array(error.dark))
        errors.append(CommonError(error.source, relative, dof=error.dof or inf))
    return tuple(errors)


def numbers_by_pattern(calibration: CalibratedCamera) -> dict[int, int]:
    """Place among the errors of `common_errors`, from the end, of those by each pattern of the vignetting."""
    n = len(calibration.fit_errors)
    return {e.pattern: i - n for i, e in enumerate(calibration.fit_errors) if e.pattern is not None}


def placed(
    calibration: CalibratedCamera, errors: Sequence[CommonError], by_place: Sequence[NDArray[np.floating[Any]]]
) -> tuple[CommonError, ...]:
    """Add the errors of the vignetting at the pixels, one for each of its patterns, to those of `common_errors`.

    An error of the vignetting has changed the fit too, by its values at the patches: both are one error.
    """
    result, numbers, source = list(errors), numbers_by_pattern(calibration), vignetting_source(calibration.vignetting)
    for pattern, relative in enumerate(by_place):
        if pattern in numbers:
            of_fit = errors[numbers[pattern]]
            result[len(errors) + numbers[pattern]] = replace(of_fit, relative=of_fit.relative + relative)
        else:
            result.append(CommonError(source, relative))
    return tuple(result)
