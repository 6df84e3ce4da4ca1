"""A meter whose readings are typed, and how numbers are read that people write."""

import re
from contextlib import suppress
from datetime import UTC, datetime
from decimal import Decimal
from math import hypot, isfinite, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.reading import MeterIdentity
from labcdp.drivers.manual import ManualMeter, MeterAccuracy, parse_written
from labcdp.drivers.meter import MeterError

METER = MeterIdentity("L 1003", "4711", "2026-01-15")
ACCURACY = MeterAccuracy(scale_half_width_rel=0.03, repeatability_rel=0.005, digits=2)


def measured(*answers):
    """What is measured where somebody types these answers."""
    left = iter(answers)
    with ManualMeter(lambda _prompt: next(left), METER, ACCURACY) as meter:
        return meter.measure()


def test_a_typed_number_is_a_reading_and_three_others_are_an_error():
    before, reading = datetime.now(UTC), measured("twelve", "-3", " 12,30 ")
    assert (reading.value, reading.unit, reading.resolution) == (12.3, "cd/m2", 0.01)
    assert (reading.meter, reading.raw) == (METER, " 12,30 ")
    assert before <= reading.timestamp <= datetime.now(UTC)
    assert (reading.peak, reading.held, reading.correction) == (False, True, None)
    assert reading.standard_uncertainty_common_rel == pytest.approx(0.03 / sqrt(3))
    assert reading.standard_uncertainty_random_cd_m2 == pytest.approx(hypot(0.02 / sqrt(3), 0.005 * 12.3))
    with pytest.raises(MeterError, match="typed"):
        measured("a", "b", "c", "12.3")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *((text, "is not a number") for text in ("", "1 2", "1.234,5")),
        *((text, "the unit .* is not known") for text in ("12.3 fL 4", "12 lx")),
        ("1,234", r"can mean 1\.234 or 1234"),
    ],
)
def test_what_is_not_a_luminance_says_why(text, message):
    with pytest.raises(InputError, match=message):
        parse_written(text)


@given(
    number=st.integers(0, 10**9),
    places=st.integers(0, 9),
    exponent=st.none() | st.integers(-9, 9),
    comma=st.booleans(),
    blanks=st.text(" \t", max_size=3),
    unit=st.sampled_from([None, "fL", "cd/m2", "cd/m^2", "cd/m²"]),
    spelt=st.sampled_from([str, str.lower, "+{}".format, lambda text: re.sub("^0(?=[.,])", "", text)]),
)
def test_a_written_number_is_read_with_its_last_digit(number, places, exponent, comma, blanks, unit, spelt):
    text = f"{Decimal(number).scaleb(-places):f}" + ("" if exponent is None else f"E{exponent:+03}")
    places -= exponent or 0
    text = spelt(text.replace(".", "," if comma else ".")) or "0"
    written = parse_written(f"{blanks}{text}{blanks}{unit or ''}{blanks}", comma_is_decimal=True)
    assert (written.value, written.unit) == (
        float(Decimal(number).scaleb(-places)),
        {None: None, "fL": "fL"}.get(unit, "cd/m2"),
    )
    assert written.resolution == pytest.approx(10.0**-places, rel=1e-12)


@given(
    st.text(max_size=20) | st.from_regex(r"[-+]?[0-9.,]{0,8}([eE][-+]?[0-9]{0,3})? ?[a-zA-Z/2^%]{0,4}", fullmatch=True)
)
def test_any_text_is_a_luminance_or_an_input_error(text):
    with suppress(InputError):
        written = parse_written(text)
        assert isfinite(written.value)
        assert written.value >= 0
        assert 0 < written.resolution < 1e100
