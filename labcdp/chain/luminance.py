"""Luminance combined of the planes of a colour filter: the weights of the planes, and the four pixels of a cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.photometry import WAVELENGTH_RANGE_NM, spectral_weights, visibility_at
from .captures import LUMINANCE, PATTERNS
from .sensor import Sensor
from .signal import Signal

_CELL_KEY = 0x63656C6C


def luminance_weights(sensor: Sensor, spectrum: str) -> Mapping[str, float]:
    """Return the weight of each plane in the luminance of a cell of 2 x 2 pixels; their sum is 1.

    Parameters
    ----------
    sensor : Sensor
        With a colour filter.
    spectrum : str
        Light of the chain, in which each plane alone gives the luminance.

    Returns
    -------
    mapping of str to float
        In the order of the pattern; of pixels of one plane the mean counts.

    Raises
    ------
    InputError
        If weights are stated whose sum is not above 0.

    Notes
    -----
    Those that the planes state (`ColourPlane.luminance_weight`). Without any, those for which the combined sensitivity
    to radiant power differs least from V(lambda), in the mean square from 380 to 780 nm, as for a colour correction by
    the spectral sensitivities (ISO 17321-1): an infrared plane is subtracted. Planes of one shape share their weight by
    their pixels.
    """
    pattern = PATTERNS[sensor.colour_filter]
    names = list(dict.fromkeys(pattern))
    planes = {plane.name: plane for plane in sensor.planes}
    stated = [planes[name].luminance_weight for name in names]
    if any(weight is not None for weight in stated):
        weights = np.array([weight or 0.0 for weight in stated])
        if not weights.sum() > 0:
            raise InputError(
                f"the luminance_weight of the planes add up to {weights.sum():g}: give weights whose sum is above 0",
                key="planes",
            )
    else:
        shares = np.array([pattern.count(name) for name in names]) / len(pattern)
        curves = [_sensitivity(planes[name].quantum_efficiency, spectrum) for name in names]
        weights = _nearest_weights(np.stack(curves), shares, spectrum)
    return dict(zip(names, (weights / weights.sum()).tolist(), strict=True))


def _wavelengths() -> NDArray[np.float64]:
    return np.arange(WAVELENGTH_RANGE_NM[0], WAVELENGTH_RANGE_NM[1] + 1)


def _sensitivity(quantum_efficiency: float | tuple[tuple[float, float], ...], spectrum: str) -> NDArray[np.float64]:
    """Electrons per radiant power over wavelength, in units of those of the light."""

    def per_power(wavelength_nm: NDArray[np.float64]) -> NDArray[np.float64]:
        if isinstance(quantum_efficiency, float):
            return quantum_efficiency * wavelength_nm
        known, values = np.array(quantum_efficiency).T
        return np.asarray(np.interp(wavelength_nm, known, values, left=0, right=0) * wavelength_nm)

    wavelength_nm, power, _ = spectral_weights(spectrum)
    of_light = float(power @ per_power(wavelength_nm))
    if of_light == 0:
        raise InputError(f"a plane of the colour filter sees nothing of {spectrum!r}: leave it out, or give another")
    return np.asarray(per_power(_wavelengths()) / of_light)


def _nearest_weights(curves: NDArray[np.float64], shares: NDArray[np.float64], spectrum: str) -> NDArray[np.float64]:
    """Weights of sum 1 for which the sum of curves is nearest to V(lambda); of those as near, the nearest to shares."""
    _, power, visibility = spectral_weights(spectrum)
    wanted = visibility_at(_wavelengths()) / float(power @ visibility)
    # All weights of sum 1 are the shares and a combination of differences.
    differences = np.eye(len(shares))[1:] - np.eye(len(shares))[:1]
    step, *_ = np.linalg.lstsq((differences @ curves).T, wanted - shares @ curves, rcond=1e-6)
    return np.asarray(shares + step @ differences)


def cell_sensors(sensor: Sensor) -> list[tuple[str, Sensor]]:
    """Return a sensor for each of the four pixels of a cell, with its plane: as if all pixels were of it.

    They have other fixed patterns, as other pixels have.
    """
    return [
        (name, replace(sensor, plane=name, device_seed=cell_seed(sensor.device_seed, number)))
        for number, name in enumerate(PATTERNS[sensor.colour_filter])
    ]


def cell_seed(seed: int, number: int) -> int:
    """Return the seed of a pixel of a cell."""
    return int(np.random.SeedSequence([_CELL_KEY, seed, number]).generate_state(1)[0])


def combined(pixels: Sequence[tuple[str, Signal]], weights: Mapping[str, float], illuminance: Signal) -> Signal:
    """Combine the luminance of the four pixels of each cell; a saturated pixel makes a saturated cell.

    Parameters
    ----------
    pixels : sequence of (str, Signal)
        Plane and signal of each.
    weights : mapping of str to float
        As of `luminance_weights`.
    illuminance : Signal
        In front of the sensor, with its inverse.

    Returns
    -------
    Signal
        The illuminance of the chain's light that has the luminance.
    """
    names = [name for name, _ in pixels]
    luminance = sum(np.float32(weights[name] / names.count(name)) * signal.luminance_cd_m2 for name, signal in pixels)
    # The inverse is a straight line in each pixel.
    at_0, at_1 = (illuminance.to_luminance(np.full_like(illuminance.values, value)) for value in (0, 1))
    full = [signal.saturated for _, signal in pixels if signal.saturated is not None]
    return replace(
        illuminance,
        values=np.asarray((luminance - at_0) / (at_1 - at_0)),
        saturated=np.any(full, axis=0) if full else None,
    )


def is_combined(sensor: object) -> bool:
    """Whether the luminance of the cells of a colour filter is looked at."""
    return isinstance(sensor, Sensor) and sensor.plane == LUMINANCE
