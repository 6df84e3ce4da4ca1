"""Faults of the simulated meter on its port: what another program sees of them."""

import os
import threading

import pytest
import serial

from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench

SETTINGS = {"baudrate": 4800, "bytesize": 7, "parity": "E", "stopbits": 2, "timeout": 1}


@pytest.fixture
def bench(small_configuration):
    with SimulatedBench(small_configuration, BenchDevices.standard(), (400, 480)) as made:
        yield made


@pytest.fixture
def served(bench):
    with bench.pty_meter(0) as meter:
        yield meter


def ask(program, command=b"MES"):
    program.write(command + b"\r\n")
    return program.read_until(b"\r\n")


def test_out_of_remote_mode_it_is_silent_until_put_back(bench, served):
    with serial.Serial(served.port, **SETTINGS | {"timeout": 0.3}) as program:
        bench.run_command("meter drop")
        assert ask(program) == ask(program, b"MDS,04") == b""
        bench.run_command("meter remote")
        assert len(ask(program)) == 17


def test_a_pulled_cable_breaks_the_port_and_comes_back_under_its_name(bench, served):
    program = serial.Serial(served.port, **SETTINGS)
    assert len(ask(program)) == 17
    bench.run_command("meter unplug")
    assert not os.path.lexists(served.port)
    with pytest.raises(OSError, match=r"."):
        ask(program)
    with pytest.raises(OSError, match=r"."):
        program.read(1)
    with pytest.raises(OSError, match="No such file"):
        serial.Serial(served.port, **SETTINGS)
    program.close()
    bench.run_command("recover")
    with serial.Serial(served.port, **SETTINGS) as again:
        assert len(ask(again)) == 17


def test_an_unplugged_meter_closes_without_a_trace(bench):
    threads, descriptors = threading.active_count(), len(os.listdir("/proc/self/fd"))
    with bench.pty_meter(0) as served:
        folder = os.path.dirname(served.port)
        served.unplug()
    served.plug_in()
    assert threading.active_count() <= threads
    assert len(os.listdir("/proc/self/fd")) <= descriptors
    assert not os.path.exists(folder)


def test_the_schedule_runs_in_one_thread_that_ends_with_the_bench(small_configuration):
    before = set(threading.enumerate())
    with SimulatedBench(small_configuration, BenchDevices.standard(), (400, 480)) as bench:
        bench.schedule("at 1 h meter drop\nat 2 h meter remote\nlight -5% in 3 h")
        (thread,) = set(threading.enumerate()) - before
    assert not thread.is_alive()
