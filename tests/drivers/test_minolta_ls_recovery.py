"""Recovery of the LS-100/LS-110 driver: garbage, late and broken-off answers, silence, a pulled cable, RTS/CTS."""

import logging
import os
import termios
import threading
from contextlib import contextmanager

import pytest

from labcdp.drivers.meter import (
    MeterError,
    MeterLostError,
    MeterProtocolError,
    MeterReportedError,
    MeterTimeoutError,
    measure_series,
)
from labcdp.drivers.minolta_ls import MeterMode, MinoltaLS110
from labcdp.drivers.simulated.meter import Fault, PtyMeter, SimulatedLS
from labcdp.errors import InputError

pytestmark = pytest.mark.timeout(30)

#: Short for a test, long for two threads on one machine.
TIMEOUT_S = 0.4
SILENCE, GARBAGE, NO_END = Fault(reply=b""), Fault(reply=b"\x00?!\r\n"), Fault(reply=b"U" * 100)
LATE, CUT = Fault(delay_s=1.5 * TIMEOUT_S), Fault(n_bytes=7)


class Engine(SimulatedLS):
    """A meter whose luminance grows by 1 cd/m^2 with each measurement, and which keeps its commands."""

    def __init__(self):
        values = iter(range(1, 1000))
        super().__init__(lambda: next(values))
        self.commands = []

    def answer(self, command):
        self.commands.append(command.decode().strip())
        return super().answer(command)


@contextmanager
def opened(**options):
    engine = Engine()
    with (
        PtyMeter(engine, response_time_s=0) as port,
        MinoltaLS110(port.port, **({"timeout_s": TIMEOUT_S} | options)) as meter,
    ):
        engine.commands.clear()
        yield engine, port, meter


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("attempts", 0, "attempts is 0: give at least 1"),
        ("patience_s", -1.0, "patience_s is -1.0: give a number of seconds of at least 0"),
        ("patience_s", float("inf"), "patience_s is inf: give"),
    ],
)
def test_options_are_checked(option, value, message):
    with pytest.raises(InputError, match=message):
        MinoltaLS110("/dev/no-such-port", **{option: value})


# --- Asking again -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fault", [SILENCE, GARBAGE, NO_END, LATE, CUT])
def test_a_failed_reading_is_asked_for_again_and_what_follows_is_in_step(fault, caplog):
    with opened(attempts=3) as (engine, port, meter):
        port.inject(fault)
        first = meter.measure().value
        # The reply to either of the two commands is a reading of this call, never of the next.
        assert first in (1.0, 2.0)
        assert meter.measure().value == engine.commands.count("MES")
        meter.set_mode(MeterMode.SLOW)
        assert meter.modes[2] is MeterMode.SLOW
    warnings = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
    assert warnings
    assert "asking again (attempt 2 of 3)" in warnings[0]


@pytest.mark.parametrize(
    ("fault", "error"), [(SILENCE, MeterTimeoutError), (GARBAGE, MeterProtocolError), (CUT, MeterTimeoutError)]
)
def test_a_command_is_sent_no_more_often_than_allowed(fault, error):
    with opened(attempts=2) as (engine, port, meter):
        port.inject(fault, fault)
        with pytest.raises(error):
            meter.measure()
        assert engine.commands == ["MES", "MES"]
        assert meter.measure().value == 3.0


def test_one_attempt_is_the_default():
    with opened() as (engine, port, meter):
        port.inject(GARBAGE)
        with pytest.raises(MeterProtocolError):
            meter.measure()
        assert engine.commands == ["MES"]


@pytest.mark.parametrize("code", ["ER01", "ER10", "ER11", "ER19", "ER20", "ER30"])
def test_codes_that_repeat_themselves_are_not_asked_for_again(code):
    with opened(attempts=3) as (engine, port, meter):
        port.inject(Fault(reply=code.encode() + b"\r\n"))
        with pytest.raises(MeterReportedError, match=rf"^{code}"):
            meter.measure()
        assert engine.commands == ["MES"]


def test_a_command_not_understood_is_sent_once_more():
    with opened(attempts=5) as (engine, port, meter):
        port.inject(Fault(reply=b"ER00\r\n"))
        assert meter.measure().value == 2.0
        port.inject(*[Fault(reply=b"ER00\r\n")] * 3)
        with pytest.raises(MeterReportedError, match=r"^ER00"):
            meter.measure()
        assert engine.commands == ["MES"] * 4


def test_other_commands_are_asked_again_too():
    with opened(attempts=2) as (engine, port, meter):
        port.inject(GARBAGE)
        assert meter.write_full_scale(50) == 50
        port.inject(SILENCE)
        assert meter.read_full_scale().value == 50
        assert engine.commands == ["CMW,050.00", "CMW,050.00", "CMR", "CMR"]


def test_opening_asks_again():
    engine = Engine()
    with PtyMeter(engine, response_time_s=0) as port:
        port.inject(Fault(), SILENCE)
        with MinoltaLS110(port.port, timeout_s=TIMEOUT_S, attempts=3):
            assert engine.commands == ["MDS,00", "MDS,04", "MDS,04", "MDS,06", "MDS,09"]


def test_opening_that_fails_again_and_again_ends_in_one_error():
    with PtyMeter(Engine(), response_time_s=0) as port:
        port.inject(*[GARBAGE, Fault()] * 4)
        with pytest.raises(MeterTimeoutError, match=r"earlier failures left no time for MDS,\d\d: check the cable"):
            MinoltaLS110(port.port, timeout_s=TIMEOUT_S, attempts=2).open()


