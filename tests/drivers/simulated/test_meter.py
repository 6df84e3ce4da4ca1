"""The simulated LS-100/LS-110: its numbers, its protocol and its errors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.drivers.minolta_ls.protocol import four_digits
from labcdp.drivers.simulated.meter import MeterErrorModel, SimulatedLS


def ask(engine, *commands):
    """Give the replies to some commands, all with CR LF on the wire, here without."""
    replies = [engine.answer(command.encode() + b"\r\n") for command in commands]
    assert all(reply.endswith(b"\r\n") for reply in replies)
    return [reply[:-2].decode() for reply in replies]


def meter(luminance=83.02, **options):
    return SimulatedLS(lambda: luminance, **options)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.004, "  0.00"),
        (0.005, "  0.01"),
        (83.02, " 83.02"),
        (99.994, " 99.99"),
        (99.995, " 100.0"),
        (999.96, "  1000"),
        (9999.5, " 10000"),
        (748000.0, "748000"),
        (999_899.0, "999900"),
    ],
)
def test_four_digits_in_six_characters(value, text):
    assert ask(meter(value), "MES") == [f"OK00,CcPH{text}"]


@given(st.floats(0, 999_949), st.sampled_from([2, 3]))
def test_numbers_are_the_nearest_of_four_digits(value, decimals):
    number = four_digits(value, decimals)
    assert len(number.as_tuple().digits) <= 4
    step = max(10.0**-decimals, 10.0 ** (np.floor(np.log10(max(value, 1e-3))) - 3))
    assert abs(float(number) - value) <= step / 2 * (1 + 1e-9)


# --- Commands -----------------------------------------------------------------------------------------------------


def test_measure_and_read_the_held_value():
    values = iter([83.02, 748049.0])
    engine = SimulatedLS(lambda: next(values))
    assert ask(engine, "MES", "DSR", "MES", "DSR") == [
        "OK00,CcPH 83.02",
        "OK00,CcPH 83.02",
        "OK00,CcPH748000",
        "OK00,CcPH748000",
    ]


@pytest.mark.parametrize(
    ("modes", "reply"),
    [
        (["00"], "OK00,CcPH 83.02"),
        (["08"], "OK00,PcPH 83.02"),
        (["08", "09"], "OK00,CcPH 83.02"),
        (["01"], "OK00,CcKH 83.02"),
        (["02"], "ER11"),
        (["03"], "ER11"),
        (["05"], "ER11"),
        (["05", "04"], "OK00,CcPH 83.02"),
        (["07", "08", "01"], "OK00,PcKH 83.02"),
    ],
)
def test_modes_show_in_the_flags(modes, reply):
    engine = meter()
    assert ask(engine, *(f"MDS,{mode}" for mode in modes)) == ["OK00"] * len(modes)
    assert ask(engine, "MES") == [reply]


def test_the_unit_switch_converts():
    engine = meter(342.62591)
    assert ask(engine, "MES") == ["OK00,CcPH 342.6"]
    engine.unit = "fL"
    assert ask(engine, "MES") == ["OK00,CfPH 100.0"]


def test_unknown_commands_and_bad_parameters():
    wrong = (b"", b"MES", b"mes\r\n", b"IDN\r\n", b"MES,\r\n", b"MDS\r\n", b"MDS,4\r\n", b"MDS,10\r\n", b"\xffMES\r\n")
    assert {meter().answer(command) for command in wrong} == {b"ER00\r\n"}


@given(st.binary(max_size=12))
def test_whatever_comes_is_answered(command):
    assert meter().answer(command + b"\r\n")[:2] in (b"OK", b"ER")


# --- Errors of the device -----------------------------------------------------------------------------------------


def test_repeatability_is_normal_and_of_the_size_given():
    n, sigma_rel = 2000, 0.01
    engine = meter(5000.0, errors=MeterErrorModel(repeatability_rel=sigma_rel, seed=5))
    values = np.array([float(reply[-6:]) for reply in ask(engine, *["MES"] * n)]) / 5000
    assert abs(values.mean() - 1) < 4 * sigma_rel / np.sqrt(n)
    assert abs(values.std(ddof=1) - sigma_rel) < 4 * sigma_rel / np.sqrt(2 * n)


def test_readings_depend_on_the_seed_alone():
    def series(seed):
        errors = MeterErrorModel(repeatability_rel=0.01, seed=seed)
        return ask(meter(5000.0, errors=errors), *["MES"] * 10)

    assert series(1) == series(1)
    assert series(1) != series(2)
