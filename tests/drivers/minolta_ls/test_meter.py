"""The LS-100/LS-110 driver on pseudo-terminals."""

import logging
import os
import signal
import threading
import tty
from datetime import UTC, datetime

import pytest
import serial

from labcdp.core.errors import InputError
from labcdp.core.reading import MeterIdentity
from labcdp.drivers.meter import (
    MeterError,
    MeterNotFoundError,
    MeterProtocolError,
    MeterReportedError,
    MeterTimeoutError,
)
from labcdp.drivers.minolta_ls.line import NamedPort
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.minolta_ls.protocol import MeterMode
from labcdp.drivers.simulated.meter import Fault, SimulatedLS
from labcdp.drivers.simulated.pty import PtyMeter

from .conftest import TIMEOUT_S

METER = MeterIdentity("LS-110", "73323007", "2018-03-01")
MANUAL_CODES = ["ER00", "ER01", "ER10", "ER11", "ER19", "ER20", "ER30"]
OPENING = [b"MDS,00\r\n", b"MDS,04\r\n", b"MDS,06\r\n", b"MDS,09\r\n"]


class Recorder:
    """Keeps the commands an engine received."""

    def __init__(self, engine):
        self.engine = engine
        self.commands = []

    def answer(self, command):
        self.commands.append(command)
        return self.engine.answer(command)


def counting(start=1.0):
    """Return a luminance that grows by 1 cd/m^2 with each measurement."""
    values = iter(range(1000))
    return lambda: start + next(values)


# --- The driver: what goes over the wire --------------------------------------------------------------------------


def test_open_sets_every_mode_it_relies_on(opened):
    engine = Recorder(SimulatedLS(lambda: 83.02))
    with opened(engine):
        assert engine.commands == OPENING


def test_handshake_lines_are_used_where_the_port_has_them():
    engine = SimulatedLS(lambda: 83.02)
    with (
        PtyMeter(engine, response_time_s=0) as port,
        MinoltaLS110(NamedPort(port.port, rtscts=True), timeout_s=TIMEOUT_S) as meter,
    ):
        assert meter.measure().value == 83.02


def test_measure_and_held_value(opened):
    engine = Recorder(SimulatedLS(counting(83.0)))
    with opened(engine, METER) as (_, meter):
        reading, held = meter.measure(), meter.read_held()
    assert engine.commands[4:] == [b"MES\r\n", b"DSR\r\n"]
    assert reading.luminance_cd_m2 == held.luminance_cd_m2 == 83.0
    assert reading.meter == METER
    assert (datetime.now(UTC) - reading.timestamp).total_seconds() < 60


@pytest.mark.parametrize("number", range(10))
def test_every_mode_on_the_wire(opened, number):
    engine = Recorder(SimulatedLS(lambda: 83.02))
    mode = MeterMode(f"{number:02d}")
    with opened(engine, modes=[mode]) as (_, meter):
        assert mode in meter.modes
    command = f"MDS,{number:02d}\r\n".encode()
    assert command in engine.commands
    assert len(set(engine.commands) - set(OPENING) - {command}) == 0
    assert len(engine.commands) == 4


def test_foot_lamberts_are_converted_and_noticed(opened, caplog):
    with opened(SimulatedLS(lambda: 342.62591, unit="fL")) as (_, meter), caplog.at_level(logging.WARNING):
        reading = meter.measure()
    assert (reading.value, reading.unit) == (100.0, "fL")
    assert reading.luminance_cd_m2 == pytest.approx(342.62591, rel=1e-7)
    assert "the meter is set to fL: 100 fL is 342.626 cd/m^2" in caplog.text


# --- The driver: opening and closing ------------------------------------------------------------------------------


def test_a_closed_meter_says_how_to_open_it():
    with pytest.raises(MeterError, match=r"^/dev/ttyUSB9: the meter is not open: call open\(\)"):
        MinoltaLS110("/dev/ttyUSB9").measure()


def test_absent_port():
    with pytest.raises(MeterNotFoundError, match=r"^/dev/no-such-port: there is no such .*plug the adapter in"):
        MinoltaLS110("/dev/no-such-port").open()


def test_port_in_use_by_another_pyserial_program():
    with (
        PtyMeter(SimulatedLS(lambda: 1.0)) as port,
        serial.Serial(port.port, exclusive=True),
        pytest.raises(MeterNotFoundError, match="another program uses it"),
    ):
        MinoltaLS110(port.port, timeout_s=TIMEOUT_S).open()


