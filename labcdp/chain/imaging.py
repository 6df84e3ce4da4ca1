"""A camera on a bench: windscreen, optics and sensor joined, with the inverse to luminance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import CalibrationError, InputError
from ..core.frame import Frame
from ..core.luminance import RANGE_MARGIN, Invalid, LuminanceMap
from ..core.photometry import photon_radiance_per_cd_m2
from ..core.vignetting import Vignetting
from .optics import Optics, Windscreen
from .scene.scene import luminance_map
from .sensor import Sensor
from .signal import Context, check_shape, scene_signal


@dataclass(frozen=True)
class LinearConversion:
    """L = (DN - d(t)) / (R t V(x, y)), with the dark signal d(t) = `dark_offset_dn` + `dark_rate_dn_s` t.

    Parameters
    ----------
    responsivity_dn_s_cd_m2 : float
        R, DN per second and cd/m^2 on the optical axis (DN s^-1 / (cd m^-2)), at `gain_db`.
    dark_offset_dn, dark_rate_dn_s : float
        Dark signal at zero exposure, and its growth per second.
    k_dn_per_e, dark_noise_dn : float
        Overall system gain K and temporal noise in dark signal; they give each pixel's random uncertainty,
        s^2 = K (DN - d) + dark_noise^2 (EMVA 1288).
    vignetting : Vignetting or None
        V; None for no vignetting.
    gain_db : float
        Gain the conversion is valid for.
    """

    responsivity_dn_s_cd_m2: float
    dark_offset_dn: float
    dark_rate_dn_s: float
    k_dn_per_e: float
    dark_noise_dn: float
    vignetting: Vignetting | None
    gain_db: float

    def dark_dn(self, exposure_s: float) -> float:
        """Mean DN of dark signal at an exposure time."""
        return self.dark_offset_dn + self.dark_rate_dn_s * exposure_s

    def to_luminance(self, frame: Frame) -> LuminanceMap:
        """Convert a frame to luminance.

        A pixel counts as outside the valid range if it is below 0 by more than three standard deviations of its noise.

        Raises
        ------
        CalibrationError
            If the frame was taken with another gain, or has a colour filter.
        """
        if abs(frame.gain_db - self.gain_db) > 1e-6:
            raise CalibrationError(
                f"the conversion is for a gain of {self.gain_db:g} dB, the frame was taken with "
                f"{frame.gain_db:g} dB: take the frame with the calibrated gain, or calibrate at this one"
            )
        if frame.colour_filter is not None:
            raise CalibrationError(
                f"the frame has a colour filter ({frame.colour_filter}), the conversion is for a monochrome "
                "sensor: use a monochrome pixel format"
            )
        net = frame.dn - self.dark_dn(frame.exposure_s)
        slope: NDArray[np.float64] | float = self.responsivity_dn_s_cd_m2 * frame.exposure_s
        if self.vignetting is not None:
            slope = slope * self.vignetting.relative_illuminance(frame.shape)
        noise_dn = np.sqrt(self.k_dn_per_e * np.maximum(net, 0) + self.dark_noise_dn**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            random_rel = np.where(net > 0, noise_dn / net, np.inf)
        invalid = np.where(frame.saturated, Invalid.SATURATED, 0).astype(np.uint8)
        invalid |= np.where(net < 0, Invalid.BELOW_BLACK, 0).astype(np.uint8)
        invalid |= np.where(net < -RANGE_MARGIN * noise_dn, Invalid.OUTSIDE_CALIBRATED, 0).astype(np.uint8)
        return LuminanceMap(net / slope, random_rel, (), invalid)


@dataclass(frozen=True)
class ImagingChain:
    """A camera and what is in front of it.

    Parameters
    ----------
    spectrum : str
        Spectrum of the light, as `labcdp.core.photometry.photon_radiance_per_cd_m2` takes it.
    windscreen : Windscreen or None
        None for an open bench.
    optics : Optics
        The lens.
    sensor : Sensor
        The sensor with its converter.

    Raises
    ------
    InputError
        If the spectrum is not known.
    """

    spectrum: str
    windscreen: Windscreen | None
    optics: Optics
    sensor: Sensor

    def __post_init__(self) -> None:
        # Raises for an unknown spectrum here and not at the first frame; the result is kept.
        photon_radiance_per_cd_m2(self.spectrum)

    def electron_rate(self, luminance_cd_m2: ArrayLike) -> NDArray[np.float32]:
        """Mean photo-electrons per second and pixel, dark current not included.

        Parameters
        ----------
        luminance_cd_m2 : array_like, shape (height, width)
            Luminance each pixel of the sensor sees, in cd/m^2.

        Returns
        -------
        ndarray of float32, shape (height, width)

        Raises
        ------
        InputError
            If the scene is not one (see `scene.luminance_map`) or not of the sensor's size.
        """
        scene = luminance_map(luminance_cd_m2)
        signal, context = scene_signal(scene), Context(self.spectrum, pixel_pitch_m=self.sensor.pixel_pitch_m)
        check_shape(signal, self.sensor.shape)
        for stage in (self.windscreen, self.optics):
            signal = signal if stage is None else stage.process(signal, context)
        return self.sensor.electron_rate(signal.values, self.spectrum).astype(np.float32, copy=False)

    def conversion(self, gain_db: float = 0.0, *, temperature_c: float) -> LinearConversion:
        """Return the inverse from DN to luminance that follows from the stages, without any uncertainty of its own.

        It has no upper end: luminance saturates at another value for each exposure time
        (`saturation_luminance_cd_m2`), and a frame marks its saturated pixels itself. The shot noise of the dark
        current is not part of its dark noise.

        Parameters
        ----------
        gain_db : float
            Gain of the frames to convert, in dB.
        temperature_c : float
            Temperature of the sensor in degrees Celsius.

        Raises
        ------
        InputError
            If a value is out of its range, or the windscreen's glare is to be subtracted, which a linear conversion
            cannot do.
        """
        passed = 1.0
        if self.windscreen is not None:
            glare = {name: getattr(self.windscreen, name) for name in ("glare_fraction", "glare_cd_m2")}
            name = next((name for name, value in glare.items() if value > 0), "")
            if name and self.windscreen.glare_subtracted:
                raise InputError(
                    f"the windscreen's {name} of {glare[name]:g} is to be subtracted, which a linear conversion cannot "
                    f"do: set glare_subtracted to false, or {name} to 0"
                )
            passed = self.windscreen.transmittance
        k_dn_per_e = self.sensor.system_gain_dn_per_e(gain_db)
        electrons_per_s = (
            passed * self.optics.axial_illuminance_per_cd_m2 * self.sensor.electrons_per_lx_s(self.spectrum)
        )
        return LinearConversion(
            responsivity_dn_s_cd_m2=k_dn_per_e * electrons_per_s,
            dark_offset_dn=self.sensor.black_level_dn,
            dark_rate_dn_s=k_dn_per_e * self.sensor.dark_current_at(temperature_c),
            k_dn_per_e=k_dn_per_e,
            dark_noise_dn=self.sensor.dark_noise_dn(gain_db),
            vignetting=self.optics.vignetting(self.sensor.pixel_pitch_m),
            gain_db=gain_db,
        )

    def saturation_luminance_cd_m2(self, exposure_s: float, gain_db: float = 0.0, *, temperature_c: float) -> float:
        """Luminance whose mean DN on the axis is the sensor's `saturation_dn`; raises InputError as `conversion`."""
        conversion = self.conversion(gain_db, temperature_c=temperature_c)
        net_dn = self.sensor.saturation_dn(gain_db) - conversion.dark_dn(exposure_s)
        return net_dn / (conversion.responsivity_dn_s_cd_m2 * exposure_s)
