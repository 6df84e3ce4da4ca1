"""Replies of the CS-100A and of a meter's program, parsed: colour, range, decimal commas, garbage."""

import re
from contextlib import suppress
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.reading import MeterIdentity
from labcdp.drivers.meter import MeterError, MeterProtocolError, MeterReportedError
from labcdp.drivers.minolta.cs100a import parse_chroma_reading
from labcdp.drivers.minolta.data_sheet import CS150, LS160
from labcdp.drivers.minolta.program import parse_program_reading

METER = MeterIdentity("CS-100A", "1")
NOON = datetime(2018, 6, 1, 12, tzinfo=UTC)


def chroma(reply, unit="cd/m2"):
    return parse_chroma_reading(reply, unit, METER, NOON)


def program(reply, data_sheet=CS150):
    return parse_program_reading(reply, data_sheet, METER, NOON)


@pytest.mark.parametrize(
    ("reply", "value", "xy", "resolution"),
    [
        # The three forms that public programs for the meter read: signs, blanks, and blanks after the comma.
        (b"OK00,+  83.0,+.3127,+.3290\r\n", 83.0, (0.3127, 0.3290), 0.1),
        (b"OK00,   83.0, .3127, .3290\r\n", 83.0, (0.3127, 0.3290), 0.1),
        (b"OK00,+ 12400,+.4476,+.4074\r\n", 12400, (0.4476, 0.4074), 100),
        (b"OK11,+  83.0,+.0000,+.0000\r\n", 83.0, None, 0.1),
        (b"OK13,+  0.00,+.3127,+.3290\r\n", 0.0, None, 0.01),
    ],
)
def test_luminance_and_colour(reply, value, xy, resolution):
    reading = chroma(reply)
    assert (reading.value, reading.chromaticity, reading.unit, reading.correction) == (value, xy, "cd/m2", None)
    assert reading.resolution == pytest.approx(resolution)
    assert reading.raw == reply.decode().removesuffix("\r\n")


def test_the_unit_is_that_of_the_switch():
    assert chroma(b"OK00,+  10.0,+.3127,+.3290", "fL").luminance_cd_m2 == pytest.approx(34.262591)


@pytest.mark.parametrize(
    ("reply", "error", "text"),
    [
        (b"OK12,-999999,+.3127,+.3290\r\n", MeterReportedError, "OK12: the luminance is too large for the display"),
        (b"ER12\r\n", MeterReportedError, "ER12: luminance and chromaticity are outside"),
        (b"OK00,-  3.10,+.0010,-.0020\r\n", MeterProtocolError, "a difference from its target colour: set the meter"),
        (b"OK00,CcPH 83.02\r\n", MeterProtocolError, "is not a reading: check cable and model"),
    ],
)
def test_what_is_no_reading_of_a_cs_100a(reply, error, text):
    with pytest.raises(error, match=text):
        chroma(reply)


def changed(at, n, new):
    valid = b"OK00,+  83.0,+.3127,+.3290\r\n"
    return valid[:at] + new + valid[at + n :]


ONE = st.binary(max_size=2) | st.sampled_from(b"0123456789 .,-+eEOKR").map(lambda one: bytes([one]))


@given(st.builds(changed, st.integers(0, 28), st.integers(0, 2), ONE) | st.binary(max_size=30))
def test_what_is_taken_for_a_reading_of_a_cs_100a_is_one(reply):
    try:
        reading = chroma(reply)
    except MeterError:
        return
    fields = reply.removesuffix(b"\r\n").split(b",")
    assert fields[0] in (b"OK00", b"OK11", b"OK13")
    assert reading.value == float(fields[1].decode().replace("+", " "))
    if reading.chromaticity is not None:
        assert reading.chromaticity == tuple(float(f.decode().replace("+", " ")) for f in fields[2:])


@pytest.mark.parametrize("end", [b"\r\n", b"\n", b""])
@pytest.mark.parametrize(
    ("reply", "value", "xy", "resolution"),
    [
        (b"SUCCESS,83.02,0.3127,0.329", 83.02, (0.3127, 0.329), 0.01),
        (b"SUCCESS,83,0.3127,0.329", 83.0, (0.3127, 0.329), 0.01),
        (b"SUCCESS,83.0212345, 0.3127, 0.329", 83.0212345, (0.3127, 0.329), 0.01),
        (b"SUCCESS,1.5E-05,0,0", 1.5e-5, None, 0.01),
        (b"SUCCESS,250300", 250300.0, None, 100.0),
    ],
)
def test_a_program_sends_luminance_and_perhaps_colour(reply, value, xy, resolution, end):
    reading = program(reply + end)
    assert (reading.value, reading.chromaticity) == (value, xy)
    # Programs drop zeros at the end and add digits: the last digit counts that the display shows.
    assert reading.resolution == pytest.approx(resolution)


def test_the_accuracy_is_that_of_the_model():
    assert program(b"SUCCESS,5.0", LS160).digits_half_width == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("reply", "error", "text"),
    [
        (b"ERROR,Polling failed\r\n", MeterReportedError, "ERROR: Polling failed: see the display"),
        (b"ERROR\r\n", MeterReportedError, "no reason is given"),
        (b"SUCCESS,83,02,0,3127,0,3290\r\n", MeterProtocolError, "decimal comma: set a point in the regional settings"),
        (b"SUCCESS,Integration time set\r\n", MeterProtocolError, "is not a reading: check which program"),
        (b"SUCCESS,-1,0.3,0.3\r\n", MeterProtocolError, "a luminance is at least 0"),
        (b"SUCCESS,NaN,0.3,0.3\r\n", MeterProtocolError, "is not a reading"),
        (b"SUCCESS,1_0\r\n", MeterProtocolError, "is not a reading"),
    ],
)
def test_what_is_no_reading_of_a_program(reply, error, text):
    with pytest.raises(error, match=text):
        program(reply)


@given(st.text("SUCESRO,0123456789.-+eE \r\n", max_size=30).map(str.encode) | st.binary(max_size=30))
def test_what_is_taken_for_a_reading_of_a_program_is_one(reply):
    with suppress(MeterError):
        reading = program(reply)
        assert re.match(rb"SUCCESS, *\+?[0-9]", reply)
        assert reading.value >= 0
