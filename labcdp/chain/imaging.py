"""A camera on a bench: windscreen, optics and sensor joined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.photometry import photon_radiance_per_cd_m2
from .optics import Optics, Windscreen
from .scene.scene import luminance_map
from .sensor import Sensor
from .signal import Context, check_shape, scene_signal


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

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.chain import Chain, ImagingChain, Optics
    >>> ((_, sensor),) = Chain.load("manta-g505").sensors
    >>> optics = Optics(f_number=2.0, transmittance=0.9, focal_length_m=0.016)
    >>> chain = ImagingChain("D65", None, optics, sensor)
    >>> round(chain.responsivity_dn_s_cd_m2(6.0) / chain.responsivity_dn_s_cd_m2(), 3)
    1.995
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

    def responsivity_dn_s_cd_m2(self, gain_db: float = 0.0) -> float:
        """DN per second and cd/m^2 on the optical axis, R of DN = d(t) + R t V(x, y) L.

        Parameters
        ----------
        gain_db : float
            Gain in dB.

        Raises
        ------
        InputError
            If the gain is out of its range, or the windscreen's glare is to be subtracted: DN are then not linear.
        """
        passed = 1.0
        if self.windscreen is not None:
            glare = {name: getattr(self.windscreen, name) for name in ("glare_fraction", "glare_cd_m2")}
            name = next((name for name, value in glare.items() if value > 0), "")
            if name and self.windscreen.glare_subtracted:
                raise InputError(
                    f"the windscreen's {name} of {glare[name]:g} is to be subtracted, after which DN are not linear: "
                    f"set glare_subtracted to false, or {name} to 0"
                )
            passed = self.windscreen.transmittance
        electrons_per_lx_s = self.sensor.electrons_per_lx_s(self.spectrum)
        electrons_per_s = passed * self.optics.axial_illuminance_per_cd_m2 * electrons_per_lx_s
        return self.sensor.system_gain_dn_per_e(gain_db) * electrons_per_s

    def dark_dn(self, exposure_s: float, gain_db: float = 0.0, *, temperature_c: float) -> float:
        """Mean DN of the dark signal d(t) at an exposure time, gain and temperature of the sensor."""
        rate_dn_s = self.sensor.system_gain_dn_per_e(gain_db) * self.sensor.dark_current_at(temperature_c)
        return self.sensor.black_level_dn + rate_dn_s * exposure_s

    def saturation_luminance_cd_m2(self, exposure_s: float, gain_db: float = 0.0, *, temperature_c: float) -> float:
        """Luminance whose mean DN on the axis is the sensor's `saturation_dn`.

        Raises
        ------
        InputError
            As `responsivity_dn_s_cd_m2`.
        """
        net_dn = self.sensor.saturation_dn(gain_db) - self.dark_dn(exposure_s, gain_db, temperature_c=temperature_c)
        return net_dn / (self.responsivity_dn_s_cd_m2(gain_db) * exposure_s)
