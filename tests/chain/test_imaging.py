from dataclasses import replace
from datetime import UTC, datetime
from math import pi, sqrt

import numpy as np
import pytest

from labcdp import Frame
from labcdp.chain import Chain, ImagingChain, Optics, Sensor, Windscreen
from labcdp.core.errors import InputError
from labcdp.core.frame import CameraIdentity

TEMPERATURE_C = 35.0


@pytest.fixture
def chain() -> ImagingChain:
    """The bench's camera with a smaller sensor."""
    camera = Chain.load("manta-g505").camera()
    return replace(camera, sensor=replace(camera.sensor, width=320, height=240))


def frame(chain: ImagingChain, dn: np.ndarray, exposure_s: float, gain_db: float = 0.0) -> Frame:
    sensor = chain.sensor
    return Frame(
        dn=dn,
        exposure_s=exposure_s,
        gain_db=gain_db,
        bit_depth=sensor.bits,
        saturation_dn=sensor.saturation_dn(gain_db),
        black_level_dn=sensor.black_level_dn,
        pixel_format="Mono12",
        colour_filter=None,
        temperature_c=TEMPERATURE_C,
        timestamp=datetime(2024, 5, 1, tzinfo=UTC),
        camera_timestamp_ns=0,
        frame_id=0,
        camera=CameraIdentity("test", "test", "1", simulated=True),
    )


def take(chain: ImagingChain, scene: np.ndarray | float, exposure_s: float, gain_db: float = 0.0) -> Frame:
    rate = chain.electron_rate(np.broadcast_to(np.float32(scene), chain.sensor.shape))
    dn = chain.sensor.expose(rate, exposure_s, gain_db, temperature_c=TEMPERATURE_C, seed=4, exposure_index=0)
    return frame(chain, dn, exposure_s, gain_db)


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


@pytest.mark.parametrize(("luminance_cd_m2", "exposure_s", "gain_db"), [(412, 1e-3, 0.0), (3, 0.05, 6.0)])
def test_conversion_returns_the_luminance(
    chain: ImagingChain, luminance_cd_m2: float, exposure_s: float, gain_db: float
) -> None:
    # Only the photo response is left of the fixed pattern: its spread is relative, as the noise is.
    chain = replace(chain, sensor=replace(chain.sensor, dsnu_e=0.0, dsnu_e_s=0.0))
    conversion = chain.conversion(gain_db, temperature_c=TEMPERATURE_C)
    result = conversion.to_luminance(take(chain, luminance_cd_m2, exposure_s, gain_db))
    assert result.valid.all()
    variance_rel = np.mean(result.random_rel**2) + chain.sensor.prnu_rel**2
    tolerance = 5 * luminance_cd_m2 * sqrt(variance_rel / result.luminance_cd_m2.size)
    assert result.luminance_cd_m2.mean() == pytest.approx(luminance_cd_m2, abs=tolerance)


def test_conversion_states_the_noise_of_each_pixel(chain: ImagingChain) -> None:
    quiet = replace(chain.sensor, prnu_rel=0.0, dsnu_e=0.0, dsnu_e_s=0.0)
    chain = replace(chain, sensor=quiet)
    scene = np.geomspace(20, 400, quiet.width * quiet.height).reshape(quiet.shape)
    result = chain.conversion(temperature_c=TEMPERATURE_C).to_luminance(take(chain, scene, 1e-3))
    # The stated noise follows from the noisy pixel itself, which skews it in the dark: take the stated variance
    # and the square of the deviation, both in cd/m^2, on average.
    stated = np.mean((result.random_rel * result.luminance_cd_m2) ** 2)
    squares = (result.luminance_cd_m2 - scene) ** 2
    assert squares.mean() == pytest.approx(stated, abs=5 * squares.std() / sqrt(squares.size))


def test_conversion_is_the_inverse_of_the_stages(chain: ImagingChain) -> None:
    chain = replace(chain, windscreen=Windscreen(0.9))
    dn = np.arange(240 * 320, dtype=np.uint16).reshape(240, 320) % 4095
    sensor = chain.sensor
    electrons = (dn - float(sensor.black_level_dn)) / sensor.system_gain_dn_per_e(3.0)
    rate = electrons / 0.002 - sensor.dark_current_at(TEMPERATURE_C)
    per_cd_m2 = chain.optics.apply(np.ones(rate.shape), sensor.pixel_pitch_m)
    luminance = rate / sensor.electrons_per_lx_s("D65") / per_cd_m2 / 0.9
    result = chain.conversion(3.0, temperature_c=TEMPERATURE_C).to_luminance(frame(chain, dn, 0.002, 3.0))
    np.testing.assert_allclose(result.luminance_cd_m2, luminance, rtol=1e-9, atol=1e-9)


def test_conversion_leaves_glare_in_the_luminance_and_cannot_subtract_it(chain: ImagingChain) -> None:
    clear, veiled = (replace(chain, windscreen=Windscreen(0.96, glare)) for glare in (0.0, 0.2))
    assert veiled.conversion(temperature_c=25.0) == clear.conversion(temperature_c=25.0)
    with pytest.raises(InputError, match=r"glare_fraction of 0.2 is to be subtracted, and glare depends on the scene"):
        replace(chain, windscreen=Windscreen(0.96, 0.2, glare_subtracted=True)).conversion(temperature_c=25.0)


def test_saturation_luminance_and_dark_current_together_reach_saturation(chain: ImagingChain) -> None:
    exposure_s, temperature_c = 5.0, 65.0
    luminance = chain.saturation_luminance_cd_m2(exposure_s, temperature_c=temperature_c)
    sensor = chain.sensor
    rate = chain.electron_rate(np.full(sensor.shape, luminance))[120, 160]
    electrons = exposure_s * (rate + 5 * 2 ** ((65 - 25) / 8))
    assert 64 + 0.6 * electrons == pytest.approx(sensor.saturation_dn(), rel=1e-5)
