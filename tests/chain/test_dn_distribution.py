"""The distribution of DN against sums over electron counts, integrals over pixels, and exposures."""

from dataclasses import replace
from math import exp, gamma, log, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.stats import norm, poisson

from labcdp.chain import ExposureSettings
from labcdp.chain.predict.camera import CameraModel
from labcdp.chain.predict.value_table import value_table

FloatArray = NDArray[np.float64]


def of(sensor, rate, temperature_c=25.0, gain_db=0.0):
    """Probability of each DN of the pixels of a uniform patch."""
    table = value_table(CameraModel(sensor, ExposureSettings((1.0,), gain_db, temperature_c)), np.array([rate]))
    ((_, first, share, _),) = table.blocks(np.array([rate]))
    return np.pad(share[0], (first, 2**sensor.bits - first - share.shape[1]))


def test_without_noise_dn_are_poisson_counts(sensor):
    for rate in (0.0, 0.02, 3.0, 40.0, 1000.0, 30_000.0):
        for one in (sensor, replace(sensor, dark_current_e_s=1e-14, dsnu_e_s=0.1)):
            np.testing.assert_allclose(np.cumsum(of(one, rate)), poisson.cdf(np.arange(65536), rate), atol=1e-7)


@pytest.mark.parametrize(("prnu_rel", "mean_e"), [(0.005, 2000.0), (0.02, 5000.0), (0.08, 9000.0)])
def test_gains_of_pixels(sensor, prnu_rel, mean_e):
    device = replace(sensor, prnu_rel=prnu_rel, bits=14)
    for dn in (int(mean_e * (1 - 1.5 * prnu_rel)), int(mean_e), int(mean_e * (1 + prnu_rel))):
        expected = norm.expect(lambda z, dn=dn: poisson.cdf(dn, mean_e * (1 + prnu_rel * z)), lb=-8, ub=8, limit=400)
        assert np.cumsum(of(device, mean_e))[dn] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("dsnu_e_s", [40.0, 300.0, 900.0])
def test_dark_currents_of_pixels(sensor, dsnu_e_s):
    device = replace(sensor, dark_current_e_s=400.0, dsnu_e_s=dsnu_e_s, bits=14)
    order = (400 / dsnu_e_s) ** 2
    for dn in (110, 310, 450, 700):
        # In the logarithm of the dark current, where its gamma density is smooth.
        of_pixels = lambda y, dn=dn: poisson.cdf(dn, 100 + 400 * exp(y)) * exp(order * (log(order) + y - exp(y)))  # noqa: E731
        expected = quad(of_pixels, -14 / min(order, 1) - 3, 4, epsabs=1e-11, limit=400)[0] / gamma(order)
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
def test_simulated_exposures_are_distributed_so(sensor, changes, mean_e):
    device = replace(sensor, k_dn_per_e=0.3, read_noise_e=8.0, bits=11, black_level_dn=5.0, full_well_e=6000)
    device = replace(device, width=600, height=500, device_seed=7, **changes)
    dn = device.expose(mean_e, 1.0, temperature_c=25.0, seed=3, exposure_index=0)
    expected = of(device, mean_e) * dn.size
    counts = np.bincount(dn.ravel(), minlength=expected.size)
    usual = expected > 20
    freedom = usual.sum() - 1
    chi2 = ((counts - expected) ** 2)[usual] / expected[usual]
    assert (chi2.sum() - freedom) / sqrt(2 * freedom) < 4
