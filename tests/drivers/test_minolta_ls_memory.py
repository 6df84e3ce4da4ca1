"""References and colour correction factor of the LS-100/LS-110: what is told, what is written."""

from contextlib import contextmanager, suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.drivers.meter import MeterError, MeterProtocolError, MeterReportedError
from labcdp.drivers.minolta_ls import LS100, MeterMode, MinoltaLS100, MinoltaLS110, Reference
from labcdp.drivers.minolta_ls_memory import (
    colour_factor_characters,
    parse_colour_factor,
    parse_reference,
    reference_characters,
)
from labcdp.drivers.simulated.meter import PtyMeter, SimulatedLS
from labcdp.errors import InputError
from labcdp.reading import CD_M2_PER_FL

TIMEOUT_S = 0.4


class Recorder:
    """Keeps the commands an engine received after opening."""

    def __init__(self, engine):
        self.engine = engine
        self.received = []

    def answer(self, command):
        self.received.append(command)
        return self.engine.answer(command)

    @property
    def commands(self):
        return [command.decode().strip() for command in self.received[4:]]


@contextmanager
def opened(luminance_cd_m2, driver=MinoltaLS110, **options):
    engine = Recorder(SimulatedLS(lambda: luminance_cd_m2, **options))
    with PtyMeter(engine, response_time_s=0) as port, driver(port.port, timeout_s=TIMEOUT_S) as meter:
        yield engine, meter


# --- What the meter tells -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reply", "reference", "cd_m2"),
    [
        (b"OK00,f, 21.83\r\n", Reference(21.83, "fL"), 21.83 * CD_M2_PER_FL),
        (b"OK00,c,748000\r\n", Reference(748000, "cd/m2"), 748000),
        (b"OK00, c,  0.05", Reference(0.05, "cd/m2"), 0.05),
        (b"OK00,c, 125.35", Reference(125.35, "cd/m2"), 125.35),
    ],
)
def test_references_of_the_manual_and_with_blanks(reply, reference, cd_m2):
    assert parse_reference(reply) == reference
    assert parse_reference(reply).luminance_cd_m2 == pytest.approx(cd_m2)


@pytest.mark.parametrize(
    "reply",
    [b"", b"OK00", b"OK00,%, 21.83", b"OK00,c,21.83", b"OK00,c,      ", b"OK00,c,1.2.34", b"OK00,CcPH 83.02", b"\xff"],
)
def test_what_is_no_reference_is_shown(reply):
    with pytest.raises(MeterProtocolError, match=r"which is not a reference: check cable") as caught:
        parse_reference(reply)
    assert repr(reply) in str(caught.value)


@pytest.mark.parametrize(("reply", "factor"), [(b"OK00,0.990\r\n", 0.99), (b"OK00, 1.234", 1.234)])
def test_colour_factor_of_the_manual(reply, factor):
    assert parse_colour_factor(reply) == factor


@pytest.mark.parametrize("reply", [b"", b"OK00", b"OK00,.990", b"OK00,0.99", b"OK00,10.000", b"OK00,0.990x"])
def test_what_is_no_colour_factor_is_shown(reply):
    with pytest.raises(MeterProtocolError, match=r"which is not a colour correction factor: check cable"):
        parse_colour_factor(reply)


@pytest.mark.parametrize("parse", [parse_reference, parse_colour_factor])
def test_error_codes_are_reported(parse):
    with pytest.raises(MeterReportedError, match=r"^ER11: .*store the reference"):
        parse(b"ER11\r\n")


@given(st.binary(max_size=24) | st.from_regex(rb"OK00,[ cf,.0-9]{0,16}", fullmatch=True))
def test_arbitrary_bytes_raise_nothing_but_meter_errors(reply):
    for parse in (parse_reference, parse_colour_factor):
        with suppress(MeterError):
            parse(reply)


# --- What the driver writes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "decimals", "characters"),
    [
        (21.83, 2, "021.83"),
        (0.01, 2, "000.01"),
        (0.001, 3, "00.001"),
        (1.2345, 3, "01.235"),
        (125.35, 2, "0125.4"),
        (125.25, 2, "0125.3"),
        (99.996, 2, "0100.0"),
        (9999.4, 2, "009999"),
        (9999.5, 2, "010000"),
        (748000, 2, "748000"),
        (748049, 2, "748000"),
        (999949, 2, "999900"),
    ],
)
def test_references_have_six_characters_and_four_valid_digits(value, decimals, characters):
    assert reference_characters(value, decimals) == characters


@given(st.floats(0.01, 999_949))
def test_a_written_reference_is_the_value_to_four_digits(value):
    characters = reference_characters(value, 2)
    assert len(characters) == 6
    assert len(characters.strip("0").replace(".", "").strip("0")) <= 4
    half_digit = max(0.005, 0.5 * 10 ** (len(str(int(value))) - 4))
    assert abs(float(characters) - value) <= half_digit * (1 + 1e-9)


@pytest.mark.parametrize("value", [0, 0.004, -1, 999_950, 1e300, float("inf"), float("nan")])
def test_references_out_of_range_are_not_sent(value):
    with opened(100.0) as (engine, meter):
        for write in (meter.write_full_scale, meter.write_user_reference):
            with pytest.raises(
                InputError, match=r"the reference is .*: give a number from 0\.01 to 999900 in the meter"
            ):
                write(value)
        assert engine.commands == []


