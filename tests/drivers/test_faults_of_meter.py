"""Faults of the simulated meter on its port: what another program sees of them."""

import os
import threading
import time

import pytest
import serial

from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.drivers.simulated.meter import Fault

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


def test_a_code_a_short_reply_and_a_good_one(bench, served):
    bench.obey("meter ER30")
    bench.obey("meter truncate 4")
    with serial.Serial(served.port, **SETTINGS) as program:
        assert ask(program) == b"ER30\r\n"
        assert ask(program) == b"OK00"
        assert len(ask(program)) == 17


def test_out_of_remote_mode_it_is_silent_until_put_back(bench, served):
    with serial.Serial(served.port, **SETTINGS | {"timeout": 0.3}) as program:
        bench.obey("meter drop")
        assert ask(program) == ask(program, b"MDS,04") == b""
        bench.obey("meter remote")
        assert len(ask(program)) == 17


def test_the_unit_switch(bench, served):
    with serial.Serial(served.port, **SETTINGS) as program:
        assert ask(program)[6:7] == b"c"
        bench.obey("meter unit fL")
        assert ask(program)[6:7] == b"f"


def test_a_pulled_cable_breaks_the_port_and_comes_back_under_its_name(bench, served):
    program = serial.Serial(served.port, **SETTINGS)
    assert len(ask(program)) == 17
    bench.obey("meter unplug")
    assert not os.path.lexists(served.port)
    with pytest.raises(OSError, match=r"."):
        ask(program)
    with pytest.raises(OSError, match=r"."):
        program.read(1)
    with pytest.raises(OSError, match="No such file"):
        serial.Serial(served.port, **SETTINGS)
    program.close()
    bench.obey("recover")
    with serial.Serial(served.port, **SETTINGS) as again:
        assert len(ask(again)) == 17


def test_a_cable_pulled_for_a_while(bench, served):
    bench.obey("meter unplug for 200 ms")
    end_s = time.monotonic() + 8
    while not os.path.exists(served.port) and time.monotonic() < end_s:
        time.sleep(0.02)
    with serial.Serial(served.port, **SETTINGS) as program:
        assert len(ask(program)) == 17


def test_pulled_and_put_back_twice_is_pulled_and_put_back(served):
    for _ in range(2):
        served.unplug()
    for _ in range(2):
        served.plug_in()
    with serial.Serial(served.port, **SETTINGS) as program:
        assert len(ask(program)) == 17


def test_an_unplugged_meter_closes_without_a_trace(bench):
    threads, descriptors = threading.active_count(), len(os.listdir("/proc/self/fd"))
    with bench.pty_meter(0) as served:
        folder = os.path.dirname(served.port)
        served.unplug()
    served.plug_in()
    assert threading.active_count() == threads
    assert len(os.listdir("/proc/self/fd")) == descriptors
    assert not os.path.exists(folder)


def test_garbage_depends_on_the_seed_alone():
    replies = [Fault.garbled(seed).reply for seed in range(50)]
    assert replies == [Fault.garbled(seed).reply for seed in range(50)]
    assert len(set(replies)) > 40
    assert 10 < sum(reply.endswith(b"\r\n") for reply in replies) < 40


def test_the_schedule_runs_in_one_thread_that_ends_with_the_bench(small_configuration):
    threads = threading.active_count()
    with SimulatedBench(small_configuration, BenchDevices.standard(), (400, 480)) as bench:
        bench.schedule("at 1 h meter drop\nat 2 h meter remote\nlight -5% in 3 h")
        assert threading.active_count() == threads + 1
    assert threading.active_count() == threads
