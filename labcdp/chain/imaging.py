"""A camera on a bench: windscreen, optics and sensor joined, with the inverse to luminance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.photometry import photon_radiance_per_cd_m2
from .optics import Optics, Windscreen
from .scene.scene import luminance_map
from .sensor import Sensor


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
        if scene.shape != self.sensor.shape:
            raise InputError(
                f"the scene has the shape {scene.shape}, the sensor has {self.sensor.shape}: give one value for "
                "each pixel"
            )
        behind = scene if self.windscreen is None else self.windscreen.apply(scene)
        illuminance_lx = self.optics.apply(behind, self.sensor.pixel_pitch_m)
        rate: NDArray[np.float32] = self.sensor.electron_rate(illuminance_lx, self.spectrum).astype(
            np.float32, copy=False
        )
        return rate

    def responsivity_dn_s_cd_m2(self, gain_db: float = 0.0) -> float:
        """DN per second and cd/m^2 on the optical axis, as a calibration finds it; raises InputError as `Sensor`."""
        passed = 1.0 if self.windscreen is None else self.windscreen.transmittance
        electrons = passed * self.optics.axial_illuminance_per_cd_m2 * self.sensor.electrons_per_lx_s(self.spectrum)
        return self.sensor.system_gain_dn_per_e(gain_db) * electrons

    def dark_dn(self, exposure_s: float, gain_db: float = 0.0, *, temperature_c: float) -> float:
        """Mean DN of dark signal, black level and dark current; raises InputError as `Sensor`."""
        dark_e = self.sensor.dark_current_at(temperature_c) * exposure_s
        return self.sensor.black_level_dn + self.sensor.system_gain_dn_per_e(gain_db) * dark_e
