"""Recovery of the LS-100/LS-110 driver: garbage, late and broken-off answers, silence, a pulled cable, RTS/CTS."""

import logging
import os
from contextlib import contextmanager, suppress

import pytest

from labcdp.drivers.meter import (
    MeterLostError,
    MeterReportedError,
    MeterTimeoutError,
    measure_series,
)
from labcdp.drivers.minolta_ls.protocol import MeterMode
from labcdp.drivers.simulated.meter import Fault, SimulatedLS

from .conftest import TIMEOUT_S

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


@pytest.fixture
def asked(opened):
    """A driver on a new engine: gives engine, port and driver."""

    @contextmanager
    def serve(**options):
        engine = Engine()
        with opened(engine, **options) as (port, meter):
            engine.commands.clear()
            yield engine, port, meter

    return serve


# --- Asking again -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fault", [SILENCE, GARBAGE, NO_END, LATE, CUT])
def test_a_failed_reading_is_asked_for_again_and_what_follows_is_in_step(asked, fault, caplog):
    with asked(attempts=3) as (engine, port, meter):
        port.inject(fault)
        first = meter.measure().value
        # The reply to either of the two commands is a reading of this call, never of the next.
        assert first in (1.0, 2.0)
        assert meter.measure().value == engine.commands.count("MES")
    warnings = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
    assert warnings
    assert "asking again (attempt 2 of 3)" in warnings[0]


@pytest.mark.parametrize("code", ["ER01", "ER10", "ER11", "ER19", "ER20", "ER30"])
def test_codes_that_repeat_themselves_are_not_asked_for_again(asked, code):
    with asked(attempts=3) as (engine, port, meter):
        port.inject(Fault(reply=code.encode() + b"\r\n"))
        with pytest.raises(MeterReportedError, match=rf"^{code}"):
            meter.measure()
        assert engine.commands == ["MES"]


def test_a_series_tolerates_faults_in_between(asked):
    with asked(attempts=3) as (engine, port, meter):
        port.inject(Fault(), GARBAGE, Fault(), CUT, Fault(), SILENCE)
        series = measure_series(meter, 6)
        assert len({reading.value for reading in series.readings}) == 6
        # The last fault spoils a reading, or the mode that is set before it.
        assert engine.commands.count("MES") >= 8


def test_a_reply_later_than_twice_the_time_out_is_not_the_next_reading(asked, transport):
    with asked() as (engine, port, meter):
        port.inject(Fault(delay_s=3 * TIMEOUT_S))
        with pytest.raises(MeterTimeoutError):
            meter.measure()
        transport.sleep(1.5 * TIMEOUT_S)
        values = []
        while not values:
            with suppress(MeterTimeoutError):
                values.append(meter.measure().value)
        # The value of the last command, and not that of the first, which was on its way.
        assert values[0] == engine.commands.count("MES") > 1
        assert meter.measure().value == values[0] + 1


# --- A meter that is gone -----------------------------------------------------------------------------------------


def test_a_pulled_cable_is_waited_for_and_the_modes_restored(asked, transport, caplog):
    with asked(patience_s=8, modes=[MeterMode.SLOW]) as (engine, port, meter):
        assert meter.measure().value == 1.0
        port.unplug()
        for command in (b"MDS,06\r\n", b"MDS,08\r\n"):
            engine.answer(command)
        engine.commands.clear()
        with transport.later(0.5, port.plug_in):
            reading = meter.measure()
        assert (reading.value, reading.peak) == (2.0, False)
        assert engine.commands == ["MDS,00", "MDS,04", "MDS,07", "MDS,09", "MES"]
    warnings = [record.getMessage() for record in caplog.records]
    assert "waiting up to 8 s for the meter to come back" in warnings[0]
    assert "the meter is back, its modes are restored" in warnings[-1]


def test_a_cable_that_stays_pulled_ends_in_one_error_that_names_both_problems(asked):
    before = len(os.listdir("/proc/self/fd"))
    with asked(patience_s=0.5, attempts=2) as (_, port, meter):
        port.unplug()
        with pytest.raises(MeterLostError, match=r"connection .* broke .*not come back within 0\.5 s, last: .*no such"):
            meter.measure()
        assert meter.modes == ()
    assert len(os.listdir("/proc/self/fd")) <= before


def test_a_meter_out_of_remote_mode_is_waited_for(asked, transport):
    with asked(patience_s=8) as (engine, _, meter):
        engine.remote = False
        with transport.later(2 * TIMEOUT_S, lambda: setattr(engine, "remote", True)):
            assert meter.measure().value == 1.0
