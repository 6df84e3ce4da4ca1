"""Faults of the simulated meter on its port: what another program sees of them."""

import os
import threading

import pytest

from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench


@pytest.fixture
def bench(small_configuration):
    with SimulatedBench(small_configuration, BenchDevices.standard(), (400, 480)) as made:
        yield made


def test_an_unplugged_meter_closes_without_a_trace(bench):
    threads, descriptors = threading.active_count(), len(os.listdir("/proc/self/fd"))
    with bench.pty_meter(0) as served:
        folder = os.path.dirname(served.port)
        served.unplug()
    served.plug_in()
    assert threading.active_count() <= threads
    assert len(os.listdir("/proc/self/fd")) <= descriptors
    assert not os.path.exists(folder)


def test_the_timers_of_the_schedule_end_with_the_bench(small_configuration):
    def timers():
        return [thread for thread in threading.enumerate() if isinstance(thread, threading.Timer)]

    with SimulatedBench(small_configuration, BenchDevices.standard(), (400, 480)) as bench:
        bench.schedule("at 1 h meter drop\nat 2 h meter remote\nlight -5% in 3 h")
        assert timers()
    assert timers() == []
