"""The meter: certificate or data sheet, its mismatch, and what of it cancels."""

from dataclasses import replace
from datetime import UTC, date, datetime, time
from math import sqrt

import numpy as np
import pytest

from labcdp.calibration import fit, patch_luminance
from labcdp.calibration.budget import budget
from labcdp.calibration.convert.patch import contrast_u
from labcdp.calibration.setup import MeterScale, corrected, meter_scale
from labcdp.calibration.uncertainty import expanded_rel, scales_apart
from labcdp.core.errors import CalibrationError
from labcdp.core.reading import MeterIdentity
from labcdp.report.text import finding_text

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
        scale = row(budget(one, 10.0).rows, "meter scale")
        assert (scale.u_rel, scale.distribution) == (pytest.approx(u), distribution)
    assert "meter-without-certificate" in codes(by_sheet) - codes(by_certificate)
    # The scale cancels in contrasts, whatever its distribution.
    u = [contrast_u(*(patch_luminance(c, seen[p]) for p in ("P7", "P0"))) for c in (by_sheet, by_certificate)]
    assert u[0] == pytest.approx(u[1], rel=1e-6)


def test_mismatch_counts_in_another_light_only(calibrate):
    calibration, observations = calibrate(CERTIFICATE, f1_prime=0.03)
    mismatch = row(budget(calibration, 10.0).rows, "meter f1'")
    assert (mismatch.included, mismatch.u_rel) == (True, pytest.approx(0.03 / sqrt(3)))
    seen = patch_luminance(calibration, observations["P4"])
    assert seen.common_rel == pytest.approx(sqrt(seen.fit_rel**2 + 0.004**2 + 0.03**2 / 3))


def read_at(day, value=10.0, **changes):
    return {"P": [make_reading(value, timestamp=datetime.combine(day, time(12), UTC), **changes)]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"date": date(2018, 3, 3)}, r"certificate 1 of 2018-03-03 is later than the readings .* of 2018-03-01: give"),
        ({"serial": "73323008"}, "certificate 1 is of the meter LS-110 73323008, not of LS-110 73323007, which took"),
        ({"model": "LS-150", "serial": "73323007"}, "certificate 1 is of the meter LS-150 73323007, not of LS-110"),
    ],
)
def test_a_certificate_of_a_later_day_or_another_meter_is_refused(setup, camera, changes, message):
    """Through the whole fit, which has its readings on 1 March 2018."""
    certificate = CERTIFICATE.model_copy(update=changes)
    with pytest.raises(CalibrationError, match=message):
        fit(*bench(camera, luminances=FEW_CD_M2, exposures_s=FEW_S), replace(setup, certificate=certificate))
    if "date" in changes:
        as_found = certificate.model_copy(update={"as_found": True})
        assert meter_scale(read_at(date(2018, 3, 1)), as_found).certificate == as_found


def test_a_certificate_of_this_meter_and_of_the_day_itself_in_any_time_zone_is_taken():
    for changes in ({"date": date(2018, 3, 2)}, {"model": "Konica Minolta LS-110"}, {"serial": METER.serial}):
        certificate = CERTIFICATE.model_copy(update=changes)
        assert meter_scale(read_at(date(2018, 3, 1)), certificate).certificate == certificate


def test_drift_since_the_certificate_counts_by_its_days(calibrate):
    """1 % a year: from 1 January to 1 March 2018 there are 31 + 28 days, and 365 more a year later."""
    certificate = CERTIFICATE.model_copy(update={"drift_rel_per_year": 0.01})
    u = 0.01 * 59 / 365.2425 / sqrt(3)
    calibration, observations = calibrate(certificate)
    drift = row(budget(calibration, 10.0).rows, "meter drift")
    assert (drift.included, drift.distribution, drift.evaluation) == (True, "rectangular", "B")
    assert drift.u_rel == pytest.approx(u, rel=1e-12)
    without, _ = calibrate(CERTIFICATE)
    seen = [patch_luminance(one, observations["P4"]).common_rel for one in (calibration, without)]
    assert seen[0] ** 2 - seen[1] ** 2 == pytest.approx(u**2, rel=1e-9)
    later = meter_scale(read_at(date(2019, 3, 1)), certificate)
    (apart,) = scales_apart(later, calibration.meter_scale)
    # The certificate's own U cancels between the two, the drift of a year does not.
    assert apart.common_rel == pytest.approx(0.01 * 365 / 365.2425 / sqrt(3), rel=1e-12)
    assert scales_apart(later, later) == ()


