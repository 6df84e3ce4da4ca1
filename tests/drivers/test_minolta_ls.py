"""The LS-100/LS-110 driver on pseudo-terminals."""

import inspect
import logging
import os
import signal
import threading
import tty
from contextlib import contextmanager
from datetime import UTC, datetime

import pytest
import serial
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from labcdp.drivers.meter import (
    MeterError,
    MeterNotFoundError,
    MeterProtocolError,
    MeterReportedError,
    MeterTimeoutError,
)
from labcdp.drivers.minolta_ls import (
    LS100,
    MeterMode,
    MinoltaLS100,
    MinoltaLS110,
    SerialPort,
    find_meter_ports,
)
from labcdp.drivers.simulated.meter import Fault, PtyMeter, SimulatedLS
from labcdp.errors import InputError
from labcdp.reading import MeterIdentity

METER = MeterIdentity("LS-110", "73323007", "2018-03-01")
MANUAL_CODES = ["ER00", "ER01", "ER10", "ER11", "ER19", "ER20", "ER30"]
OPENING = [b"MDS,00\r\n", b"MDS,04\r\n", b"MDS,06\r\n", b"MDS,09\r\n"]
#: Short for a test, long for two threads on one machine.
TIMEOUT_S = 0.4


class Recorder:
    """Keeps the commands an engine received."""

    def __init__(self, engine):
        self.engine = engine
        self.commands = []

    def answer(self, command):
        self.commands.append(command)
        return self.engine.answer(command)


class Script:
    """Takes every mode, and answers the other commands with the given replies, in order."""

    def __init__(self, *replies):
        self.replies = list(replies)

    def answer(self, command):
        return b"OK00\r\n" if command.startswith(b"MDS") else self.replies.pop(0)


@contextmanager
def opened(engine, **options):
    """Serve an engine and open a driver on it; gives both the port and the driver."""
    options = {"timeout_s": TIMEOUT_S} | options
    with PtyMeter(engine, response_time_s=0) as port, MinoltaLS110(port.port, METER, **options) as meter:
        yield port, meter


def counting(start=1.0):
    """Return a luminance that grows by 1 cd/m^2 with each measurement."""
    values = iter(range(1000))
    return lambda: start + next(values)


# --- The driver: what goes over the wire --------------------------------------------------------------------------


def test_constructor_touches_no_port():
    meter = MinoltaLS110("/dev/no-such-port")
    assert meter.identity == MeterIdentity("LS-110", serial="unknown")
    assert MinoltaLS100("/dev/no-such-port").identity.model == "LS-100"
    meter.close()


@pytest.mark.parametrize("timeout_s", [0, -1, float("nan"), float("inf")])
def test_timeout_must_be_positive(timeout_s):
    with pytest.raises(InputError, match=r"timeout_s is .*: give a positive number of seconds"):
        MinoltaLS110("/dev/no-such-port", timeout_s=timeout_s)


def test_default_timeout_outlasts_the_meters_own_5_s():
    assert inspect.signature(MinoltaLS110).parameters["timeout_s"].default == 6.0


@pytest.mark.parametrize("rtscts", [False, True])
def test_open_sets_every_mode_it_relies_on(rtscts):
    engine = Recorder(SimulatedLS(lambda: 83.02))
    with opened(engine, rtscts=rtscts):
        assert engine.commands == OPENING


def test_open_overrides_the_modes_a_user_left():
    engine = SimulatedLS(lambda: 83.02)
    for mode in ("03", "05", "07", "08"):
        engine.answer(f"MDS,{mode}\r\n".encode())
    with opened(engine) as (_, meter):
        assert meter.measure().raw == "OK00,CcPH 83.02"


def test_measure_and_held_value():
    engine = Recorder(SimulatedLS(counting(83.0)))
    with opened(engine) as (_, meter):
        reading, held = meter.measure(), meter.read_held()
    assert engine.commands[4:] == [b"MES\r\n", b"DSR\r\n"]
    assert reading.luminance_cd_m2 == held.luminance_cd_m2 == 83.0
    assert reading.meter == METER
    assert (datetime.now(UTC) - reading.timestamp).total_seconds() < 60


@pytest.mark.parametrize("number", range(10))
def test_every_mode_on_the_wire(number):
    engine = Recorder(SimulatedLS(lambda: 83.02))
    with opened(engine) as (_, meter):
        meter.set_mode(MeterMode(f"{number:02d}"))
    assert engine.commands[4:] == [f"MDS,{number:02d}\r\n".encode()]


