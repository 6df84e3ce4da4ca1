"""A replay keeps the pace of the recording, or any other, on whatever clock it is given."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.clock import SimulatedClock
from labcdp.drivers.replay import Pace, ReplayCamera, ReplayMeter
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
