"""Faults of the devices in this process, in simulated time: each second takes none."""

import threading
import time
from datetime import UTC, datetime

import numpy as np
import pytest

from labcdp.core.clock import SimulatedClock
from labcdp.drivers.camera import (
    CameraError,
)
from labcdp.drivers.meter import MeterError
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench

SHAPE = (400, 480)
START = datetime(2026, 1, 1, tzinfo=UTC)


@pytest.fixture
def clock():
    return SimulatedClock(START)


@pytest.fixture
def bench(small_configuration, clock):
    return SimulatedBench(small_configuration, BenchDevices.standard(seed=3), SHAPE, clock)


@pytest.fixture
def camera(bench):
    with bench.in_process_camera() as opened:
        yield opened


@pytest.fixture
def meter(bench):
    with bench.in_process_meter() as opened:
        yield opened


# --- Camera -------------------------------------------------------------------------------------------------------


def test_frames_take_their_exposure_or_their_period(clock, camera):
    for exposure_s, takes_s in ((0.01, 1 / 15), (2.5, 2.5)):
        camera.configure(exposure_s=exposure_s)
        before_s = clock.monotonic_s()
        frames = list(camera.grab(4))
        assert clock.monotonic_s() - before_s == pytest.approx(4 * takes_s)
        steps_ns = np.diff([frame.camera_timestamp_ns for frame in frames])
        np.testing.assert_allclose(steps_ns, takes_s * 1e9, rtol=1e-6)
        assert frames[-1].timestamp == clock.now()


# --- Drifts -------------------------------------------------------------------------------------------------------


def test_light_drifts_for_camera_and_meter(bench, clock, camera, meter, small_configuration):
    bench.point_meter("upper left")
    region = next(p.region() for p in small_configuration.target.patches if p.name == "upper left")
    camera.configure(exposure_s=0.0005)

    def seen():
        return region.select(camera.snap().dn).mean() - 64, meter.measure().luminance_cd_m2

    camera_before, meter_before = seen()
    bench.run_command("light -20% in 100 s")
    clock.sleep(50)
    # A frame and a reading take less than 1 s, which is 0.2 % of light; repeatability is 0.1 %.
    halfway = seen()
    assert halfway[0] / camera_before == pytest.approx(0.9, abs=0.005)
    assert halfway[1] / meter_before == pytest.approx(0.9, abs=0.008)
    clock.sleep(1000)
    assert bench.light_rel == pytest.approx(0.8)
    bench.run_command("light +25%")
    assert bench.light_rel == pytest.approx(1.0)


def test_temperature_drifts_in_steps_that_renew_frames(bench, clock, camera):
    states = {bench._source.state}
    bench.run_command("temperature +8 C in 10 min")
    for _ in range(60):
        clock.sleep(10)
        states.add(bench._source.state)
    assert bench.temperature_c == pytest.approx(43)
    assert camera.temperature_c == bench.temperature_c
    assert camera.snap().temperature_c == bench.temperature_c
    assert len(states) == 61


# --- Schedule -----------------------------------------------------------------------------------------------------


NIGHT = """
light -5% in 8 h
temperature +8 C in 2 h
at 30 min lose 0.2% for 10 min
at 1 h vanish for 90 s
at 2 h stall for 30 s
at 3 h freeze for 20 s
at 4 h wrong ids for 3 min
at 5 h second controller for 4 min
at 6 h wrong size for 2 min
at 7 h meter ER10
at 7 h meter drop
at 7.5 h meter remote
"""


def test_a_night_passes_in_no_time(bench, clock):
    """8 h with a frame and a reading each minute; every frame is whole, or its fault is known."""
    bench.schedule(NIGHT)
    began = time.process_time()
    refused, failures, frames, readings = [], [], [], []
    with bench.in_process_camera(patience_s=600) as camera, bench.in_process_meter() as meter:
        while clock.monotonic_s() < 8 * 3600:
            due_s = clock.monotonic_s() + 60
            try:
                frames.extend(camera.grab(1, on_refused=refused.append))
            except CameraError as error:
                failures.append(error)
            try:
                readings.append(meter.measure().luminance_cd_m2)
            except MeterError as error:
                failures.append(error)
            clock.sleep(due_s - clock.monotonic_s())
        gaps = camera.gaps
    # The faults of the meter are one code, and 30 min without remote mode.
    n_meter_failures = sum(isinstance(error, MeterError) for error in failures)
    assert 30 <= n_meter_failures <= 33
    assert len(frames) + sum(isinstance(error, CameraError) for error in failures) == pytest.approx(477, abs=3)
    assert [gap.reason for gap in gaps] == [
        "it does not answer",
        "it did not answer",
        "another program took control",
    ]
    assert refused
    assert readings[-1] / readings[0] == pytest.approx(0.95, abs=0.02)
    assert frames[-1].temperature_c == pytest.approx(43)
    # Far from the limit of a minute, on any computer.
    assert time.process_time() - began < 60


def test_the_timers_of_the_schedule_end_with_the_bench(small_configuration):
    def timers():
        return [thread for thread in threading.enumerate() if isinstance(thread, threading.Timer)]

    with SimulatedBench(small_configuration, BenchDevices.standard(), SHAPE) as bench:
        bench.schedule("at 1 h meter drop\nat 2 h meter remote\nlight -5% in 3 h")
        assert timers()
    assert timers() == []