def test_mode_numbers_of_the_manual():
    assert {mode.name: mode.value for mode in MeterMode} == {
        "PRESET": "00",
        "VARI_CCF": "01",
        "VARI_LUMI": "02",
        "VARI_CCF_LUMI": "03",
        "ABS": "04",
        "RATIO": "05",
        "FAST": "06",
        "SLOW": "07",
        "PEAK": "08",
        "CONT": "09",
    }


def test_each_model_has_its_own_data_sheet():
    with (
        PtyMeter(SimulatedLS(lambda: 0.5, LS100), response_time_s=0) as port,
        MinoltaLS100(port.port, timeout_s=TIMEOUT_S) as meter,
    ):
        reading = meter.measure()
    assert reading.raw == "OK00,CcPH 0.500"
    assert reading.digits_half_width == pytest.approx(0.002)


def test_a_full_six_digit_number_is_read():
    with opened(Script(b"OK00,CcPH748000\r\n")) as (_, meter):
        assert meter.measure().luminance_cd_m2 == 748_000


def test_foot_lamberts_are_converted_and_noticed(caplog):
    with opened(SimulatedLS(lambda: 342.62591, unit="fL")) as (_, meter), caplog.at_level(logging.WARNING):
        reading = meter.measure()
    assert (reading.value, reading.unit) == (100.0, "fL")
    assert reading.luminance_cd_m2 == pytest.approx(342.62591, rel=1e-7)
    assert "the meter is set to fL: 100 fL is 342.626 cd/m^2" in caplog.text


def test_cd_m2_raises_no_warning(caplog):
    with opened(SimulatedLS(lambda: 83.02)) as (_, meter):
        meter.measure()
    assert not caplog.records


# --- The driver: opening and closing ------------------------------------------------------------------------------


def test_a_meter_can_be_opened_and_closed_again_and_again():
    with opened(SimulatedLS(counting())) as (_, meter):
        assert meter.open() is meter
        for value in (1.0, 2.0, 3.0):
            assert meter.measure().value == value
            meter.close()
            meter.close()
            meter.open()


def test_a_closed_meter_says_how_to_open_it():
    with pytest.raises(MeterError, match=r"^/dev/ttyUSB9: the meter is not open: call open\(\)"):
        MinoltaLS110("/dev/ttyUSB9").measure()


def test_absent_port():
    with pytest.raises(MeterNotFoundError, match=r"^/dev/no-such-port: there is no such .*plug the adapter in"):
        MinoltaLS110("/dev/no-such-port").open()


def test_port_in_use():
    with opened(SimulatedLS(counting())) as (port, meter):
        with pytest.raises(MeterNotFoundError, match=f"^{port.port}: another program uses it: end that"):
            MinoltaLS110(port.port, timeout_s=TIMEOUT_S).open()
        assert meter.measure().value == 1.0


def test_port_in_use_by_another_pyserial_program():
    with (
        PtyMeter(SimulatedLS(lambda: 1.0)) as port,
        serial.Serial(port.port, exclusive=True),
        pytest.raises(MeterNotFoundError, match="another program uses it"),
    ):
        MinoltaLS110(port.port, timeout_s=TIMEOUT_S).open()


@contextmanager
def without_privilege():
    """Be nobody for a while, if the tests run as root, whom no permission stops."""
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(user)


def test_port_without_permission():
    with PtyMeter(SimulatedLS(lambda: 1.0)) as port:
        os.chmod(port.port, 0)
        with without_privilege(), pytest.raises(MeterNotFoundError, match=r"no permission .*join the group"):
            MinoltaLS110(port.port, timeout_s=TIMEOUT_S).open()


def test_a_file_is_no_port(tmp_path):
    path = tmp_path / "meter"
    path.write_text("")
    with pytest.raises(MeterNotFoundError, match=r"cannot be used as a serial port .*choose another port"):
        MinoltaLS110(str(path)).open()


def test_a_failed_open_leaves_nothing_open():
    with PtyMeter(SimulatedLS(lambda: 1.0)) as port:
        before = len(os.listdir("/proc/self/fd"))
        port.inject(Fault(reply=b""))
        meter = MinoltaLS110(port.port, timeout_s=TIMEOUT_S)
        with pytest.raises(MeterTimeoutError):
            meter.open()
        assert len(os.listdir("/proc/self/fd")) == before
        with pytest.raises(MeterError, match="not open"):
            meter.measure()


def test_open_shows_an_error_code_of_the_meter():
    with PtyMeter(SimulatedLS(lambda: 1.0)) as port:
        port.inject(Fault(reply=b"ER30\r\n"))
        with pytest.raises(MeterReportedError, match="battery"):
            MinoltaLS110(port.port, timeout_s=TIMEOUT_S).open()


