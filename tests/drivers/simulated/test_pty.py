"""The simulated meter on a pseudo-terminal, with any serial program, and its faults."""

import os
import threading
import time

import pytest
import serial

from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.meter import SimulatedLS
from labcdp.drivers.simulated.pty import PtyMeter

SETTINGS = {"baudrate": 4800, "bytesize": 7, "parity": "E", "stopbits": 2, "timeout": 2}


def meter(luminance=83.02, **options):
    return SimulatedLS(lambda: luminance, **options)


@pytest.fixture
def port():
    with PtyMeter(meter(), response_time_s=0) as served:
        yield served


@pytest.mark.parametrize("rtscts", [False, True])
def test_pyserial_programs_come_and_go(port, rtscts):
    for _ in range(3):
        with serial.Serial(port.port, rtscts=rtscts, **SETTINGS) as program:
            program.write(b"MES\r\n")
            assert program.read_until(b"\r\n") == b"OK00,CcPH 83.02\r\n"


def test_a_command_may_come_in_pieces_and_is_answered_with_er00_if_it_breaks_off():
    with (
        PtyMeter(meter(), response_time_s=0, character_timeout_s=0.5) as port,
        serial.Serial(port.port, **SETTINGS) as program,
    ):
        program.write(b"ME")
        assert program.read_until(b"\r\n") == b"ER00\r\n"
        for byte in b"MES\r\n":
            program.write(bytes([byte]))
            program.flush()
        assert program.read_until(b"\r\n") == b"OK00,CcPH 83.02\r\n"


def test_measuring_takes_its_time_and_setting_a_mode_does_not():
    with PtyMeter(meter(), response_time_s=0.2) as port, serial.Serial(port.port, **SETTINGS) as program:
        start = time.monotonic()
        program.write(b"MES\r\n")
        program.read_until(b"\r\n")
        assert time.monotonic() - start >= 0.2


def test_closing_leaves_nothing_behind_and_an_unplugged_meter_stays_closed():
    threads, descriptors = threading.active_count(), len(os.listdir("/proc/self/fd"))
    for unplugged in (False, True):
        with PtyMeter(meter()) as served:
            path = served.port
            assert os.path.exists(path)
            if unplugged:
                served.unplug()
        served.plug_in()
        assert not os.path.exists(os.path.dirname(path))
    assert threading.active_count() <= threads
    assert len(os.listdir("/proc/self/fd")) <= descriptors


def test_a_simulated_meter_says_so_and_a_real_one_behind_a_pseudo_terminal_does_not(port):
    with MinoltaLS110(port.port) as driver:
        assert driver.ask_if_simulated()
        assert driver.measure().meter.simulated

    class Real(SimulatedLS):
        """The manual knows no such command."""

        def answer(self, command):
            return super().answer(command.replace(b"SIM", b"???"))

    with PtyMeter(Real(lambda: 83.02), response_time_s=0) as real, MinoltaLS110(real.port) as driver:
        assert not driver.ask_if_simulated()
        assert not driver.measure().meter.simulated