# --- The driver: when it goes wrong -------------------------------------------------------------------------------


@pytest.mark.parametrize("code", MANUAL_CODES)
def test_an_error_code_is_raised_and_the_next_reading_is_good(opened, code):
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(reply=code.encode() + b"\r\n"))
        with pytest.raises(MeterReportedError) as caught:
            meter.measure()
        assert caught.value.code == code
        assert meter.measure().value == 2.0


def test_silence_names_port_power_remote_mode_and_cable(opened):
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(reply=b""))
        with pytest.raises(MeterTimeoutError) as caught:
            meter.measure()
        for word in (meter.port, "MES", f"{TIMEOUT_S:g} s", "power", "shows C for remote mode", "hold F", "cable"):
            assert word in str(caught.value)
        assert "\n" not in str(caught.value)
        assert meter.measure().value == 2.0


@pytest.mark.parametrize("n_bytes", [1, 7, 15, 16])
def test_a_truncated_reply_says_how_many_bytes_came(opened, n_bytes):
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(n_bytes=n_bytes))
        with pytest.raises(MeterTimeoutError, match=f"stopped after {n_bytes} bytes .*check the cable"):
            meter.measure()
        assert meter.measure().value == 2.0


@pytest.mark.parametrize("garbage", [b"\x00\x7f?!\r\n", b"\xff\xfe\r\n", b"OK00\r\n", b"\r\n"])
def test_garbage_on_the_wire_is_shown(opened, garbage):
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(reply=garbage))
        with pytest.raises(MeterProtocolError, match="which is not a reading") as caught:
            meter.measure()
        assert repr(garbage[:-2]) in str(caught.value)
        assert meter.measure().value == 2.0


def test_a_late_reply_is_not_taken_for_the_next_one(opened):
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(delay_s=1.5 * TIMEOUT_S))
        with pytest.raises(MeterTimeoutError):
            meter.measure()
        assert meter.measure().value == 2.0


class Interrupter:
    """Sends a signal to the waiting main thread when it is asked to measure, and then measures."""

    def __init__(self, engine):
        self.engine = engine
        self.armed = True

    def answer(self, command):
        if self.armed and command == b"MES\r\n":
            self.armed = False
            signal.pthread_kill(threading.main_thread().ident, signal.SIGUSR1)
        return self.engine.answer(command)


def test_an_interrupted_measurement_does_not_answer_the_next_one():
    def interrupt(_signal, _frame):
        raise KeyboardInterrupt

    old = signal.signal(signal.SIGUSR1, interrupt)
    try:
        with (
            PtyMeter(Interrupter(SimulatedLS(counting())), response_time_s=0) as port,
            MinoltaLS110(port.port, timeout_s=TIMEOUT_S) as meter,
        ):
            port.inject(Fault(delay_s=0.5 * TIMEOUT_S))
            with pytest.raises(KeyboardInterrupt):
                meter.measure()
            assert meter.measure().value == 2.0
    finally:
        signal.signal(signal.SIGUSR1, old)


def assert_connection_broke(meter):
    with pytest.raises(MeterError, match=r"the connection to the meter broke .*check cable and adapter") as caught:
        meter.measure()
    assert "\n" not in str(caught.value)
    meter.close()


def test_a_cable_pulled_while_the_meter_measures():
    master, slave = os.openpty()
    tty.setraw(slave)

    def serve_until_measuring():
        received = b""
        while not received.endswith(b"MES\r\n"):
            received += os.read(master, 64)
            if received.endswith(b"\r\n") and not received.endswith(b"MES\r\n"):
                os.write(master, b"OK00\r\n")
        os.write(master, b"OK00,Cc")
        os.close(slave)
        os.close(master)

    server = threading.Thread(target=serve_until_measuring)
    server.start()
    meter = MinoltaLS110(os.ttyname(slave), timeout_s=10).open()
    assert_connection_broke(meter)
    server.join()


@pytest.mark.parametrize("timeout_s", [0, -1, float("nan"), float("inf")])
def test_timeout_must_be_positive(timeout_s):
    with pytest.raises(InputError, match=r"timeout_s is .*: give a positive number of seconds"):
        MinoltaLS110("/dev/no-such-port", timeout_s=timeout_s)
