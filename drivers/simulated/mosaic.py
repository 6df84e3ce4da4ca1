"""Colour filters of a simulated Bayer sensor."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ...chain.sensor.emva import Sensor
from ...core.spectral.photometry import electron_radiance_per_cd_m2

#: Wavelength in nm and transmittance of pigment filters as of Bayer sensors, behind the infrared block of a colour
#: camera: their typical shape, not a measurement.
_TRANSMITTANCE: Final = {
    "R": ((380, 0.08), (450, 0.04), (540, 0.04), (570, 0.12), (590, 0.55), (610, 0.8), (650, 0.7), (700, 0)),
    "G": ((380, 0.05), (450, 0.08), (480, 0.2), (510, 0.7), (535, 0.8), (560, 0.7), (590, 0.4), (650, 0), (700, 0)),
    "B": ((380, 0.3), (420, 0.6), (450, 0.75), (480, 0.6), (510, 0.25), (540, 0.07), (580, 0.03), (700, 0)),
}  # fmt: skip


def mosaic(sensor: Sensor, spectrum: str, colour_filter: str | None) -> NDArray[np.float32]:
    """Return the electrons of each pixel relative to those without filters, for light of a spectrum.

    Parameters
    ----------
    sensor : Sensor
        Monochrome.
    spectrum : str
        Of the light.
    colour_filter : str or None
        First two pixels of the Bayer pattern; None for no filters.

    Returns
    -------
    ndarray of float32, shape (height, width), or (1, 1) without filters
    """
    if colour_filter is None:
        return np.ones((1, 1), np.float32)
    below = {"RG": "GB", "GR": "BG", "GB": "RG", "BG": "GR"}[colour_filter]
    shares = {colour: _share(sensor, spectrum, colour) for colour in "RGB"}
    cell = np.array([[shares[colour] for colour in row] for row in (colour_filter, below)], np.float32)
    height, width = sensor.shape
    return np.tile(cell, (-(-height // 2), -(-width // 2)))[:height, :width]


def _share(sensor: Sensor, spectrum: str, colour: str) -> float:
    filter_nm, transmittance = np.array(_TRANSMITTANCE[colour]).T
    bare = sensor.quantum_efficiency
    known = ((filter_nm[0], bare), (filter_nm[-1], bare)) if isinstance(bare, float) else bare
    sensor_nm, efficiency = np.array(known).T
    # Finer than both tables: a product of two straight lines is none.
    nm = np.arange(sensor_nm[0], sensor_nm[-1] + 1)
    filtered = np.interp(nm, sensor_nm, efficiency) * np.interp(nm, filter_nm, transmittance)
    both = tuple(zip(nm.tolist(), filtered.tolist(), strict=True))
    return electron_radiance_per_cd_m2(spectrum, both) / electron_radiance_per_cd_m2(spectrum, bare)
