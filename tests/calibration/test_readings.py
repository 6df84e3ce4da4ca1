from dataclasses import replace
from datetime import timedelta
from math import hypot, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.calibration.readings import combine_readings, meter_scale
from labcdp.errors import CalibrationError, InputError
from labcdp.reading import CD_M2_PER_FL, MeterIdentity


def at_times(readings):
    """Return the same readings, a second apart."""
    return [replace(r, timestamp=r.timestamp + timedelta(seconds=i)) for i, r in enumerate(readings)]


@given(n=st.integers(1, 50), value=st.floats(0.1, 9000))
def test_repeatability_averages_down_and_digits_do_not(new_reading, n, value):
    reading, warnings = combine_readings("grey", at_times([new_reading(value, digits_half_width=0.02)] * n))
    assert warnings == []
    assert (reading.patch, reading.n_readings) == ("grey", n)
    assert reading.luminance_cd_m2 == pytest.approx(value)
    assert reading.random_cd_m2 == pytest.approx(hypot(0.002 * value / sqrt(n), 0.02 / sqrt(3)))


def test_foot_lamberts_are_converted(new_reading):
    reading, _ = combine_readings("grey", [new_reading(10.0, unit="fL", repeatability_rel=0.0, digits_half_width=0.1)])
    assert reading.luminance_cd_m2 == pytest.approx(34.262591, rel=1e-7)
    assert reading.random_cd_m2 == pytest.approx(0.1 * CD_M2_PER_FL / sqrt(3))


def test_unsteady_light_is_reported_and_counted(new_reading):
    values = [100.0, 110.0, 90.0, 105.0]
    reading, (warning,) = combine_readings("grey", [new_reading(v) for v in values])
    assert warning.startswith("the readings of patch 'grey' scatter by 8.43%, more than the meter does")
    digits = 0.01 / sqrt(3)
    assert reading.random_cd_m2 == pytest.approx(hypot(np.std(values, ddof=1) / 2, digits))


def test_usual_scatter_is_not_reported(new_reading):
    rng = np.random.default_rng(1)
    groups = [[new_reading(100 * (1 + rng.normal(0, 0.002))) for _ in range(5)] for _ in range(500)]
    reported = sum(bool(combine_readings("grey", group)[1]) for group in groups)
    assert reported <= 500 * 0.001 + 4 * sqrt(500 * 0.001)


def test_any_scatter_of_a_meter_without_error_is_reported(new_reading):
    exact = {"repeatability_rel": 0.0, "digits_half_width": 0.0}
    _, warnings = combine_readings("grey", [new_reading(100.0, **exact), new_reading(100.1, **exact)])
    assert len(warnings) == 1


def test_ratio_is_refused(new_reading):
    with pytest.raises(InputError, match=r"is a ratio in %, not a luminance: set the meter to ABS"):
        combine_readings("grey", [new_reading(83.0, unit="%", raw="OK00,P% H 83.02")])


def test_peak_is_refused(new_reading):
    with pytest.raises(CalibrationError, match="of patch 'grey' is a held peak: set the meter to CONT"):
        combine_readings("grey", [new_reading(83.0, peak=True)])


def test_no_reading_of_a_patch():
    with pytest.raises(CalibrationError, match="patch 'grey' has no meter reading: measure it, or leave the patch out"):
        combine_readings("grey", [])


def test_scale_is_the_widest_stated(new_reading):
    readings = {"a": [new_reading(1.0)], "b": [new_reading(2.0, scale_half_width_rel=0.03)]}
    scale = meter_scale(readings)
    assert (scale.meter.serial, scale.half_width_rel) == ("73323007", 0.03)


def test_two_meters_are_refused(new_reading):
    readings = {"a": [new_reading(1.0)], "b": [new_reading(2.0, meter=MeterIdentity("LS-100", "1"))]}
    with pytest.raises(
        CalibrationError, match="readings come from meters LS-110 73323007 and LS-100 1: calibrate with one"
    ):
        meter_scale(readings)


def test_no_readings_at_all():
    with pytest.raises(CalibrationError, match="there are no meter readings"):
        meter_scale({"a": []})


def test_copied_rows_count_once(new_reading):
    one = new_reading(100.0)
    reading, (warning,) = combine_readings("grey", [one, one, *at_times([new_reading(100.1)] * 3)[1:]])
    assert warning.startswith("1 readings of patch 'grey' are there twice, with the same time and value")
    assert (reading.n_readings, [row.reading for row in reading.left_out]) == (3, [2])


@pytest.mark.parametrize(
    ("bad", "hint"),
    [
        (1000.0, "10 times 100 cd/m^2 (it looks like a decimal point in the wrong place)"),
        (29.19, "0.292 times 100 cd/m^2 (it looks like a value in fL taken as cd/m^2, or the reverse)"),
        (130.0, "1.3 times 100 cd/m^2"),
    ],
)
def test_one_bad_reading_of_three_is_named_and_left_out(new_reading, bad, hint):
    reading, (warning,) = combine_readings("grey", at_times([new_reading(v) for v in (100.0, bad, 100.1)]))
    assert reading.luminance_cd_m2 == pytest.approx(100.05)
    assert [(row.patch, row.reading) for row in reading.left_out] == [("grey", 2)]
    assert warning.startswith(f"reading 2 of patch 'grey' is {bad:.4g} cd/m^2, {hint}")


def test_mean_time_of_the_readings(new_reading):
    reading, _ = combine_readings("grey", at_times([new_reading(100.0), new_reading(100.0), new_reading(100.0)]))
    assert reading.read_at == new_reading(100.0).timestamp + timedelta(seconds=1)
