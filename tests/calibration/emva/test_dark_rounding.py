"""Dark signal with less noise than rounding hides: stated uncertainties hold the truth, and the cause is named."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.calibration.emva.data_set import characterise_data_set
from labcdp.calibration.frames.rounding import mean_before_rounding, rounded_moments

from .conftest import KnownCamera, Recording, write_data_set

#: 0.21 DN of noise: the variance of the dark signal is below what the standard allows.
QUIET = KnownCamera(k_dn_per_e=0.05, read_noise_e=4.25, dsnu_e=3.2, dark_current_e_s=800.0, shape=(40, 48))


@pytest.mark.parametrize("deviation", [0.05, 0.2, 0.4, 0.6, 1.0])
@pytest.mark.parametrize("place", [0.0, 0.2, 0.5, 0.9])
def test_moments_of_rounded_values_by_brute_force(deviation, place):
    values = np.rint(place + deviation * np.random.default_rng(2).standard_normal(400_000))
    mean, variance = rounded_moments(np.array([place]), deviation**2)
    assert mean[0] == pytest.approx(values.mean(), abs=5 * sqrt(variance[0] / values.size) + 1e-6)
    assert variance[0] == pytest.approx(values.var(), abs=5 * sqrt(3 * max(variance[0], 1e-3) / values.size))
    assert mean_before_rounding(float(mean[0]), deviation**2) == pytest.approx(place, abs=0.01) or deviation < 0.1


@pytest.mark.parametrize(("black_level_dn", "read_noise_e"), [(20.0, 4.25), (20.1, 4.25), (20.5, 4.25), (20.7, 7.5)])
def test_uncertainties_hold_what_rounding_hides(tmp_path, black_level_dn, read_noise_e):
    camera = replace(QUIET, black_level_dn=black_level_dn, read_noise_e=read_noise_e)
    found = characterise_data_set(write_data_set(tmp_path / "set", camera, Recording(levels=10, stack=4)))
    for quantity, truth in (
        (found.dark_noise_e, camera.read_noise_e),
        (found.dark_current_e_s, camera.dark_current_e_s),
        (found.dark_current_by_variance_e_s, camera.dark_current_e_s),
        (found.dsnu_e, camera.dsnu_e),
    ):
        assert abs(quantity.value - truth) < 3 * quantity.u, quantity
    codes = [one.code for one in found.findings]
    assert "dark-noise-rounded" in codes
    if black_level_dn == 20.1:  # below the standard's least variance
        assert found.dark_noise_e.value > camera.read_noise_e
        assert found.dark_noise_e.u > 0.3 * found.dark_noise_e.value
        assert "read-noise-upper-limit" in codes
