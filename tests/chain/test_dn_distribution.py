from dataclasses import replace
from math import ceil, erf, exp, gamma, lgamma, log, pi, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.stats import poisson

from labcdp.chain import ExposureSettings, Sensor
from labcdp.chain.predict.camera import CameraModel
from labcdp.chain.predict.value_table import value_table

FloatArray = NDArray[np.float64]


def of(sensor: Sensor, rate: float, temperature_c: float = 25.0, gain_db: float = 0.0) -> FloatArray:
    """Probability of each DN of the pixels of a uniform patch."""
    table = value_table(CameraModel(sensor, ExposureSettings((1.0,), gain_db, temperature_c)), np.array([rate]))
    ((_, first, share, _),) = table.blocks(np.array([rate]))
    return np.pad(share[0], (first, 2**sensor.bits - first - share.shape[1]))


def by_hand(sensor: Sensor, mean_e: float) -> FloatArray:
    """Probability of each DN from every electron count and DN in turn, without a spread of gains or dark currents."""
    noise_e = sqrt(sensor.read_noise_e**2 + sensor.dsnu_e**2 + sensor.row_dsnu_e**2 + sensor.column_dsnu_e**2)
    top = 2**sensor.bits - 1
    shares = np.zeros(top + 1)
    left = 1.0
    for count in range(ceil(sensor.full_well_e) + 1):
        electrons = min(count, sensor.full_well_e)
        chance = left if electrons == sensor.full_well_e else exp(count * log(mean_e) - mean_e - lgamma(count + 1))
        left -= chance
        below = 0.0
        for dn in range(top + 1):
            edge_e = (dn + 0.5 - sensor.black_level_dn) / sensor.k_dn_per_e
            up_to = 1.0 if dn == top else (1 + erf((edge_e - electrons) / noise_e / sqrt(2))) / 2
            shares[dn] += chance * (up_to - below)
            below = up_to
    return shares


@pytest.mark.parametrize("mean_e", [0.3, 4.0, 11.0, 60.0])
def test_small_sensor_by_hand(sensor: Sensor, mean_e: float) -> None:
    small = replace(
        sensor,
        bits=3,
        full_well_e=12.5,
        k_dn_per_e=0.4,
        read_noise_e=0.7,
        dsnu_e=0.5,
        row_dsnu_e=0.2,
        black_level_dn=1.3,
    )
    np.testing.assert_allclose(of(small, mean_e), by_hand(small, mean_e), rtol=0, atol=1e-7)


def test_without_noise_dn_are_poisson_counts(sensor: Sensor) -> None:
    for rate in (0.0, 0.02, 3.0, 40.0, 1000.0, 30_000.0):
        np.testing.assert_allclose(np.cumsum(of(sensor, rate)), poisson.cdf(np.arange(65536), rate), atol=1e-7)


@pytest.mark.parametrize(("prnu_rel", "mean_e"), [(0.005, 2000.0), (0.02, 5000.0), (0.08, 9000.0)])
def test_gains_of_pixels(sensor: Sensor, prnu_rel: float, mean_e: float) -> None:
    device = replace(sensor, prnu_rel=prnu_rel, bits=14)
    for dn in (int(mean_e * (1 - 1.5 * prnu_rel)), int(mean_e), int(mean_e * (1 + prnu_rel))):
        expected, _ = quad(
            lambda z, dn=dn: poisson.cdf(dn, mean_e * (1 + prnu_rel * z)) * exp(-(z**2) / 2) / sqrt(2 * pi),
            -8,
            8,
            epsabs=1e-11,
            limit=400,
        )
        assert np.cumsum(of(device, mean_e))[dn] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("dsnu_e_s", [40.0, 300.0, 900.0])
def test_dark_currents_of_pixels(sensor: Sensor, dsnu_e_s: float) -> None:
    device = replace(sensor, dark_current_e_s=400.0, dsnu_e_s=dsnu_e_s, bits=14)
    order = (400 / dsnu_e_s) ** 2
    for dn in (110, 310, 450, 700):
        # In the logarithm of the dark current, where its gamma density is smooth.
        expected, _ = quad(
            lambda y, dn=dn: (
                poisson.cdf(dn, 100 + 400 * exp(y)) * exp(order * (log(order) + y - exp(y))) / gamma(order)
            ),
            -14 / min(order, 1) - 3,
            4,
            epsabs=1e-11,
            limit=400,
        )
        assert np.cumsum(of(device, 100.0))[dn] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"prnu_rel": 0.03, "dsnu_e": 6.0, "dark_current_e_s": 300.0, "dsnu_e_s": 200.0},
        {"k_dn_per_e": 0.02, "bits": 6, "dsnu_e": 30.0},
    ],
)
@pytest.mark.parametrize("mean_e", [0.0, 60.0, 2500.0])
def test_simulated_exposures_are_distributed_so(sensor: Sensor, changes: dict[str, float], mean_e: float) -> None:
    device = replace(sensor, k_dn_per_e=0.3, read_noise_e=8.0, bits=11, black_level_dn=5.0, full_well_e=6000)
    device = replace(device, width=600, height=500, device_seed=7, **changes)  # type: ignore[arg-type]
    dn = device.expose(mean_e, 1.0, temperature_c=25.0, seed=3, exposure_index=0)
    expected = of(device, mean_e) * dn.size
    counts = np.bincount(dn.ravel(), minlength=expected.size)
    usual = expected > 20
    freedom = usual.sum() - 1
    chi2 = ((counts - expected) ** 2)[usual] / expected[usual]
    assert (chi2.sum() - freedom) / sqrt(2 * freedom) < 4
