"""The meter: certificate or data sheet, its mismatch, and what of it cancels."""

from dataclasses import replace
from datetime import UTC, date, datetime
from math import sqrt

import numpy as np
import pytest

from labcdp.calibration import fit, patch_luminance
from labcdp.calibration.budget import budget
from labcdp.calibration.convert.patch import contrast_uncertainty
from labcdp.calibration.readings import combine_readings
from labcdp.calibration.setup import MeterScale, corrected, meter_scale
from labcdp.calibration.uncertainty import expanded_rel
from labcdp.core.errors import CalibrationError
from labcdp.core.reading import MeterIdentity
from labcdp.session import MeterCertificate

METER = MeterIdentity("LS-110", "73323007")
CERTIFICATE = MeterCertificate(
    number="42",
    laboratory="PTB",
    date=date(2018, 1, 10),
    due_date=date(2019, 1, 10),
    correction=1.01,
    expanded_uncertainty_rel=0.008,
    coverage_factor=2.0,
)
LUMINANCES, EXPOSURES_S = np.geomspace(0.5, 250, 8), (0.002, 0.01, 0.1)


@pytest.fixture
def calibrated(camera, new_reading, setup):
    """Calibrate with exact readings of four digits, corrected by the certificate if there is one."""

    def calibrate(certificate=None, f1_prime=None):
        rng = np.random.default_rng(1)
        observations = [camera.observe(f"P{i}", v, t, rng) for i, v in enumerate(LUMINANCES) for t in EXPOSURES_S]
        readings = {
            f"P{i}": [corrected(new_reading(float(v), digits_half_width=1e-4 * v), certificate)]
            for i, v in enumerate(LUMINANCES)
        }
        known = replace(setup, certificate=certificate, meter_f1_prime=f1_prime)
        return fit(observations, [camera.dark(t, rng) for t in EXPOSURES_S], readings, known), observations

    return calibrate


def test_a_certificate_takes_the_place_of_the_data_sheet(calibrated):
    by_sheet, observations = calibrated()
    by_certificate, _ = calibrated(CERTIFICATE)
    r = [one.responsivity.responsivity_dn_s_cd_m2 for one in (by_sheet, by_certificate)]
    assert r[0] / r[1] == pytest.approx(1.01, rel=1e-6)
    for one, u, distribution in ((by_sheet, 0.02 / sqrt(3), "rectangular"), (by_certificate, 0.004, "normal")):
        row = next(row for row in budget(one, 10.0) if row.source == "meter scale")
        assert (row.standard_uncertainty_rel, row.distribution, row.evaluation) == (pytest.approx(u), distribution, "B")
    assert "certificate 42 of PTB" in row.basis
    assert {one.code for one in by_sheet.findings} >= {"meter-without-certificate"}
    assert not {one.code for one in by_certificate.findings} & {"meter-without-certificate", "certificate-overdue"}
    # The scale cancels in contrasts, whatever its distribution.
    dark, bright = (
        [patch_luminance(one, [o for o in observations if o.patch == name]) for one in (by_sheet, by_certificate)]
        for name in ("P0", "P7")
    )
    assert contrast_uncertainty(bright[0], dark[0]) == pytest.approx(contrast_uncertainty(bright[1], dark[1]), rel=1e-6)
    assert dark[0].fit_rel == pytest.approx(dark[1].fit_rel)


def test_mismatch_counts_in_another_light_only(calibrated):
    calibration, observations = calibrated(CERTIFICATE, f1_prime=0.03)
    row = next(row for row in budget(calibration, 10.0) if row.source == "meter f1'")
    assert (row.included, row.standard_uncertainty_rel) == (True, pytest.approx(0.03 / sqrt(3)))
    seen = patch_luminance(calibration, [o for o in observations if o.patch == "P4"])
    assert seen.common_rel == pytest.approx(sqrt(seen.fit_rel**2 + 0.004**2 + 0.03**2 / 3))
    assert MeterScale(METER, 0.02, None, 0.03, "a").mismatch_rel == 0.0
    assert MeterScale(METER, 0.02, None, None, "LED").mismatch_rel == 0.0


def test_an_overdue_certificate_is_a_warning():
    scale = MeterScale(METER, 0.02, CERTIFICATE)
    assert scale.findings(datetime(2019, 1, 10, tzinfo=UTC)) == []
    (found,) = scale.findings(datetime(2019, 1, 11, tzinfo=UTC))
    assert (found.code, found.severity, found.values["due"]) == ("certificate-overdue", "warning", "2019-01-10")


@pytest.mark.parametrize(
    ("scales", "random_rel"),
    [
        ([], 0.01),
        ([MeterScale(METER, 0.02)], 0.002),
        ([MeterScale(METER, 0.02, CERTIFICATE)], 0.002),
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


def test_readings_with_different_corrections_are_not_averaged(new_reading):
    preset, user = new_reading(10.0), new_reading(10.1, correction="luminance")
    message = "reading 1 of patch 'P' was taken with the correction 'preset', reading 2 of patch 'P' with 'luminance'"
    with pytest.raises(CalibrationError, match=message):
        combine_readings("P", [preset, user])
    with pytest.raises(CalibrationError, match="reading 1 of patch 'Q' with 'luminance'"):
        meter_scale({"P": [preset], "Q": [user]})
    # A meter that does not say is believed.
    assert meter_scale({"P": [preset, new_reading(10.0, correction=None)]}).meter == METER


def test_readings_of_two_meters_or_two_states_are_refused(new_reading):
    states = (("2", None), (METER.serial, "2018-02-01"))
    other = [new_reading(10.0, meter=MeterIdentity("LS-110", serial, day)) for serial, day in states]
    with pytest.raises(CalibrationError, match="readings come from meters LS-110 73323007 and LS-110 2"):
        meter_scale({"P": [new_reading(10.0)], "Q": [other[0]]})
    with pytest.raises(CalibrationError, match=r"adjusted between the readings \(date not known; 2018-02-01\)"):
        meter_scale({"P": [new_reading(10.0)], "Q": [other[1]]})
