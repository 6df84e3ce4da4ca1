from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.chain import Sensor
from labcdp.core.errors import InputError

N = 300 * 200


def expose(sensor: Sensor, mean_e: float, index: int = 0, **options: float) -> np.ndarray:
    """An exposure of one second, as float."""
    settings = {"temperature_c": 25.0, "seed": 0, "exposure_index": index} | options
    return sensor.expose(mean_e, 1.0, **settings).astype(float)  # type: ignore[arg-type]


def test_electron_rate_of_a_known_light(sensor: Sensor) -> None:
    # 1 lux of 555 nm is 1/683 W/m^2, half of whose photons free an electron.
    photons_m2_s = 555e-9 / (6.62607015e-34 * 299792458) / 683
    rate = sensor.electron_rate(np.array([2.0]), "monochromatic 555 nm")
    assert rate[0] == pytest.approx(2 * 0.5 * photons_m2_s * (3e-6) ** 2, rel=1e-12)


@pytest.mark.parametrize("mean_e", [3.0, 200.0, 5000.0])
def test_variance_equals_mean_in_electrons(sensor: Sensor, mean_e: float) -> None:
    # Half of the electrons are photo-electrons, half dark ones: drawing them twice would show.
    electrons = expose(replace(sensor, dark_current_e_s=mean_e / 2), mean_e / 2)
    assert electrons.mean() == pytest.approx(mean_e, abs=5 * sqrt(mean_e / N))
    assert electrons.var() / electrons.mean() == pytest.approx(1, abs=5 * sqrt((2 + 1 / mean_e) / N))


def test_photon_transfer_slope_is_k(sensor: Sensor) -> None:
    k = 0.3
    device = replace(sensor, k_dn_per_e=k, read_noise_e=8.0, black_level_dn=50.0, prnu_rel=0.01, dsnu_e=3.0, bits=12)

    def mean_and_variance(mean_e: float) -> tuple[float, float]:
        one, other = expose(device, mean_e, 0), expose(device, mean_e, 1)
        return (one + other).mean() / 2, (one - other).var() / 2

    dark_mean, dark_variance = mean_and_variance(0.0)
    levels = [mean_and_variance(mean_e) for mean_e in (500.0, 1000.0, 2000.0, 4000.0, 8000.0)]
    signal = sum(mean - dark_mean for mean, _ in levels)
    excess = sum(variance - dark_variance for _, variance in levels)
    sigma = sqrt(2 / N * (sum(variance**2 for _, variance in levels) + 25 * dark_variance**2))
    assert excess / signal == pytest.approx(k, abs=5 * sigma / signal)


def test_rounding_adds_a_twelfth_to_the_variance(sensor: Sensor) -> None:
    device = replace(sensor, read_noise_e=1.0, black_level_dn=100.0)
    variance = np.mean([expose(device, 0.0, index).var() for index in range(8)])
    assert variance == pytest.approx(1 + 1 / 12, abs=5 * (1 + 1 / 12) * sqrt(2 / (8 * N)))
    assert device.dark_noise_dn() ** 2 == pytest.approx(1 + 1 / 12, rel=1e-12)


@pytest.mark.parametrize("black_level_dn", [100.0, 100.3, 100.5, 100.9])
def test_converter_has_no_bias(sensor: Sensor, black_level_dn: float) -> None:
    dn = expose(replace(sensor, read_noise_e=1.0, black_level_dn=black_level_dn), 0.0)
    assert dn.mean() == pytest.approx(black_level_dn, abs=5 * sqrt(13 / 12 / N))


def test_dark_current_doubles(sensor: Sensor) -> None:
    device = replace(sensor, dark_current_e_s=40.0, reference_temperature_c=25.0, doubling_temperature_c=7.0)
    assert device.dark_current_at(25.0) == 40
    assert device.dark_current_at(39.0) == pytest.approx(160)
    assert device.dark_current_at(18.0) == pytest.approx(20)
    warm = expose(device, 0.0, temperature_c=39.0)
    assert warm.mean() == pytest.approx(160, abs=5 * sqrt(160 / N))