def test_a_series_survives_faults_in_between():
    with opened(attempts=3) as (engine, port, meter):
        port.inject(Fault(), GARBAGE, Fault(), CUT, Fault(), SILENCE)
        series = measure_series(meter, 6)
        assert len({reading.value for reading in series.readings}) == 6
        assert engine.commands.count("MES") == 9


@pytest.mark.parametrize("n", [0, -1])
def test_a_series_has_at_least_one_reading(n):
    with opened() as (_, _, meter), pytest.raises(InputError, match=rf"number of readings is {n}: take at least 1"):
        measure_series(meter, n)


# --- A meter that is gone -----------------------------------------------------------------------------------------


def test_a_pulled_cable_is_waited_for_and_the_modes_restored(caplog):
    with opened(patience_s=8) as (engine, port, meter):
        meter.set_mode(MeterMode.SLOW)
        assert meter.measure().value == 1.0
        port.unplug()
        for command in (b"MDS,06\r\n", b"MDS,08\r\n"):
            engine.answer(command)
        back = threading.Timer(0.5, port.plug_in)
        back.start()
        engine.commands.clear()
        reading = meter.measure()
        back.join()
        assert (reading.value, reading.peak) == (2.0, False)
        assert engine.commands == ["MDS,00", "MDS,04", "MDS,07", "MDS,09", "MES"]
    warnings = [record.getMessage() for record in caplog.records]
    assert "waiting up to 8 s for the meter to come back" in warnings[0]
    assert "the meter is back, its modes are restored" in warnings[-1]


def test_a_pulled_cable_without_patience_is_one_error_and_a_free_port():
    with opened() as (_, port, meter):
        port.unplug()
        with pytest.raises(MeterLostError, match=r"the connection to the meter broke .*check cable and adapter"):
            meter.measure()
        with pytest.raises(MeterError, match=r"not open: call open\(\)"):
            meter.measure()
        port.plug_in()
        with MinoltaLS110(port.port, timeout_s=TIMEOUT_S) as other:
            assert other.measure().value == 1.0
        assert meter.open().measure().value == 2.0


def test_a_cable_that_stays_pulled_ends_in_one_error_that_tells_both_problems():
    before = len(os.listdir("/proc/self/fd"))
    with opened(patience_s=0.5, attempts=2) as (_, port, meter):
        port.unplug()
        with pytest.raises(MeterLostError, match=r"connection .* broke .*not come back within 0\.5 s, last: .*no such"):
            meter.measure()
        assert meter.modes == ()
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_meter_out_of_remote_mode_is_waited_for():
    with opened(patience_s=8) as (engine, _, meter):
        engine.remote = False
        back = threading.Timer(2 * TIMEOUT_S, lambda: setattr(engine, "remote", True))
        back.start()
        assert meter.measure().value == 1.0
        back.join()


def test_a_meter_that_answers_all_but_the_reading_ends_in_its_error():
    class Deaf(Engine):
        def answer(self, command):
            return b"" if command == b"MES\r\n" else super().answer(command)

    with (
        PtyMeter(Deaf(), response_time_s=0) as port,
        MinoltaLS110(port.port, timeout_s=TIMEOUT_S, patience_s=0.6) as meter,
    ):
        with pytest.raises(MeterError, match=r"no answer to MES|not come back"):
            meter.measure()
        with pytest.raises(MeterError, match=r"not open"):
            meter.measure()


def test_a_meter_that_is_back_with_an_empty_battery_says_so():
    with opened(patience_s=8) as (_, port, meter):
        port.unplug()
        port.plug_in()
        port.inject(Fault(reply=b"ER30\r\n"))
        with pytest.raises(MeterReportedError, match=r"^ER30: .*battery"):
            meter.measure()
        with pytest.raises(MeterError, match=r"not open"):
            meter.measure()


def test_a_port_taken_by_another_program_meanwhile_is_told():
    with opened(patience_s=0.5) as (_, port, meter):
        port.unplug()
        port.plug_in()
        with (
            MinoltaLS110(port.port, timeout_s=TIMEOUT_S),
            pytest.raises(MeterLostError, match=r"not come back within .* last: .*another program uses it"),
        ):
            meter.measure()


# --- RTS/CTS ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rtscts", [False, True])
def test_the_handshake_lines_are_heeded_as_asked(rtscts):
    with opened(rtscts=rtscts) as (_, port, _):
        other = os.open(port.port, os.O_RDWR | os.O_NOCTTY)
        try:
            control_flags = termios.tcgetattr(other)[2]
        finally:
            os.close(other)
        assert bool(control_flags & termios.CRTSCTS) is rtscts


def test_a_meter_that_never_takes_the_command_is_no_hang():
    """A pseudo-terminal has no CTS line; its output is stopped by the other switch the system has for it."""
    with opened(rtscts=True) as (engine, port, meter):
        other = os.open(port.port, os.O_RDWR | os.O_NOCTTY)
        try:
            termios.tcflow(other, termios.TCOOFF)
            with pytest.raises(
                MeterTimeoutError, match=r"does not take MES, it holds its RTS line low: check .*without"
            ):
                meter.measure()
            termios.tcflow(other, termios.TCOON)
        finally:
            os.close(other)
        assert meter.measure().value == 1.0
        assert engine.commands == ["MES"]


def test_a_meter_that_takes_the_command_late_is_asked_again():
    with opened(rtscts=True, attempts=8) as (_, port, meter):
        other = os.open(port.port, os.O_RDWR | os.O_NOCTTY)
        try:
            termios.tcflow(other, termios.TCOOFF)
            ready = threading.Timer(0.5, termios.tcflow, (other, termios.TCOON))
            ready.start()
            assert meter.measure().value == 1.0
            ready.join()
        finally:
            os.close(other)
