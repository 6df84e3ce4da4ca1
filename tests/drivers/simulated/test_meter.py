"""The simulated LS-100/LS-110: its numbers, its protocol and its errors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.drivers.minolta.ls import MinoltaLS110
from labcdp.drivers.simulated.meter import MeterErrorModel, SimulatedLS
from labcdp.drivers.simulated.pty import PtyMeter


def ask(engine, *commands):
    """Give the replies to some commands, all with CR LF on the wire, here without."""
    replies = [engine.answer(command.encode() + b"\r\n") for command in commands]
    assert all(reply.endswith(b"\r\n") for reply in replies)
    return [reply[:-2].decode() for reply in replies]


def meter(luminance=83.02, **options):
    return SimulatedLS(lambda: luminance, **options)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.004, "  0.00"), (0.005, "  0.01"), (99.995, " 100.0"), (9999.5, " 10000"), (748049.0, "748000")],
)
def test_four_digits_in_six_characters_are_held(value, text):
    assert ask(meter(value), "MES", "DSR") == [f"OK00,CcPH{text}"] * 2


@pytest.mark.parametrize("command", [b"", b"MES", b"mes\r\n", b"MES,\r\n", b"MDS\r\n", b"MDS,4\r\n", b"MDS,10\r\n"])
def test_unknown_commands_and_bad_parameters(command):
    assert meter().answer(command) == b"ER00\r\n"


@given(st.binary(max_size=12))
def test_whatever_comes_is_answered(command):
    assert meter().answer(command + b"\r\n")[:2] in (b"OK", b"ER")


def test_repeatability_is_normal_of_the_size_given_and_depends_on_the_seed_alone():
    n, sigma_rel = 2000, 0.01

    def series(seed):
        return ask(meter(5000.0, errors=MeterErrorModel(repeatability_rel=sigma_rel, seed=seed)), *["MES"] * n)

    values = np.array([float(reply[-6:]) for reply in series(5)]) / 5000
    assert abs(values.mean() - 1) < 4 * sigma_rel / np.sqrt(n)
    assert abs(values.std(ddof=1) - sigma_rel) < 4 * sigma_rel / np.sqrt(2 * n)
    assert series(1) == series(1) != series(2)


class Real(SimulatedLS):
    """The manual knows no such command."""

    def answer(self, command):
        return super().answer(command.replace(b"SIM", b"???"))


@pytest.mark.parametrize(("kind", "simulated"), [(SimulatedLS, True), (Real, False)])
def test_a_simulated_meter_says_so_and_a_real_one_behind_a_pseudo_terminal_does_not(kind, simulated):
    with PtyMeter(kind(lambda: 83.02), response_time_s=0) as served, MinoltaLS110(served.port) as driver:
        assert driver.ask_if_simulated() is simulated
        assert driver.measure().meter.simulated is simulated
