from dataclasses import replace
from math import cos, pi, sqrt

import numpy as np
import pytest

from labcdp.chain import Chain, ImagingChain, Optics, Sensor, Windscreen


@pytest.fixture
def chain() -> ImagingChain:
    """The bench's camera with a smaller sensor."""
    camera = Chain.load("manta-g505").camera()
    return replace(camera, sensor=replace(camera.sensor, width=320, height=240))


def test_electron_rate_of_a_flat_scene_on_the_axis(sensor: Sensor) -> None:
    # Odd size: the middle pixel lies on the axis.
    chain = ImagingChain(
        "monochromatic 555 nm",
        Windscreen(0.8, 0.25),
        Optics(f_number=2.0, transmittance=0.9, focal_length_m=6e-3),
        replace(sensor, width=31, height=21, quantum_efficiency=0.5),
    )
    photons_m2_s_lx = 555e-9 / (6.62607015e-34 * 299792458) / 683
    expected = 100 * 0.8 * 1.25 * 0.9 * pi / 16 * photons_m2_s_lx * 9e-12 * 0.5
    assert chain.electron_rate(np.full((21, 31), 100.0))[10, 15] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("luminance_cd_m2", "exposure_s", "gain_db"), [(412.0, 1e-3, 0.0), (3.0, 0.05, 6.0), (0, 0.5, 0)]
)
def test_exposures_have_the_mean_of_responsivity_and_dark_signal(
    chain: ImagingChain, luminance_cd_m2: float, exposure_s: float, gain_db: float
) -> None:
    chain, sensor = replace(chain, windscreen=Windscreen(0.9)), chain.sensor
    rate = chain.electron_rate(np.full(sensor.shape, luminance_cd_m2))
    dn = sensor.expose(rate, exposure_s, gain_db, temperature_c=35.0, seed=4, exposure_index=0)[100:140, 140:180]
    signal = chain.responsivity_dn_s_cd_m2(gain_db) * exposure_s * luminance_cd_m2
    expected = signal * cos(20 * sensor.pixel_pitch_m / 6e-3) ** 4
    expected += chain.dark_dn(exposure_s, gain_db, temperature_c=35.0)
    # Patterns of the sensor and the vignetting of 20 pixels are below 1 %.
    assert dn.mean() == pytest.approx(expected, abs=5 * dn.std() / sqrt(dn.size) + 0.001 * signal)
