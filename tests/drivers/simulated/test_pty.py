"""The simulated meter on a pseudo-terminal, with any serial program, and its faults."""

import time

import pytest
import serial

from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.meter import SimulatedLS
from labcdp.drivers.simulated.pty import PtyMeter

SETTINGS = {"baudrate": 4800, "bytesize": 7, "parity": "E", "stopbits": 2, "timeout": 2}


def test_programs_come_and_go_and_a_command_may_come_in_pieces():
    served = PtyMeter(SimulatedLS(lambda: 83.02), response_time_s=0.1, character_timeout_s=0.5)
    with served as port:
        for rtscts in (False, True):
            with serial.Serial(port.port, rtscts=rtscts, **SETTINGS) as program:
                program.write(b"ME")
                assert program.read_until(b"\r\n") == b"ER00\r\n"
                for byte in b"MES\r\n":
                    program.write(bytes([byte]))
                    program.flush()
                began_s = time.monotonic()
                assert program.read_until(b"\r\n") == b"OK00,CcPH 83.02\r\n"
                assert time.monotonic() - began_s >= 0.09


class Real(SimulatedLS):
    """The manual knows no such command."""

    def answer(self, command):
        return super().answer(command.replace(b"SIM", b"???"))


@pytest.mark.parametrize(("kind", "simulated"), [(SimulatedLS, True), (Real, False)])
def test_a_simulated_meter_says_so_and_a_real_one_behind_a_pseudo_terminal_does_not(kind, simulated):
    with PtyMeter(kind(lambda: 83.02), response_time_s=0) as served, MinoltaLS110(served.port) as driver:
        assert driver.ask_if_simulated() is simulated
        assert driver.measure().meter.simulated is simulated