def found(scale, readings):
    return {one.code: one for one in scale.findings(readings)}


@pytest.mark.parametrize(("calibrated", "said"), [("2018-02-01", True), ("2018-01-01", False), ("2018-03-02", False)])
def test_a_certificate_of_an_earlier_calibration_is_named(calibrated, said):
    readings = read_at(date(2018, 3, 1), meter=replace(METER, calibration_date=calibrated))
    assert ("certificate-of-earlier-calibration" in found(meter_scale(readings, CERTIFICATE), readings)) == said


def test_patches_outside_the_range_of_the_certificate_are_named():
    certificate = CERTIFICATE.model_copy(update={"range_cd_m2": (1.0, 100.0), "correction": 1.0})
    readings = {name: [make_reading(v)] for name, v in (("a", 0.5), ("b", 1.0), ("c", 100.0), ("d", 250.0), ("e", 0))}
    exceeded = found(meter_scale(readings, certificate), readings)["certificate-range-exceeded"]
    assert (exceeded.severity, exceeded.values["patches"]) == ("warning", ["a", "d"])
    inside = {name: readings[name] for name in "bce"}
    assert "certificate-range-exceeded" not in found(meter_scale(inside, certificate), inside)


@pytest.mark.parametrize(
    ("certificate", "f1_prime", "light", "severity"),
    [
        (CERTIFICATE, None, "LED-B4", "warning"),
        (None, None, "LED-B4", "info"),
        (CERTIFICATE, 0.08, "LED-B4", None),
        (CERTIFICATE, None, "a", None),
        (CERTIFICATE.model_copy(update={"illuminant": "LED-B4"}), None, "LED-B4", None),
        (CERTIFICATE, None, "", None),
    ],
)
def test_light_that_the_meter_was_not_calibrated_in_is_a_term_or_a_finding(certificate, f1_prime, light, severity):
    readings = read_at(date(2018, 3, 1))
    scale = meter_scale(readings, certificate, f1_prime, light)
    said = found(scale, readings).get("meter-mismatch-not-stated")
    assert (said and said.severity) == severity
    assert scale.mismatch_rel == pytest.approx((f1_prime or 0.0) / sqrt(3))


def test_what_a_certificate_leaves_open_is_named_once():
    readings = read_at(date(2018, 3, 1))
    missing = found(meter_scale(readings, PLAIN), readings)["certificate-not-checked"].values["missing"]
    assert missing == ["serial", "range_cd_m2", "due_date or drift_rel_per_year"]
    whole = {"serial": METER.serial, "range_cd_m2": (1.0, 100.0), "due_date": date(2019, 1, 1)}
    certificate = PLAIN.model_copy(update=whole)
    assert found(meter_scale(readings, certificate, light="A"), readings) == {}


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


@pytest.mark.parametrize(
    ("light", "chromaticity", "differs"),
    [
        # x and y of CIE 15: A, D65, LED-B3.
        ("A", (0.4476, 0.4074), False),
        ("A", (0.3127, 0.3290), True),
        ("D65", (0.3200, 0.3400), False),
        ("LED-B3", (0.3756, 0.3723), False),
        ("LED-B3", (0.4476, 0.4074), True),
        ("A", None, False),
        ("", (0.3127, 0.3290), False),
        ("our lamp", (0.3127, 0.3290), False),
    ],
)
def test_a_chroma_meter_that_sees_other_light_than_stated_has_its_f1_prime_counted(light, chromaticity, differs):
    readings = {
        "dark": [make_reading(1.0, chromaticity=chromaticity and (0.2, 0.2))],
        "bright": [make_reading(10.0, chromaticity=chromaticity)],
    }
    scale = meter_scale(readings, CERTIFICATE, 0.06, light)
    assert ("chromaticity-differs" in found(scale, readings)) == differs
    assert bool(scale.mismatch_rel) == (differs or light != "A")
    if differs:
        text = finding_text(found(scale, readings)["chromaticity-differs"])
        assert f"saw x {chromaticity[0]:.4f}" in text
        assert f"{light} light has x" in text
