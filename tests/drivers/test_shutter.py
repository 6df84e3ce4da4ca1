"""A shutter or lamp: in this process and on a pseudo-terminal, its faults, and dark frames that need no hand."""

import re

import pytest

from labcdp.core.errors import InputError
from labcdp.drivers.shutter import SerialShutter, ShutterError
from labcdp.drivers.simulated.port import Fault
from labcdp.drivers.simulated.pty import PtyMeter
from labcdp.drivers.simulated.shutter import SimulatedShutter

LONG_S, SHORT_S = 60.0, 0.5


@pytest.fixture
def moves():
    return []


@pytest.fixture
def engine(moves):
    return SimulatedShutter(moves.append)


@pytest.fixture
def served(engine):
    with PtyMeter(engine, response_time_s=0) as served:
        yield served


@pytest.fixture(params=["in process", "on a terminal"])
def shutter(request, engine, served):
    opened = engine if request.param == "in process" else SerialShutter(served.port, timeout_s=LONG_S)
    with opened:
        yield opened


def test_it_moves_when_it_is_told(shutter, moves):
    for light in (0, 1, 0.25):
        shutter.set(light)
    assert moves == [0, 1, 0.25]
    shutter.close()
    shutter.close()


@pytest.mark.parametrize("light", [-0.1, 1.01, float("nan"), True])
def test_a_share_is_from_0_to_1(shutter, moves, light):
    with pytest.raises(InputError, match="give a share from 0"):
        shutter.set(light)
    assert moves == []


def test_one_that_is_jammed_says_so(shutter, engine):
    engine.jammed = True
    with pytest.raises(ShutterError, match="jammed"):
        shutter.set(0)


def test_a_lost_and_a_garbled_answer_are_asked_for_again(served, moves):
    with SerialShutter(served.port, timeout_s=SHORT_S, attempts=3) as shutter:
        served.inject(Fault(reply=b""), Fault(reply=b"\x00?!\r\n"))
        shutter.set(0)
    assert moves == [0, 0, 0]


def test_a_late_answer_is_not_taken_for_that_to_the_next_command(served, moves):
    """Dark frames would be taken while the shutter is still open."""
    with SerialShutter(served.port, timeout_s=SHORT_S, attempts=1) as shutter:
        served.inject(Fault(delay_s=1.5 * SHORT_S), Fault(reply=b"ERROR stuck\r\n"))
        with pytest.raises(ShutterError, match="did not answer to SET 1"):
            shutter.set(1)
        with pytest.raises(ShutterError, match="answered 'ERROR stuck' to SET 0"):
            shutter.set(0)
        shutter.set(0.5)
    assert moves[-1] == 0.5


@pytest.mark.parametrize("fault", [Fault(reply=b""), Fault(n_bytes=1)])
def test_a_silent_one_ends_in_one_line(served, fault):
    with SerialShutter(served.port, timeout_s=SHORT_S, attempts=1) as shutter:
        served.inject(fault)
        with pytest.raises(ShutterError, match="did not answer to SET 1"):
            shutter.set(1)


def test_a_pulled_cable_and_a_missing_port_are_named(served):
    with SerialShutter(served.port, timeout_s=SHORT_S) as shutter:
        served.unplug()
        with pytest.raises(ShutterError, match=r"the shutter on .* was lost: check port, power and cable"):
            shutter.set(1)
        with pytest.raises(ShutterError, match="is not open"):
            shutter.set(1)
        with pytest.raises(ShutterError, match="cannot be reached"):
            shutter.open()
        served.plug_in()
        shutter.open().set(1)


@pytest.mark.parametrize("options", [{"timeout_s": 0}, {"timeout_s": float("nan")}, {"attempts": 0}])
def test_options_out_of_range(options):
    with pytest.raises(InputError, match=re.escape(next(iter(options)))):
        SerialShutter("nowhere", **options)


@pytest.mark.parametrize("command", [b"SET\r\n", b"SET two\r\n", b"SET 2\r\n", b"MOVE 1\r\n", b"SET 1"])
def test_what_it_does_not_understand(engine, moves, command):
    assert engine.answer(command).startswith(b"ERROR ")
    assert moves == []
