"""Physics of several stages together; that of one stage is in the test file of the stage."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.chain import ImagingChain, Optics, Sensor, Windscreen

N = 300 * 200
TEMPERATURE_C = 25.0

# Each gives the pixels the mean 10 000 e- with a spread of 100 e-, as large as their shot noise.
PATTERNS = pytest.mark.parametrize(
    ("electron_rate", "change"),
    [(10_000.0, {"prnu_rel": 0.01}), (0.0, {"dark_current_e_s": 10_000.0, "dsnu_e_s": 100.0})],
    ids=["gain", "dark current"],
)


def expose(sensor: Sensor, electron_rate: float, index: int) -> np.ndarray:
    """An exposure of one second."""
    return sensor.expose(electron_rate, 1.0, temperature_c=TEMPERATURE_C, seed=0, exposure_index=index)


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


@pytest.mark.parametrize(
    ("windscreen", "transmittance", "glare_cd_m2"),
    [(None, 1.0, 0.0), (Windscreen(0.8), 0.8, 0.0), (Windscreen(0.8, glare_fraction=0.5), 0.8, 1.25)],
    ids=["open", "loss", "loss and glare"],
)
def test_light_has_its_shot_noise_once_behind_all_stages(
    sensor: Sensor, optics: Optics, windscreen: Windscreen | None, transmittance: float, glare_cd_m2: float
) -> None:
    # Columns of 1 and 4 cd/m^2, 2.5 on average; so far behind the lens there is no fall-off.
    chain = ImagingChain("monochromatic 555 nm", windscreen, replace(optics, focal_length_m=2.0), sensor)
    scene = np.broadcast_to(np.where(np.arange(sensor.width) % 2, 4.0, 1.0), sensor.shape)
    dn = chain.sensor.expose(chain.electron_rate(scene), 1.0, temperature_c=TEMPERATURE_C, seed=0, exposure_index=0)
    electrons_per_cd_m2 = optics.axial_illuminance_per_cd_m2 * sensor.electrons_per_lx_s("monochromatic 555 nm")
    mean_e = transmittance * (scene + glare_cd_m2) * electrons_per_cd_m2
    # The square of a Poisson count's deviation has the mean m and the variance 2 m^2 + m.
    sigma = sqrt(np.mean(2 * mean_e**2 + mean_e) / N)
    assert np.mean((dn - mean_e) ** 2) == pytest.approx(mean_e.mean(), abs=5 * sigma)


@PATTERNS
def test_pattern_returns_in_the_next_exposure_of_a_device(
    sensor: Sensor, electron_rate: float, change: dict[str, float]
) -> None:
    device = replace(sensor, **change)
    again = correlation(expose(device, electron_rate, 0), expose(replace(device), electron_rate, 1))
    # Half of the variance is the pattern's.
    assert again == pytest.approx(0.5, abs=5 * (1 - 0.5**2) / sqrt(N))
