"""A replay keeps the pace of the recording, or any other, on whatever clock it is given."""

import time
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.clock import SimulatedClock
from labcdp.drivers.replay import ReplayCamera, ReplayMeter
from labcdp.drivers.replay_pace import Pace
from labcdp.errors import InputError
from labcdp.session import Session, SessionConfiguration

from .test_replay import BENCH, NOON, frame, reading, timedelta

#: Times of arrival in seconds; the recording's clock was set back by an hour after the third frame.
FRAMES_S = (0.0, 0.25, 12.5, -3587.0, -3580.0)
READINGS_S = (5.0, 6.0, 64.0)
#: What lay between them, without the step.
FRAMES_SPAN_S = 12.5 + 7.0
READINGS_SPAN_S = 59.0


@pytest.fixture
def recorded(tmp_path):
    path = tmp_path / "recorded"
    with Session.create(path, SessionConfiguration.from_toml(BENCH, "bench.toml")) as session:
        for at_s in READINGS_S:
            session.add_reading(reading(75.0, at_s), patch="A1")
        for number, at_s in enumerate(FRAMES_S, start=1):
            session.add_frame(frame(number, 0.01, at_s=at_s))
    return path


@pytest.mark.parametrize("speed", [1, 10, 0.5, 3600])
def test_the_time_waited_is_the_recorded_span_over_the_speed(recorded, speed):
    clock = SimulatedClock()
    with ReplayCamera(recorded, speed, clock) as camera:
        times = [clock.monotonic_s() for _ in camera.grab(len(FRAMES_S))]
    assert times == pytest.approx([t / speed for t in (0, 0.25, 12.5, 12.5, FRAMES_SPAN_S)], rel=1e-12)
    clock = SimulatedClock()
    with ReplayMeter(recorded, speed=speed, clock=clock) as meter:
        for _ in READINGS_S:
            meter.measure()
    assert clock.monotonic_s() == pytest.approx(READINGS_SPAN_S / speed, rel=1e-12)


def test_without_a_speed_nothing_is_waited_for(recorded):
    clock = SimulatedClock()
    with ReplayCamera(recorded, clock=clock) as camera, ReplayMeter(recorded, clock=clock) as meter:
        list(camera.grab(len(FRAMES_S)))
        for _ in READINGS_S:
            meter.measure()
    assert clock.monotonic_s() == 0


def test_time_that_passed_already_is_not_waited_for_again(recorded):
    clock = SimulatedClock()
    with ReplayCamera(recorded, 1, clock) as camera, ReplayMeter(recorded, 1, clock) as meter:
        camera.snap()
        camera.snap()
        for _ in READINGS_S:
            meter.measure()
        # The meter's 59 s are more than the 12.25 s between these two frames.
        assert clock.monotonic_s() == 0.25 + READINGS_SPAN_S
        camera.snap()
        assert clock.monotonic_s() == 0.25 + READINGS_SPAN_S


def test_a_slow_program_does_not_get_the_rest_in_a_burst(recorded):
    clock = SimulatedClock()
    with ReplayMeter(recorded, 1, clock) as meter:
        meter.measure()
        clock.sleep(30)
        meter.measure()
        meter.measure()
    assert clock.monotonic_s() == 30 + 58


def test_a_damaged_frame_costs_no_time(recorded):
    damaged = sorted((recorded / "frames").iterdir())[1]
    damaged.write_bytes(damaged.read_bytes()[:-1])
    clock = SimulatedClock()
    with ReplayCamera(recorded, 1, clock) as camera:
        camera.snap()
        with pytest.raises(Exception, match=r"truncated"):
            camera.snap()
    assert clock.monotonic_s() == 0


@pytest.mark.parametrize("device", [ReplayCamera, ReplayMeter])
@pytest.mark.parametrize("speed", [0, -1, float("nan"), float("inf")])
def test_a_wrong_speed_is_refused(recorded, device, speed):
    with pytest.raises(InputError, match=rf"^speed is {speed}: give a factor above 0, 1 for the pace of the recording"):
        device(recorded, speed)


def test_the_computers_clock_is_used_if_none_is_given(recorded):
    began = time.monotonic()
    with ReplayCamera(recorded, speed=50) as camera:
        list(camera.grab(2))
    # 5 ms at the least; how much more depends on the machine.
    assert time.monotonic() - began >= 0.005


@given(
    st.lists(st.floats(-1e6, 1e6).map(lambda s: round(s, 3)), min_size=1, max_size=20),
    st.floats(0.01, 1e4),
)
def test_the_sum_is_that_of_the_steps_forwards(times_s, speed):
    clock = SimulatedClock()
    pace = Pace(speed, clock)
    for time_s in times_s:
        pace.keep(NOON + timedelta(seconds=time_s))
    forwards_s = sum(max(0.0, later - earlier) for earlier, later in pairwise(times_s))
    assert clock.monotonic_s() == pytest.approx(forwards_s / speed, rel=1e-9, abs=1e-9)
