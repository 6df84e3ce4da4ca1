"""A recorded session gives again what was recorded: all of it, in order, and nothing else."""

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

from labcdp.core.clock import SimulatedClock
from labcdp.core.errors import SessionError
from labcdp.drivers.camera import CameraError, CameraSettingError
from labcdp.drivers.meter import MeterError
from labcdp.drivers.replay import ReplayCamera, ReplayMeter
from labcdp.session import Session, example_session

# The camera was asked for 5 ms and 20 ms, and applied the nearest it has.
EXPOSURES_S = (0.004998, 0.004998, 0.020003, 0.004998, 0.020003)
#: Times of arrival in seconds; the recording's clock was set back by an hour after the third frame.
FRAMES_S = (0.0, 0.25, 12.5, -3587.0, -3580.0)
READINGS_S = (5.0, 6.0, 64.0)


@pytest.fixture(scope="module")
def items(small_configuration):
    """Frames with numbers for pixels, and readings."""
    with Session.open(example_session()) as session:
        frame, reading = session.load(session.frames()[0]), session.readings()[0].reading
    noon, dn = frame.timestamp, np.arange(12, dtype=np.uint16).reshape(3, 4)
    frames = [
        replace(
            frame, dn=dn + n, exposure_s=s, frame_id=n, timestamp=noon + timedelta(seconds=at_s), temperature_c=30 + n
        )
        for n, (s, at_s) in enumerate(zip(EXPOSURES_S, FRAMES_S, strict=True), start=1)
    ]
    frames.append(replace(frames[-1], gain_db=6.0, frame_id=6, temperature_c=None))
    return frames, [replace(reading, value=at_s, timestamp=noon + timedelta(seconds=at_s)) for at_s in READINGS_S]


@pytest.fixture
def recorded(items, small_configuration, tmp_path):
    frames, readings = items
    with Session.create(tmp_path / "recorded", small_configuration) as session:
        session.add_event("camera features", {"features": {"Gain": 1.0}})
        for reading in readings:
            session.add_reading(reading, patch=small_configuration.target.patches[0].name)
        for frame in frames:
            session.add_frame(frame)
        session.add_event("camera features", {"features": {"Gain": 2.0, "ReverseX": False}})
    return tmp_path / "recorded"


def test_the_recorded_procedure_uses_all_frames_each_setting_in_its_own_order(recorded, items):
    with ReplayCamera(recorded) as camera:
        got = list(camera.grab(2))
        assert camera.configure(exposure_s=0.02).exposure_s == 0.020003
        got += camera.grab(2)
        assert (camera.identity, camera.temperature_c, camera.statistics.completed) == (items[0][0].camera, 35, 4)
        with pytest.raises(CameraError, match=r"^2 frames were recorded with 20.003 ms, .* and all have been used"):
            camera.snap()
        camera.configure(exposure_s=0.005)
        got.append(camera.snap(timeout_s=0.1))
        camera.configure(exposure_s=0.02, gain_db=6)
        got.append(camera.snap())
        assert (camera.unused, camera.temperature_c, camera.exposure_range_s) == ([], None, (0.004998, 0.020003))
        assert camera.features() == {"Gain": 2.0, "ReverseX": False}
    for frame, n in zip(got, (1, 2, 3, 5, 4, 6), strict=True):
        np.testing.assert_array_equal(frame.dn, items[0][n - 1].dn, strict=True)
        assert frame.metadata() == items[0][n - 1].metadata()


@pytest.mark.parametrize(
    "wanted", [{"exposure_s": 0.0051}, {"exposure_s": 0.005, "gain_db": 6}, {"pixel_format": "Mono8"}]
)
def test_a_setting_that_was_not_recorded_is_refused_and_changes_nothing(recorded, wanted):
    with ReplayCamera(recorded) as camera:
        with pytest.raises(CameraSettingError, match=r"nothing was recorded with .* 20.003 ms, 6 dB, Mono12, 4 x 3"):
            camera.configure(**wanted)
        assert camera.snap().frame_id == 1


def test_a_frame_is_given_once_and_only_while_the_camera_is_open_and_whole(recorded):
    camera = ReplayCamera(recorded)
    for number in (1, 2):
        with pytest.raises(CameraError, match="not open"):
            camera.snap()
        with camera:
            assert camera.snap().frame_id == number
    (damaged,) = (recorded / "frames").glob("0004_*.tif")
    damaged.write_bytes(b"II*\0")
    with camera, pytest.raises(SessionError, match=rf"{damaged.name} is truncated: 4 of \d+ bytes are left"):
        camera.snap()
    assert len(camera.unused) == 4


def test_readings_come_in_order_until_none_is_left(recorded, items):
    meter = ReplayMeter(recorded)
    with pytest.raises(MeterError, match="not open"):
        meter.measure()
    with meter:
        assert [meter.measure() for _ in range(3)] == items[1]
        assert meter.identity == items[1][2].meter
        with pytest.raises(MeterError, match="all have been used"):
            meter.measure()


@pytest.mark.parametrize("speed", [1, 0.5, 3600])
def test_the_time_waited_is_the_recorded_span_over_the_speed(recorded, speed):
    clock = SimulatedClock()
    with ReplayMeter(recorded, speed, clock) as meter:
        for _ in READINGS_S:
            meter.measure()
    assert clock.monotonic_s() == pytest.approx(59 / speed, rel=1e-12)
    clock = SimulatedClock()
    with ReplayCamera(recorded, speed, clock) as camera:
        times = [clock.monotonic_s() for _ in camera.grab(3)]  # those at 0 s and 0.25 s, and after the step back
        camera.configure(exposure_s=0.02)
        list(camera.grab(2))
    assert times == pytest.approx([0, 0.25 / speed, 0.25 / speed], rel=1e-12)
    # Of those at 12.5 s and -3580 s the first is later by 3599.5 s than the one before.
    assert clock.monotonic_s() == pytest.approx((0.25 + 3599.5) / speed, rel=1e-12)
