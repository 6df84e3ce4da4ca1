"""References and colour correction factor of the LS-100/LS-110: what is told, what is written."""

from contextlib import contextmanager, suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.reading import CD_M2_PER_FL
from labcdp.drivers.meter import MeterError
from labcdp.drivers.minolta_ls.memory import (
    parse_colour_factor,
    parse_reference,
    reference_characters,
)
from labcdp.drivers.minolta_ls.meter import MeterMode, MinoltaLS110, Reference
from labcdp.drivers.simulated.meter.meter import PtyMeter, SimulatedLS

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


# --- Modes --------------------------------------------------------------------------------------------------------