@pytest.mark.parametrize(
    ("factor", "characters"), [(1, "1.000"), (0.99, "0.990"), (0.0005, "0.001"), (9.9994, "9.999")]
)
def test_colour_factors_have_three_decimals(factor, characters):
    assert colour_factor_characters(factor) == characters


@pytest.mark.parametrize("factor", [0, 0.0004, -0.5, 9.9995, 10, 1e300, float("inf"), float("nan")])
def test_colour_factors_out_of_range_are_not_sent(factor):
    with opened(100.0) as (engine, meter):
        with pytest.raises(InputError, match=r"colour correction factor is .*: give a number from 0\.001 to 9\.999"):
            meter.write_colour_factor(factor)
        assert engine.commands == []


# --- The commands on the wire -------------------------------------------------------------------------------------


def test_every_command_of_the_manual_on_the_wire():
    with opened(50.0) as (engine, meter):
        meter.measure()
        meter.read_held()
        meter.set_mode(MeterMode.SLOW)
        meter.store_full_scale()
        assert meter.read_full_scale() == Reference(50.0, "cd/m2")
        assert meter.write_full_scale(40) == 40
        assert meter.write_user_reference(51.237) == 51.24
        assert meter.read_user_reference() == Reference(51.24, "cd/m2")
        assert meter.write_colour_factor(0.98) == 0.98
        assert meter.read_colour_factor() == 0.98
        meter.clear_memory()
    assert engine.commands == [
        *("MES", "DSR", "MDS,07", "CMS", "CMR", "CMW,040.00", "LMW,051.24", "LMR", "CCW,0.980", "CCR", "CLE"),
    ]


def test_a_ratio_is_a_share_of_the_written_reference():
    with opened(50.0) as (_, meter):
        meter.write_full_scale(200)
        meter.set_mode(MeterMode.RATIO)
        reading = meter.measure()
    assert (reading.value, reading.unit, reading.correction) == (25.0, "%", None)


def test_references_are_in_the_unit_the_meter_is_switched_to():
    with opened(342.62591, unit="fL") as (_, meter):
        meter.write_full_scale(21.83)
        assert meter.read_full_scale() == Reference(21.83, "fL")
        assert meter.read_full_scale().luminance_cd_m2 == pytest.approx(74.795, abs=0.001)


@pytest.mark.parametrize(
    ("mode", "correction", "value"),
    [
        (MeterMode.PRESET, "preset", 50.0),
        (MeterMode.VARI_CCF, "colour", 45.0),
        (MeterMode.VARI_LUMI, "luminance", 55.0),
        (MeterMode.VARI_CCF_LUMI, "both", 49.5),
    ],
)
def test_corrections_change_the_reading_and_it_says_so(mode, correction, value):
    with opened(50.0) as (_, meter):
        meter.measure()
        meter.write_user_reference(55)
        meter.write_colour_factor(0.9)
        meter.set_mode(mode)
        reading = meter.measure()
    assert (reading.correction, reading.value) == (correction, value)


def test_what_was_never_stored_is_an_error_of_the_meter():
    with opened(50.0) as (_, meter), pytest.raises(MeterReportedError, match=r"^ER11"):
        meter.read_full_scale()


def test_the_ls100_takes_a_third_decimal():
    with opened(0.5, MinoltaLS100, data_sheet=LS100) as (engine, meter):
        assert meter.write_full_scale(0.1234) == 0.123
    assert engine.commands == ["CMW,00.123"]


# --- Modes --------------------------------------------------------------------------------------------------------


def test_the_modes_set_by_the_driver_are_known():
    with opened(50.0) as (_, meter):
        assert meter.modes == (MeterMode.PRESET, MeterMode.ABS, MeterMode.FAST, MeterMode.CONT)
        for mode in (MeterMode.SLOW, MeterMode.PEAK, MeterMode.VARI_CCF, MeterMode.RATIO):
            meter.set_mode(mode)
        assert meter.modes == (MeterMode.VARI_CCF, MeterMode.RATIO, MeterMode.SLOW, MeterMode.PEAK)
        meter.close()
        assert meter.modes == ()
        meter.open()
        assert meter.modes == (MeterMode.PRESET, MeterMode.ABS, MeterMode.FAST, MeterMode.CONT)


@pytest.mark.parametrize(
    ("mode", "luminance_cd_m2", "warned"),
    [
        (MeterMode.FAST, 0.0, "0 cd/m^2 is outside the range of the LS-110 with FAST response, 0.01 to 999900 cd/m^2"),
        (MeterMode.SLOW, 0.0, "0 cd/m^2 is outside the range of the LS-110 with SLOW response, 0.01 to 499900 cd/m^2"),
        (MeterMode.FAST, 0.01, None),
        (MeterMode.SLOW, 499_900.0, None),
        (MeterMode.RATIO, 0.0, None),
    ],
)
def test_readings_outside_the_range_of_the_response_are_noticed(caplog, mode, luminance_cd_m2, warned):
    with opened(luminance_cd_m2) as (_, meter):
        meter.write_full_scale(100)
        meter.set_mode(mode)
        meter.measure()
    messages = [record.getMessage() for record in caplog.records]
    assert len(messages) == (warned is not None)
    assert warned is None or warned in messages[0]


def test_slow_ends_earlier_than_fast():
    with opened(600_000.0) as (_, meter):
        assert meter.measure().value == 600_000
        meter.set_mode(MeterMode.SLOW)
        with pytest.raises(MeterReportedError, match=r"^ER10: .*change from SLOW to FAST"):
            meter.measure()
