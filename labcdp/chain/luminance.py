"""Luminance combined of the planes of a colour filter: the weights of the planes, and the four pixels of a cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.photometry import WAVELENGTH_RANGE_NM, spectral_weights
from ..core.spectra import SpectralTable, least_f1_prime
from .captures import LUMINANCE, PATTERNS, ColourPlane
from .sensor import Sensor
from .signal import Signal

#: Seeds of the pixels of a cell stand apart from those of the noise.
_CELL_KEY = 0x63656C6C
_RANGE_NM = np.arange(WAVELENGTH_RANGE_NM[0], WAVELENGTH_RANGE_NM[1] + 1)


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
    Those that the planes state (`ColourPlane.luminance_weight`). Without any, those of the sum of sensitivities to
    radiant power with the smallest f1' (`labcdp.core.spectra.least_f1_prime`), as a calibration has them. Planes of
    equal sensitivity share their weight by their pixels.
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
        weights = np.array(_nearest_weights(pattern, tuple(planes[name] for name in names), spectrum))
    return dict(zip(names, (weights / weights.sum()).tolist(), strict=True))


@lru_cache(maxsize=64)
def _nearest_weights(pattern: tuple[str, ...], planes: tuple[ColourPlane, ...], spectrum: str) -> tuple[float, ...]:
    """Weights of the luminance that each plane gives for the light, for which the sum is most like V(lambda)."""
    curves = {}
    wavelength_nm, power, _ = spectral_weights(spectrum)
    for plane in planes:
        response = float(power @ _sensitivity(plane, wavelength_nm))
        if response == 0:
            raise InputError(f"plane {plane.name} sees nothing of {spectrum!r}: leave it out, or give another")
        curves[plane.name] = _sensitivity(plane, _RANGE_NM) / response
    # Of equal planes one stands for all.
    first = {
        name: next(other for other in curves if np.allclose(curves[other], curve, rtol=1e-9))
        for name, curve in curves.items()
    }
    tables = {name: SpectralTable(tuple(_RANGE_NM.tolist()), tuple(curves[name].tolist())) for name in first.values()}
    factors = least_f1_prime(tables)
    pixels = {name: sum(pattern.count(other) for other in first if first[other] == name) for name in tables}
    return tuple(factors[first[name]] * pattern.count(name) / pixels[first[name]] for name in curves)


def _sensitivity(plane: ColourPlane, wavelength_nm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Relative sensitivity to radiant power at wavelengths."""
    efficiency = plane.quantum_efficiency
    if isinstance(efficiency, float):
        return efficiency * wavelength_nm
    known, values = np.array(efficiency).T
    return np.asarray(np.interp(wavelength_nm, known, values, left=0, right=0) * wavelength_nm)


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
