"""A meter whose readings are typed, and how numbers are read that people write."""

from contextlib import suppress
from datetime import UTC, datetime
from decimal import Decimal
from math import hypot, isfinite, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.drivers.manual_meter import ManualMeter
from labcdp.drivers.meter import Meter, MeterError, measure_series
from labcdp.drivers.written_reading import MeterAccuracy, WrittenLuminance, parse_written
from labcdp.errors import InputError
from labcdp.reading import CD_M2_PER_FL, MeterIdentity

METER = MeterIdentity("L 1003", "4711", "2026-01-15")
ACCURACY = MeterAccuracy(scale_half_width_rel=0.03, repeatability_rel=0.005, digits=2)


class Person:
    """Types prepared answers and keeps the prompts."""

    def __init__(self, *answers):
        self.answers = list(answers)
        self.prompts = []

    def __call__(self, prompt):
        self.prompts.append(prompt)
        if not self.answers:
            raise EOFError
        return self.answers.pop(0)


def measured(*answers):
    with ManualMeter(Person(*answers), METER, ACCURACY) as meter:
        return meter.measure()


# --- The meter ----------------------------------------------------------------------------------------------------


def test_a_typed_number_is_a_reading():
    before = datetime.now(UTC)
    reading = measured(" 12,30 ")
    assert (reading.value, reading.unit, reading.resolution) == (12.3, "cd/m2", 0.01)
    assert reading.meter == METER
    assert before <= reading.timestamp <= datetime.now(UTC)
    assert reading.raw == " 12,30 "
    assert (reading.peak, reading.held, reading.correction) == (False, True, None)
    assert reading.standard_uncertainty_common_rel == pytest.approx(0.03 / sqrt(3))
    assert reading.standard_uncertainty_random_cd_m2 == pytest.approx(hypot(0.02 / sqrt(3), 0.005 * 12.3))


def test_a_unit_may_be_typed():
    reading = measured("3.4 fL")
    assert reading.luminance_cd_m2 == pytest.approx(3.4 * CD_M2_PER_FL)


def test_the_prompt_says_what_and_how_and_again_why():
    person = Person("twelve", "-3", "12.3")
    with ManualMeter(person, METER, ACCURACY) as meter:
        assert meter.measure().value == 12.3
    assert person.prompts[0] == "Luminance shown by L 1003, in cd/m2 or with its unit like 3.4 fL: "
    assert person.prompts[1].startswith("'twelve' is not a number: write it like 12.3, 12,3 or 3.4 fL. Luminance")
    assert person.prompts[2].startswith("-3 is negative: a luminance is at least 0. Luminance")


def test_three_answers_that_are_no_luminance_end_in_an_error():
    with pytest.raises(MeterError, match=r"no luminance was typed in 3 attempts, last: 'c' is not a number: write it"):
        measured("a", "b", "c", "12.3")


def test_nobody_there_is_an_error():
    with pytest.raises(MeterError, match="nobody types the readings of the luminance meter: run the command where"):
        measured("a")


def test_a_meter_that_is_not_open_asks_nobody():
    person = Person("12.3")
    meter = ManualMeter(person, METER, ACCURACY)
    with pytest.raises(MeterError, match=r"^L 1003: the meter is not open: call open\(\)"):
        meter.measure()
    with meter:
        pass
    meter.close()
    with pytest.raises(MeterError, match="not open"):
        meter.measure()
    assert person.prompts == []


def test_it_is_a_meter_like_any_other():
    meter: Meter = ManualMeter(Person("10", "12", "14"), METER, ACCURACY)
    with meter:
        series = measure_series(meter, 3)
    assert (series.mean_cd_m2, series.scatter_cd_m2) == (12, 2)
    assert meter.identity is METER


@pytest.mark.parametrize("name", ["scale_half_width_rel", "repeatability_rel", "digits"])
@pytest.mark.parametrize("value", [-1, float("nan"), float("inf")])
def test_an_accuracy_is_not_negative(name, value):
    values = {"scale_half_width_rel": 0.02, "repeatability_rel": 0.002, "digits": 1} | {name: value}
    with pytest.raises(InputError, match=f"{name} is {value}: give a number of at least 0"):
        MeterAccuracy(**values)


