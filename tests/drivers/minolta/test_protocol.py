"""Replies of the LS-100/LS-110, parsed: units, flags, resolution, accuracy, error codes, garbage."""

import re
from contextlib import suppress
from datetime import UTC, datetime
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.reading import MeterIdentity
from labcdp.drivers.meter import MeterError, MeterReportedError
from labcdp.drivers.minolta.data_sheet import LS100, LS110
from labcdp.drivers.minolta.protocol import ERROR_CODES, parse_acknowledgement, parse_reading

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
    assert (reading.value, reading.unit, reading.resolution) == (value, unit, resolution)
    assert (reading.peak, reading.correction, reading.held) == (peak, correction, True)
    assert (reading.meter, reading.timestamp, reading.raw) == (METER, NOON, reply.decode().strip())


def test_every_flag():
    corrections = {"P": "preset", "L": "luminance", "K": "colour", "T": "both", " ": None}
    for flag, correction_flag, hold in product("CP", corrections, "MH"):
        reading = parse(f"OK00,{flag}c{correction_flag}{hold} 83.02".encode())
        flags = (reading.peak, reading.correction, reading.held)
        assert flags == (flag == "P", corrections[correction_flag], hold == "H")


@pytest.mark.parametrize(
    ("data_sheet", "number", "resolution", "half_width"),
    [
        *((LS110, number, 0.01, 0.02) for number in ("  0.00", "  9.99", "   .25")),
        *((LS110, " 83.02", 0.01, 0.01), (LS110, " 9.999", 0.001, 0.002), (LS110, "125.35", 0.1, 0.1)),
        *((LS110, "000500", 1, 1), (LS110, "  12. ", 1, 1), (LS110, " 50000", 10, 10), (LS110, "748000", 100, 100)),
        *((LS100, " 0.999", 0.001, 0.002), (LS100, " 1.000", 0.001, 0.001)),
    ],
)
def test_last_digit_and_error_of_the_data_sheet(data_sheet, number, resolution, half_width):
    """The last digit sent, at most the fourth; an error of 1 digit, of 2 in the lowest range; 2 % and 0.2 %."""
    reading = parse(f"OK00,CcPH{number}".encode(), data_sheet)
    assert (reading.resolution, reading.digits_half_width) == pytest.approx((resolution, half_width))
    assert (reading.scale_half_width_rel, reading.repeatability_rel) == (0.02, 0.002)


@pytest.mark.parametrize("code", [*ERROR_CODES, "ER77"])
def test_error_codes_are_errors_of_either_answer(code):
    for parser in (parse, parse_acknowledgement):
        with pytest.raises(MeterReportedError, match=f"^{code}: .+: .+"):
            parser(code.encode() + b"\r\n")


def changed(at, n, new):
    return VALID[:at] + new + VALID[at + n :]


VALID = b"OK00,CcPH 83.02\r\n"
ONE = st.binary(max_size=2) | st.sampled_from(b"0123456789 .,-+eEPCfc%").map(lambda one: bytes([one]))


@given(st.builds(changed, st.integers(0, 17), st.integers(0, 2), ONE) | st.binary(max_size=24))
def test_what_is_taken_for_a_reading_is_one_by_the_manual(reply):
    with suppress(MeterError):
        parse_acknowledgement(reply)
    try:
        reading = parse(reply)
    except MeterError:
        return
    shown = reply.removesuffix(b"\r\n")
    assert re.fullmatch(rb"OK00,[CP][cf%][PLKT ][MH][ 0-9.]{6}", shown)
    assert reading.value == float(shown[9:])


@pytest.mark.parametrize("data_sheet", [LS100, LS110])
@given(data=st.data())
def test_numbers_survive_the_format_of_the_meter(data_sheet, data):
    low, high = data_sheet.fast_range_cd_m2
    value = data.draw(st.floats(low, high))
    number = data_sheet.display(value)
    assert len(number.as_tuple().digits) <= 4
    reading = parse(f"OK00,CcPH{number:>6f}".encode(), data_sheet)
    assert abs(reading.value - value) <= reading.resolution / 2 * (1 + 1e-9)
    fourth = max(10**-data_sheet.decimals, 10.0 ** (len(str(int(reading.value))) - 4))
    assert reading.resolution == pytest.approx(fourth)