def test_found_ports_are_those_of_the_system(monkeypatch):
    usb, onboard = ListPortInfo("/dev/ttyUSB0"), ListPortInfo("/dev/ttyS0")
    usb.description = "USB-Serial Controller"
    monkeypatch.setattr(list_ports, "comports", lambda: [usb, onboard])
    assert find_meter_ports() == [
        SerialPort("/dev/ttyS0", "n/a"),
        SerialPort("/dev/ttyUSB0", "USB-Serial Controller"),
    ]


def test_finding_ports_of_this_machine():
    assert all(os.path.exists(port.device) for port in find_meter_ports())


# --- The driver: when it goes wrong -------------------------------------------------------------------------------


@pytest.mark.parametrize("code", MANUAL_CODES)
def test_an_error_code_is_raised_and_the_next_reading_is_good(code):
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(reply=code.encode() + b"\r\n"))
        with pytest.raises(MeterReportedError) as caught:
            meter.measure()
        assert caught.value.code == code
        assert meter.measure().value == 2.0


def test_too_bright_is_an_error_and_not_a_number():
    with opened(SimulatedLS(lambda: 2e6)) as (_, meter), pytest.raises(MeterReportedError, match=r"^ER10"):
        meter.measure()


def test_silence_names_port_power_remote_mode_and_cable():
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(reply=b""))
        with pytest.raises(MeterTimeoutError) as caught:
            meter.measure()
        for word in (port.port, "MES", f"{TIMEOUT_S:g} s", "power", "shows C for remote mode", "hold F", "cable"):
            assert word in str(caught.value)
        assert "\n" not in str(caught.value)
        assert meter.measure().value == 2.0


@pytest.mark.parametrize("n_bytes", [1, 7, 15, 16])
def test_a_truncated_reply_says_how_many_bytes_came(n_bytes):
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(n_bytes=n_bytes))
        with pytest.raises(MeterTimeoutError, match=f"broke off after {n_bytes} bytes .*check the cable"):
            meter.measure()
        assert meter.measure().value == 2.0


@pytest.mark.parametrize("garbage", [b"\x00\x7f?!\r\n", b"\xff\xfe\r\n", b"OK00\r\n", b"\r\n"])
def test_garbage_on_the_wire_is_shown(garbage):
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(reply=garbage))
        with pytest.raises(MeterProtocolError, match="which is not a reading") as caught:
            meter.measure()
        assert repr(garbage[:-2]) in str(caught.value)
        assert meter.measure().value == 2.0


def test_endless_garbage_is_cut():
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(reply=b"U" * 1000))
        with pytest.raises(MeterProtocolError, match="U' and no CR LF: check that the meter is on this port"):
            meter.measure()
        assert meter.measure().value == 2.0


def test_a_late_reply_is_not_taken_for_the_next_one():
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(delay_s=1.5 * TIMEOUT_S))
        with pytest.raises(MeterTimeoutError):
            meter.measure()
        assert meter.measure().value == 2.0


def test_a_late_reply_is_not_taken_for_the_acknowledgement_of_a_mode():
    engine = Recorder(SimulatedLS(counting()))
    with opened(engine) as (port, meter):
        port.inject(Fault(delay_s=1.5 * TIMEOUT_S))
        with pytest.raises(MeterTimeoutError):
            meter.measure()
        meter.set_mode(MeterMode.SLOW)
        assert engine.commands[4:] == [b"MES\r\n", b"MDS,07\r\n"]


def test_a_late_error_code_is_not_taken_for_the_next_reply():
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(delay_s=1.5 * TIMEOUT_S, reply=b"ER00\r\n"))
        with pytest.raises(MeterTimeoutError):
            meter.measure()
        assert meter.measure().value == 2.0


def test_a_reply_that_came_while_nobody_waited_is_dropped():
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(reply=b"OK00,CcPH999.90\r\nOK00,CcPH888.80\r\n"))
        assert meter.measure().value == 999.9
        assert meter.measure().value == 2.0


def test_a_late_reply_after_closing_and_opening_is_dropped():
    with opened(SimulatedLS(counting())) as (port, meter):
        port.inject(Fault(delay_s=1.5 * TIMEOUT_S))
        with pytest.raises(MeterTimeoutError):
            meter.measure()
        meter.close()
        assert meter.open().measure().value == 2.0


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
        with opened(Interrupter(SimulatedLS(counting()))) as (port, meter):
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


def test_a_cable_pulled_between_two_readings():
    with PtyMeter(SimulatedLS(lambda: 1.0), response_time_s=0) as port:
        meter = MinoltaLS110(port.port, timeout_s=TIMEOUT_S).open()
        meter.measure()
    assert_connection_broke(meter)


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
