"""Physics of several stages together; that of one stage is in the test file of the stage."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.chain import ImagingChain, Optics, Sensor, Windscreen

N = 300 * 200
TEMPERATURE_C = 25.0

# Each gives the pixels the mean 10 000 e- with a spread of 100 e-, as large as their shot noise.


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
