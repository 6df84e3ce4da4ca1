"""Colour filters on a sensor: which plane each pixel is of, and what scenes of several spectra are to a plane."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.photometry import QuantumEfficiency, electron_radiance_per_cd_m2
from .captures import LUMINANCE, PATTERNS
from .scene.scene import Level
from .scene.spectra import RegionSpectrum, spectra_of, spectral_samples
from .sensor import Sensor, scaled_efficiency


@dataclass(frozen=True, eq=False)
class SeenPlane:
    """A plane of a sensor as far as it is looked at.

    Parameters
    ----------
    quantum_efficiency : float or tuple of (float, float)
        Electrons per photon.
    cells : tuple of int
        Which of the 2 x 2 pixels it has, row by row.
    share : float
        Its share of the pixels.
    """

    quantum_efficiency: QuantumEfficiency
    cells: tuple[int, ...]
    share: float

    def relative(self, level: Level, spectra: tuple[RegionSpectrum, ...], spectrum: str) -> float:
        """Electrons per luminance of a region over those of the light of the chain."""
        of_region = next((known for known in spectra if known.region == level.name), None)
        return 1.0 if of_region is None else self.relative_to_light(of_region, spectrum)

    def relative_to_light(self, of_region: RegionSpectrum, spectrum: str) -> float:
        """Electrons per luminance of a spectrum over those of the light of the chain."""
        per_cd_m2 = electron_radiance_per_cd_m2(
            of_region.light or spectrum, self.quantum_efficiency, of_region.reflectance
        )
        return per_cd_m2 / self.per_cd_m2(spectrum)

    def per_cd_m2(self, spectrum: str) -> float:
        """Electrons s^-1 m^-2 sr^-1 for 1 cd/m^2 of the light of the chain."""
        per_cd_m2 = electron_radiance_per_cd_m2(spectrum, self.quantum_efficiency)
        if per_cd_m2 == 0:
            raise InputError(
                f"a plane of the colour filter sees nothing of {spectrum!r}: leave it out, or give another"
            )
        return per_cd_m2

    def mask(self, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Which pixels of a frame are of this plane."""
        of_cell = np.isin(np.arange(4), self.cells).reshape(2, 2)
        rows, columns = (np.arange(size) % 2 for size in shape)
        return np.asarray(of_cell[rows[:, None], columns])


def seen_planes(sensor: Sensor) -> tuple[SeenPlane, ...]:
    """Return the planes of a sensor that are looked at: one without a colour filter or if `Sensor.plane` names it."""
    if not sensor.colour_filter or sensor.plane not in ("", LUMINANCE):
        own = [plane.quantum_efficiency for plane in sensor.planes if plane.name == sensor.plane]
        return (SeenPlane(own[0] if own else sensor.quantum_efficiency, (0, 1, 2, 3), 1.0),)
    pattern = PATTERNS[sensor.colour_filter]
    cells = {name: tuple(cell for cell in range(4) if pattern[cell] == name) for name in dict.fromkeys(pattern)}
    efficiencies = {plane.name: plane.quantum_efficiency for plane in sensor.planes}
    return tuple(SeenPlane(efficiencies[name], at, len(at) / 4) for name, at in cells.items())


def seen_sensor(sensor: Any, spectrum: str) -> Any:
    """Return a sensor without colour filter that has the quantum efficiency of what is looked at.

    Of all pixels it is that of the most sensitive plane, lowered to the mean sensitivity to the light of the chain.
    """
    if not isinstance(sensor, Sensor) or not sensor.colour_filter:
        return sensor
    planes = seen_planes(sensor)
    most = max(planes, key=lambda plane: plane.per_cd_m2(spectrum))
    mean = sum(plane.share * plane.per_cd_m2(spectrum) for plane in planes)
    efficiency = scaled_efficiency(most.quantum_efficiency, mean / most.per_cd_m2(spectrum))
    return replace(sensor, colour_filter="", planes=(), plane="", quantum_efficiency=efficiency)


def sample_factors(scene: Any, plane: SeenPlane, spectrum: str) -> NDArray[np.float32] | float:
    """Return what each sample's luminance is to be multiplied by, so that the plane sees it as the chain's light."""
    if not spectra_of(scene):
        return 1.0
    factors = np.ones(scene.luminance_map().shape, np.float32)
    for own, mask in spectral_samples(scene):
        factors[mask] = plane.relative_to_light(own, spectrum)
    return factors
