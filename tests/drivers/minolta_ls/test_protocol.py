"""Replies of the LS-100/LS-110, parsed: units, flags, resolution, accuracy, error codes, garbage."""

from contextlib import suppress
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.reading import MeterIdentity
from labcdp.drivers.meter import MeterError, MeterProtocolError, MeterReportedError
from labcdp.drivers.minolta_ls.protocol import LS100, LS110, parse_acknowledgement, parse_reading
from labcdp.drivers.simulated.meter import format_number

METER = MeterIdentity("LS-110", "73323007", "2018-03-01")
NOON = datetime(2018, 6, 1, 12, tzinfo=UTC)


def parse(reply, data_sheet=LS110):
    return parse_reading(reply, data_sheet, METER, NOON)


@pytest.mark.parametrize(
    ("reply", "value", "unit", "peak", "correction", "resolution"),
    [
        (b"OK00,CfPH125.35\r\n", 125.35, "fL", False, "preset", 0.1),
        (b"OK00,P% H 83.02\r\n", 83.02, "%", True, None, 0.01),
        (b"OK00,CcPH748000\r\n", 748000, "cd/m2", False, "preset", 100),
    ],
)
def test_the_samples_of_the_manual(reply, value, unit, peak, correction, resolution):
    reading = parse(reply)
    assert reading.value == value
    assert reading.unit == unit
    assert reading.peak is peak
    assert reading.correction == correction
    assert reading.held is True
    assert reading.resolution == resolution
    assert reading.meter is METER
    assert reading.timestamp is NOON
    assert reading.raw == reply.decode().strip()


@pytest.mark.parametrize(("flag", "peak"), [("C", False), ("P", True)])
@pytest.mark.parametrize(("hold_flag", "held"), [("M", False), ("H", True)])
@pytest.mark.parametrize(
    ("correction_flag", "correction"),
    [("P", "preset"), ("L", "luminance"), ("K", "colour"), ("T", "both"), (" ", None)],
)
def test_every_flag(flag, peak, hold_flag, held, correction_flag, correction):
    reading = parse(f"OK00,{flag}c{correction_flag}{hold_flag} 83.02".encode())
    assert (reading.peak, reading.correction, reading.held) == (peak, correction, held)


@pytest.mark.parametrize(
    ("number", "resolution"),
    [
        ("  0.00", 0.01),
        ("  0.05", 0.01),
        ("  9.99", 0.01),
        (" 9.999", 0.001),
        (" 83.02", 0.01),
        ("  12.5", 0.1),
        ("125.35", 0.1),
        ("   500", 1),
        ("000500", 1),
        ("  5000", 1),
        (" 50000", 10),
        ("748000", 100),
        ("  12. ", 1),
        ("   .25", 0.01),
    ],
)
def test_resolution_is_the_last_digit_sent_but_at_most_the_fourth(number, resolution):
    assert parse(f"OK00,CcPH{number}".encode()).resolution == resolution


@pytest.mark.parametrize(
    ("data_sheet", "number", "unit_flag", "half_width"),
    [
        (LS110, "  0.05", "c", 0.02),
        (LS110, "  9.99", "c", 0.02),
        (LS110, " 10.00", "c", 0.01),
        (LS110, " 10.00", "f", 0.01),
        (LS110, " 10.00", "%", 0.02),
        (LS110, "125.35", "c", 0.1),
        (LS110, "748000", "c", 100),
        (LS100, " 0.999", "c", 0.002),
        (LS100, " 1.000", "c", 0.001),
        (LS100, "  9.99", "c", 0.01),
    ],
)
def test_digit_error_of_the_data_sheet(data_sheet, number, unit_flag, half_width):
    correction = " " if unit_flag == "%" else "P"
    reading = parse(f"OK00,C{unit_flag}{correction}H{number}".encode(), data_sheet)
    assert reading.digits_half_width == pytest.approx(half_width)
    assert reading.scale_half_width_rel == 0.02
    assert reading.repeatability_rel == 0.002


@pytest.mark.parametrize("parser", [parse, parse_acknowledgement])
@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("ER00", "did not understand .* repeat the command"),
        ("ER01", "cannot take this setting: check the mode"),
        ("ER10", "exceeds the measuring range: measure something darker"),
        ("ER11", "memory cannot be used: store the reference"),
        ("ER19", "too large for the display: set PRESET and ABS"),
        ("ER20", "EEPROM.* have the meter repaired"),
        ("ER30", "battery is exhausted: put in a new one"),
        ("ER77", "manual does not know this code: switch the meter off"),
    ],
)
def test_error_codes_say_what_they_mean_and_what_to_do(parser, code, says):
    with pytest.raises(MeterReportedError, match=f"^{code}: .*{says}") as caught:
        parser(code.encode() + b"\r\n")
    assert caught.value.code == code
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "reply",
    [
        b"",
        b"OK00",
        b"OK01,CcPH 83.02",
        b"OK00,XcPH 83.02",
        b"OK00,CxPH 83.02",
        b"OK00,CcXH 83.02",
        b"OK00,CcPX 83.02",
        b"OK00,CcPH83.02",
        b"OK00,CcPH      ",
        b"OK00,CcPH1.2.34",
        b"OK00,CcPH 1e+05",
        b"OK00,CcPH   nan",
        b"OK00,CcPH 83.02\n",
        b"OK00,CcPH 83.02\r\n\r\n",
        b"OK00,C\xe3PH 83.02",
        b"ER100",
    ],
)
def test_garbage_is_shown(reply):
    with pytest.raises(MeterProtocolError, match="not a reading") as caught:
        parse(reply)
    assert repr(reply.removesuffix(b"\r\n")) in str(caught.value)


@given(st.binary(max_size=24))
def test_arbitrary_bytes_raise_nothing_but_meter_errors(reply):
    for parser in (parse, parse_acknowledgement):
        with suppress(MeterError):
            parser(reply)


@pytest.mark.parametrize("data_sheet", [LS100, LS110])
@given(data=st.data())
def test_numbers_survive_the_format_of_the_meter(data_sheet, data):
    low, high = data_sheet.fast_range_cd_m2
    value = data.draw(st.floats(low, high))
    reading = parse(f"OK00,CcPH{format_number(value, data_sheet.decimals)}".encode(), data_sheet)
    assert abs(reading.value - value) <= reading.resolution / 2 * (1 + 1e-9)
    four_digits = max(10**-data_sheet.decimals, 10.0 ** (len(str(int(reading.value))) - 4))
    assert reading.resolution == pytest.approx(four_digits)
