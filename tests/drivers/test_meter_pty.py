"""The simulated meter on a pseudo-terminal, with any serial program, and its faults."""

import inspect
import os
import subprocess
import threading
import time

import pytest
import serial

from labcdp.drivers.simulated.meter import Fault, PtyMeter, SimulatedLS
from labcdp.errors import DeviceError, InputError

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


def test_a_program_may_change_settings_between_commands(port):
    with serial.Serial(port.port, **SETTINGS) as program:
        for timeout in (1, 2):
            program.write(b"CCR\r\n")
            assert program.read_until(b"\r\n") == b"OK00,1.000\r\n"
            program.timeout = timeout


def test_a_program_that_sets_nothing(port):
    terminal = os.open(port.port, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(terminal, b"MES\r\n")
        reply = b""
        while not reply.endswith(b"\n"):
            reply += os.read(terminal, 1)
    finally:
        os.close(terminal)
    assert reply == b"OK00,CcPH 83.02\r\n"


def test_a_shell_script(port):
    script = r'exec 3<>"$1"; printf "MES\r\n" >&3; IFS= read -r reply <&3; printf "%s\n" "$reply"'
    done = subprocess.run(["sh", "-c", script, "sh", port.port], capture_output=True, timeout=20, check=True)
    assert done.stdout == b"OK00,CcPH 83.02\r\n"


def test_a_command_may_come_in_pieces(port):
    with serial.Serial(port.port, **SETTINGS) as program:
        for byte in b"MES\r\n":
            program.write(bytes([byte]))
            program.flush()
        assert program.read_until(b"\r\n") == b"OK00,CcPH 83.02\r\n"


def test_a_command_that_breaks_off_is_answered_with_er00():
    with (
        PtyMeter(meter(), response_time_s=0, character_timeout_s=0.05) as port,
        serial.Serial(port.port, **SETTINGS) as program,
    ):
        program.write(b"ME")
        assert program.read_until(b"\r\n") == b"ER00\r\n"
        program.write(b"MES\r\n")
        assert program.read_until(b"\r\n") == b"OK00,CcPH 83.02\r\n"


def test_commands_in_one_packet_are_answered_in_order(port):
    with serial.Serial(port.port, **SETTINGS) as program:
        program.write(b"CCW,0.990\r\nCCR\r\n")
        assert program.read_until(b"\r\n") == b"OK00\r\n"
        assert program.read_until(b"\r\n") == b"OK00,0.990\r\n"


def test_no_command_is_accepted_while_measuring():
    with PtyMeter(meter(), response_time_s=0.2) as port, serial.Serial(port.port, **SETTINGS) as program:
        program.write(b"MES\r\nCCR\r\n")
        program.write(b"CCW,0.990\r\n")
        assert program.read_until(b"\r\n") == b"OK00,CcPH 83.02\r\n"
        program.write(b"CCR\r\n")
        assert program.read_until(b"\r\n") == b"OK00,1.000\r\n"


def test_measuring_takes_its_time_and_setting_a_mode_does_not():
    with PtyMeter(meter(), response_time_s=0.2) as port, serial.Serial(port.port, **SETTINGS) as program:
        start = time.monotonic()
        program.write(b"MES\r\n")
        program.read_until(b"\r\n")
        assert time.monotonic() - start >= 0.2
    assert inspect.signature(PtyMeter).parameters["response_time_s"].default == 0.8


@pytest.mark.parametrize(
    ("fault", "received"),
    [
        (Fault(), b"OK00,CcPH 83.02\r\n"),
        (Fault(reply=b""), b""),
        (Fault(reply=b"ER30\r\n"), b"ER30\r\n"),
        (Fault(reply=b"\x00\x7f?!\r\n"), b"\x00\x7f?!\r\n"),
        (Fault(n_bytes=7), b"OK00,Cc"),
        (Fault(n_bytes=0), b""),
        (Fault(delay_s=0.1), b"OK00,CcPH 83.02\r\n"),
        (Fault(delay_s=0.1, n_bytes=7), b"OK00,Cc"),
    ],
)
def test_a_fault_befalls_one_reply(port, fault, received):
    port.inject(fault)
    with serial.Serial(port.port, **SETTINGS | {"timeout": 0.4}) as program:
        program.write(b"MES\r\n")
        assert program.read_until(b"\r\n") == received
        program.write(b"MES\r\n")
        assert program.read_until(b"\r\n") == b"OK00,CcPH 83.02\r\n"


def test_a_late_meter_is_deaf(port):
    port.inject(Fault(delay_s=0.2))
    with serial.Serial(port.port, **SETTINGS) as program:
        program.write(b"CCR\r\n")
        program.write(b"CCW,0.990\r\n")
        assert program.read_until(b"\r\n") == b"OK00,1.000\r\n"
        program.write(b"CCR\r\n")
        assert program.read_until(b"\r\n") == b"OK00,1.000\r\n"


def test_faults_come_in_the_order_given(port):
    port.inject(Fault(reply=b"ER30\r\n"), Fault(), Fault(reply=b"ER20\r\n"))
    with serial.Serial(port.port, **SETTINGS) as program:
        replies = []
        for _ in range(4):
            program.write(b"CCR\r\n")
            replies.append(program.read_until(b"\r\n"))
    assert replies == [b"ER30\r\n", b"OK00,1.000\r\n", b"ER20\r\n", b"OK00,1.000\r\n"]


@pytest.mark.parametrize("values", [{"delay_s": -1.0}, {"delay_s": float("nan")}, {"n_bytes": -1}])
def test_faults_are_checked(values):
    with pytest.raises(InputError, match=r"give a number of .* of at least 0"):
        Fault(**values)


@pytest.mark.parametrize("name", ["response_time_s", "character_timeout_s"])
def test_times_are_checked(name):
    with pytest.raises(InputError, match=f"{name} is -1: give a number of seconds of at least 0"):
        PtyMeter(meter(), **{name: -1})


def test_a_program_that_never_reads_does_not_stop_the_meter(port):
    with serial.Serial(port.port, **SETTINGS | {"timeout": 0.2}) as program:
        for _ in range(2000):  # the replies are far more than the port holds
            program.write(b"MES\r\n")
        while program.read(4096):
            pass
        program.write(b"CCR\r\n")
        assert program.read_until(b"\r\n") == b"OK00,1.000\r\n"


def test_closing_leaves_no_thread_and_no_descriptor():
    threads, descriptors = threading.active_count(), len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        with PtyMeter(meter()) as served:
            path = served.port
            assert os.path.exists(path)
    assert threading.active_count() == threads
    assert len(os.listdir("/proc/self/fd")) == descriptors
    assert not os.path.exists(path)


def test_closing_does_not_wait_for_a_late_reply():
    threads = threading.active_count()
    with PtyMeter(meter()) as served:
        served.inject(Fault(delay_s=3600))
        with serial.Serial(served.port, **SETTINGS) as program:
            program.write(b"MES\r\n")
            program.flush()
    # An hour before the reply was due.
    assert threading.active_count() == threads


def test_there_is_a_port_only_in_the_context():
    served = PtyMeter(meter())
    with pytest.raises(DeviceError, match="no port yet: use it in a with statement"):
        _ = served.port
    with served, pytest.raises(DeviceError, match=r"already served on /.*/meter"):
        served.__enter__()
    with pytest.raises(DeviceError, match="no port yet"):
        _ = served.port