# --- Numbers as people write them ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value", "unit", "resolution"),
    [
        ("12.3", 12.3, None, 0.1),
        ("12,3", 12.3, None, 0.1),
        ("  12.30\t", 12.3, None, 0.01),
        ("3.4 fL", 3.4, "fL", 0.1),
        ("3.4fl", 3.4, "fL", 0.1),
        ("12,3 cd/m2", 12.3, "cd/m2", 0.1),
        ("12.3cd/m^2", 12.3, "cd/m2", 0.1),
        ("12.3 cd/m²", 12.3, "cd/m2", 0.1),
        ("12.3 CD/M2", 12.3, "cd/m2", 0.1),
        ("0,123", 0.123, None, 0.001),
        ("1234,567", 1234.567, None, 0.001),
        ("1500", 1500, None, 1),
        ("1.5e3", 1500, None, 100),
        ("1,5E+03 cd/m2", 1500, "cd/m2", 100),
        ("+7", 7, None, 1),
        (".5", 0.5, None, 0.1),
        ("5.", 5, None, 1),
        ("0", 0, None, 1),
    ],
)
def test_ways_to_write_a_luminance(text, value, unit, resolution):
    written = parse_written(text)
    assert (written.value, written.unit) == (value, unit)
    assert written.resolution == pytest.approx(resolution)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"'' is not a number: write it like 12\.3, 12,3 or 3\.4 fL"),
        ("abc", "'abc' is not a number"),
        ("fL", "'fL' is not a number"),
        ("nan", "'nan' is not a number"),
        ("inf", "'inf' is not a number"),
        ("1 2", "'1 2' is not a number"),
        ("12.3 fL 4", "the unit 'fL 4' is not known"),
        ("-1", "-1 is negative: a luminance is at least 0"),
        ("1.234,5", r"'1\.234,5' is not a number: write it with one decimal point or comma"),
        ("1,234.5", r"'1,234\.5' is not a number: write it with one"),
        (".", r"'\.' is not a number: write it with one"),
        (",", "',' is not a number"),
        ("1" * 16, "'1{16}' is not a number"),
        ("1,234", r"'1,234' can mean 1\.234 or 1234: write one of these"),
        ("12,345 fL", r"'12,345' can mean 12\.345 or 12345"),
        ("12 lx", "the unit 'lx' is not known: give cd/m2 or fL$"),
        ("12 %", "the unit '%' is not known"),
        ("1e999", "the unit 'e999' is not known"),
    ],
)
def test_what_is_no_luminance_says_why(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_written(text)
    assert "\n" not in str(caught.value)


def test_where_a_comma_can_only_be_decimal_it_is():
    assert parse_written("1,234", comma_is_decimal=True) == WrittenLuminance(1.234, None, 0.001)


@given(
    number=st.integers(0, 10**9),
    places=st.integers(0, 9),
    comma=st.booleans(),
    blanks=st.text(" \t", max_size=3),
    unit=st.sampled_from([None, "fL", "cd/m2", "cd/m^2"]),
)
def test_a_written_number_is_read_with_its_last_digit(number, places, comma, blanks, unit):
    exact = Decimal(number).scaleb(-places)
    text = f"{exact:f}".replace(".", "," if comma else ".")
    written = parse_written(f"{blanks}{text}{blanks}{unit or ''}{blanks}", comma_is_decimal=True)
    assert written.value == float(exact)
    assert written.resolution == pytest.approx(10.0**-places, rel=1e-12)
    assert written.unit == {None: None, "fL": "fL"}.get(unit, "cd/m2")


@given(
    st.text(max_size=20) | st.from_regex(r"[-+]?[0-9.,]{0,8}([eE][-+]?[0-9]{0,3})? ?[a-zA-Z/2^%]{0,4}", fullmatch=True)
)
def test_any_text_is_a_luminance_or_an_input_error(text):
    with suppress(InputError):
        written = parse_written(text)
        assert isfinite(written.value)
        assert written.value >= 0
        assert 0 < written.resolution < 1e100


@given(st.text(max_size=20))
def test_the_meter_raises_nothing_but_its_error(text):
    with suppress(MeterError):
        assert measured(text, text, text).raw == text
