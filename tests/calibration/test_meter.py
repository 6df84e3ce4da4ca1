"""The meter: certificate or data sheet, its mismatch, and what of it cancels."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.calibration import fit, patch_luminance
from labcdp.calibration.budget import budget
from labcdp.calibration.convert.patch import contrast_uncertainty
from labcdp.calibration.setup import MeterScale, corrected, meter_scale
from labcdp.calibration.uncertainty import expanded_rel
from labcdp.core.errors import CalibrationError
from labcdp.core.reading import MeterIdentity

from .conftest import FEW_CD_M2, FEW_S, METER, bench, codes, make_reading, row
from .test_verify import CERTIFICATE as PLAIN

CERTIFICATE = PLAIN.model_copy(update={"correction": 1.01, "degrees_of_freedom": None})


@pytest.fixture
def calibrate(camera, setup):
    """Calibrate with exact readings of four digits, corrected by the certificate if there is one."""

    def calibrated(certificate=None, f1_prime=None):
        def read(v):
            return corrected(make_reading(v, digits_half_width=1e-4 * v), certificate)

        data = bench(camera, read, np.random.default_rng(1), FEW_CD_M2, FEW_S)
        calibration = fit(*data, replace(setup, certificate=certificate, meter_f1_prime=f1_prime))
        return calibration, {f"P{i}": [o for o in data[0] if o.patch == f"P{i}"] for i in range(len(FEW_CD_M2))}

    return calibrated


def test_a_certificate_takes_the_place_of_the_data_sheet(calibrate):
    (by_sheet, seen), (by_certificate, _) = calibrate(), calibrate(CERTIFICATE)
    r = [one.responsivity.responsivity_dn_s_cd_m2 for one in (by_sheet, by_certificate)]
    assert r[0] / r[1] == pytest.approx(1.01, rel=1e-6)
    for one, u, distribution in ((by_sheet, 0.02 / sqrt(3), "rectangular"), (by_certificate, 0.004, "normal")):
        scale = row(budget(one, 10.0), "meter scale")
        assert (scale.standard_uncertainty_rel, scale.distribution) == (pytest.approx(u), distribution)
    assert "meter-without-certificate" in codes(by_sheet) - codes(by_certificate)
    # The scale cancels in contrasts, whatever its distribution.
    u = [contrast_uncertainty(*(patch_luminance(c, seen[p]) for p in ("P7", "P0"))) for c in (by_sheet, by_certificate)]
    assert u[0] == pytest.approx(u[1], rel=1e-6)


def test_mismatch_counts_in_another_light_only(calibrate):
    calibration, observations = calibrate(CERTIFICATE, f1_prime=0.03)
    mismatch = row(budget(calibration, 10.0), "meter f1'")
    assert (mismatch.included, mismatch.standard_uncertainty_rel) == (True, pytest.approx(0.03 / sqrt(3)))
    seen = patch_luminance(calibration, observations["P4"])
    assert seen.common_rel == pytest.approx(sqrt(seen.fit_rel**2 + 0.004**2 + 0.03**2 / 3))


@pytest.mark.parametrize(
    ("scales", "random_rel"),
    [
        ([], 0.01),
        ([MeterScale(METER, 0.02)], 0.002),
        ([MeterScale(METER, 0.02), MeterScale(METER, 0.02, CERTIFICATE, 0.03, "LED")], 0.004),
        ([MeterScale(METER, 0.03), MeterScale(METER, 0.02)], 0.004),
    ],
)
def test_expanded_uncertainty_contains_95_percent(scales, random_rel):
    """By Monte Carlo of all parts; two rectangular ones of which the smaller counts as normal are a little wide."""
    rng, n = np.random.default_rng(1), 200_000
    error = random_rel * rng.normal(size=n)
    for one in scales:
        error += one.half_width_rel * rng.uniform(-1, 1, n) + one.normal_rel * rng.normal(size=n)
        error += sqrt(3) * one.mismatch_rel * rng.uniform(-1, 1, n)
    inside = float(np.mean(np.abs(error) <= expanded_rel(scales, random_rel)))
    assert 0.95 - 4 * sqrt(0.95 * 0.05 / n) <= inside <= 0.96


def test_readings_of_two_corrections_meters_or_states_are_not_averaged():
    one, user = make_reading(10.0), make_reading(10.1, correction="luminance")
    other, adjusted = (replace(one, meter=MeterIdentity("LS-110", *of)) for of in (("2",), ("73323007", "2018-02-01")))
    for second, message in (
        (user, "was taken with the correction 'preset', reading . of patch '.' with 'luminance'"),
        (other, "meters LS-110 73323007 and LS-110 2"),
        (adjusted, r"adjusted between the readings \(date not known; 2018-02-01\)"),
    ):
        with pytest.raises(CalibrationError, match=message):
            meter_scale({"P": [one], "Q": [second]})