def test_full_well_is_clipped_before_read_noise(sensor: Sensor) -> None:
    dn = expose(replace(sensor, full_well_e=1000.0, read_noise_e=10.0, black_level_dn=100.0), 5000.0)
    sigma = sqrt(100 + 1 / 12)
    assert dn.mean() == pytest.approx(1100, abs=5 * sigma / sqrt(N))
    assert dn.std() == pytest.approx(sigma, abs=5 * sigma / sqrt(2 * N))


def test_blinding_light_fills_the_well(sensor: Sensor) -> None:
    assert (expose(sensor, 1e30) == sensor.full_well_e).all()


def test_noise_below_zero_is_clipped(sensor: Sensor) -> None:
    dn = expose(replace(sensor, read_noise_e=10.0), 0.0)
    assert np.mean(dn == 0) == pytest.approx(0.5199, abs=5 * 0.5 / sqrt(N))  # P(noise < 0.5 DN)


def test_a_block_of_rows_does_not_depend_on_the_others(sensor: Sensor) -> None:
    device = replace(sensor, read_noise_e=5.0, prnu_rel=0.01)
    np.testing.assert_array_equal(expose(device, 100.0)[:128], expose(replace(device, height=128), 100.0))


def test_no_noise_is_used_twice(sensor: Sensor) -> None:
    # Two blocks of each of two exposures: same numbers anywhere would show as equal blocks.
    blocks = [expose(sensor, 1000.0, index)[rows].ravel() for index in (0, 1) for rows in (slice(64), slice(64, 128))]
    correlation = np.corrcoef(blocks) - np.eye(4)
    np.testing.assert_allclose(correlation, 0, atol=5 / sqrt(64 * sensor.width))


def test_seed_and_index_fix_the_noise(sensor: Sensor) -> None:
    first = expose(sensor, 1000.0, index=3)
    np.testing.assert_array_equal(first, expose(sensor, 1000.0, index=3))
    for other in (expose(sensor, 1000.0, index=4), expose(sensor, 1000.0, index=3, seed=1)):
        assert np.corrcoef(first.ravel(), other.ravel())[0, 1] == pytest.approx(0, abs=5 / sqrt(N))


def test_saturation_is_the_converters_end_if_the_well_is_larger(sensor: Sensor) -> None:
    assert replace(sensor, bits=12).saturation_dn() == 4095


def test_full_pixels_lie_above_saturation(sensor: Sensor) -> None:
    device = replace(sensor, full_well_e=1000.0, read_noise_e=20.0, dsnu_e=15.0, black_level_dn=50.0)
    assert device.saturation_dn() == pytest.approx(1050 - 6 * 25)
    assert np.all(expose(device, 3000.0) >= device.saturation_dn())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"exposure_s": 0.0}, r"exposure_s is 0.0: give a number above 0 s"),
        ({"gain_db": float("inf")}, r"gain_db is inf: give a number from -100 to 100 dB"),
        ({"temperature_c": 900.0}, r"temperature_c is 900.0: give a number from -100 to 200 degC"),
        ({"seed": -1}, r"seed is -1: give a number of at least 0"),
        ({"exposure_index": 0.5}, r"exposure_index is 0.5: give a whole number"),
        ({"threads": 0}, r"threads is 0: give a number of at least 1"),
        ({"electron_rate": -1.0}, r"electron_rate is from -1 to -1 e-/s: give finite numbers of at least 0"),
        ({"electron_rate": float("nan")}, r"electron_rate is from nan to nan e-/s"),
        ({"electron_rate": np.ones((2, 3))}, r"electron_rate has the shape \(2, 3\), the sensor has \(200, 300\)"),
    ],
)
def test_exposure_out_of_range_is_refused(sensor: Sensor, change: dict[str, float], message: str) -> None:
    values = {"electron_rate": 1.0, "exposure_s": 1.0, "temperature_c": 25.0, "seed": 0, "exposure_index": 0}
    with pytest.raises(InputError, match=message):
        sensor.expose(**(values | change))  # type: ignore[arg-type]


def test_gain_is_20_log_10_of_the_amplitude(sensor: Sensor) -> None:
    dn = sensor.expose(1000.0, 1.0, 20.0, temperature_c=25.0, seed=0, exposure_index=0)
    assert dn.mean() == pytest.approx(10_000, abs=5 * 10 * sqrt(1000 / N))
