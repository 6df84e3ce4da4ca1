from dataclasses import replace
from math import sqrt
from typing import Any

import numpy as np
import pytest

from labcdp.chain import Sensor

N = 300 * 200
TEMPERATURE_C = 25.0


def dark_frame(sensor: Sensor, seed: int) -> np.ndarray:
    return sensor.expose(0.0, 0.01, temperature_c=TEMPERATURE_C, seed=seed, exposure_index=0)


@pytest.mark.parametrize(
    ("changes", "of", "mean", "spread", "count"),
    [
        ({"prnu_rel": 0.02}, lambda one: one.photo_response, 1.0, 0.02, N),
        ({"dsnu_e": 3.0}, lambda one: one.offset_e, 0.0, 3.0, N),
        ({"column_dsnu_e": 4.0}, lambda one: one.offset_e[0], 0.0, 4.0, 300),
        ({"row_dsnu_e": 2.0}, lambda one: one.offset_e[:, 0], 0.0, 2.0, 200),
    ],
)
def test_maps_have_their_mean_and_the_stated_spread(
    sensor: Sensor, changes: dict[str, float], of: Any, mean: float, spread: float, count: int
) -> None:
    values = of(replace(sensor, **changes).fixed_pattern)  # type: ignore[arg-type]
    assert values.mean(dtype=float) == pytest.approx(mean, abs=5 * spread / sqrt(count))
    assert values.std(dtype=float) == pytest.approx(spread, abs=5 * spread / sqrt(2 * count))


def test_dark_current_has_mean_1_the_stated_spread_and_no_negative_pixel(sensor: Sensor) -> None:
    current = replace(sensor, dark_current_e_s=10.0, dsnu_e_s=5.0).fixed_pattern.dark_current
    spread, excess_kurtosis = 0.5, 6 * 0.5**2  # gamma distribution of order 1 / spread^2
    assert current.mean(dtype=float) == pytest.approx(1, abs=5 * spread / sqrt(N))
    assert current.std(dtype=float) == pytest.approx(spread, abs=5 * spread / 2 * sqrt((2 + excess_kurtosis) / N))
    assert current.min() >= 0


def test_average_of_exposures_shows_the_photo_response(sensor: Sensor) -> None:
    device = replace(sensor, prnu_rel=0.05)
    n, mean_e = 16, 10_000
    mean = np.mean([device.expose(mean_e, 1.0, temperature_c=25.0, seed=0, exposure_index=i) for i in range(n)], axis=0)
    noise_e = sqrt(mean_e / n)
    residual_e = mean - mean_e * device.fixed_pattern.photo_response
    assert residual_e.std() == pytest.approx(noise_e, abs=5 * noise_e / sqrt(2 * N))


def test_noise_and_pattern_are_independent_even_with_the_same_seed(sensor: Sensor) -> None:
    device = replace(sensor, prnu_rel=0.05, dsnu_e=1.0, black_level_dn=100.0, device_seed=7)
    noise = dark_frame(replace(device, dsnu_e=0.0, read_noise_e=10.0), seed=7).astype(float)
    for pattern in (device.fixed_pattern.photo_response, device.fixed_pattern.offset_e):
        assert np.corrcoef(noise.ravel(), pattern.ravel())[0, 1] == pytest.approx(0, abs=5 / sqrt(N))
