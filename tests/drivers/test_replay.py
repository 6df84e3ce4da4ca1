"""A recorded session gives again what was recorded: all of it, in order, and nothing else."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from labcdp.core.clock import SimulatedClock
from labcdp.core.errors import InputError, SessionError
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.reading import MeterIdentity, Reading
from labcdp.drivers.camera import CameraError, CameraSettingError, StreamStatistics
from labcdp.drivers.camera_settings import CameraSettings
from labcdp.drivers.meter import MeterError
from labcdp.drivers.replay import ReplayCamera, ReplayMeter
from labcdp.session import Session, SessionConfiguration

BENCH = """
name = "replay"
operator = "nobody"
[camera]
pixel_pitch_m = 3.45e-6
[lens]
model = "LM6NCL"
serial = "0117"
focal_length_m = 0.006
f_number = 2.6
[meter]
model = "LS-110"
serial = "73323007"
[source]
spectrum = "D65"
[target]
name = "one patch"
[[target.patch]]
name = "A1"
roi = [0, 0, 4, 3]
[plan]
exposures_s = [0.005, 0.02]
"""
CAMERA = CameraIdentity("Allied Vision Technologies", "Manta_G-505B", "503363706")
METER = MeterIdentity("LS-110", "73323007", "2025-03-31")
NOON = datetime(2026, 3, 1, 12, tzinfo=UTC)


def frame(frame_id, exposure_s, gain_db=0.0, pixel_format="Mono12", at_s=0.0, temperature_c=40.1):
    return Frame(
        dn=np.random.default_rng(frame_id).integers(0, 4096, (3, 4), dtype=np.uint16),
        exposure_s=exposure_s,
        gain_db=gain_db,
        bit_depth=12,
        saturation_dn=4095,
        black_level_dn=None,
        black_level_register=16,
        pixel_format=pixel_format,
        colour_filter=None,
        temperature_c=temperature_c,
        timestamp=NOON + timedelta(seconds=at_s),
        camera_timestamp_ns=frame_id,
        frame_id=frame_id,
        camera=CAMERA,
    )


def reading(value, at_s=0.0):
    return Reading(
        value=value,
        unit="cd/m2",
        resolution=0.1,
        scale_half_width_rel=0.02,
        digits_half_width=0.1,
        repeatability_rel=0.001,
        peak=False,
        correction="preset",
        held=False,
        meter=METER,
        timestamp=NOON + timedelta(seconds=at_s),
        raw=f"OK00,CcPM{value:6.1f}",
    )


# The camera was asked for 5 ms and 20 ms, and applied the nearest it has.
FRAMES = [
    (frame(1, 0.004998), "light"),
    (frame(2, 0.004998), "light"),
    (frame(3, 0.020003), "light"),
    (frame(4, 0.004998), "dark"),
    (frame(5, 0.020003), "dark"),
    (frame(6, 0.004998, gain_db=6.0), "light"),
]


@pytest.fixture
def recorded(tmp_path):
    path = tmp_path / "recorded"
    with Session.create(path, SessionConfiguration.from_toml(BENCH, "bench.toml")) as session:
        for value in (75.6, 75.8):
            session.add_reading(reading(value), patch="A1")
        for one, role in FRAMES:
            session.add_frame(one, role)
    return path


def assert_same(frame, other):
    np.testing.assert_array_equal(frame.dn, other.dn, strict=True)
    assert frame.metadata() == other.metadata()


def test_the_recorded_procedure_uses_all_frames(recorded):
    with ReplayCamera(recorded) as camera:
        assert camera.identity == CAMERA
        assert camera.settings == CameraSettings(0.004998, 0.0, "Mono12", 4, 3, black_level=16)
        got = list(camera.grab(2))
        assert camera.configure(exposure_s=0.02) == CameraSettings(0.020003, 0.0, "Mono12", 4, 3, black_level=16)
        got.append(camera.snap())
        camera.configure(exposure_s=0.005)
        got.append(camera.snap(timeout_s=0.1))
        camera.configure(exposure_s=0.02, gain_db=0, pixel_format="Mono12")
        got.append(camera.snap())
        assert [record.number for record in camera.unused] == [6]
        camera.configure(exposure_s=0.005, gain_db=6)
        got.append(camera.snap())
    assert not camera.unused
    for one, (expected, _) in zip(got, FRAMES, strict=True):
        assert_same(one, expected)


def test_each_setting_keeps_its_own_order_and_gives_no_more_than_was_recorded(recorded):
    with ReplayCamera(recorded) as camera:
        camera.configure(exposure_s=0.02)
        assert [one.frame_id for one in camera.grab(2)] == [3, 5]
        message = r"^2 frames were recorded with 0.020003 s, .* 4 x 3 pixels, and all were given: ask for at most 2$"
        with pytest.raises(CameraError, match=message):
            camera.snap()
        assert [record.number for record in camera.unused] == [1, 2, 4, 6]
        camera.configure(exposure_s=0.005)
        assert [one.frame_id for one in camera.grab(3)] == [1, 2, 4]


@pytest.mark.parametrize(
    ("wanted", "text"),
    [
        ({"exposure_s": 0.0051}, "0.0051 s, 0 dB, Mono12"),
        ({"exposure_s": 0.02, "gain_db": 6}, "0.02 s, 6 dB, Mono12"),
        ({"gain_db": 0.1}, "0.004998 s, 0.1 dB, Mono12"),
        ({"pixel_format": "Mono8"}, "0.004998 s, 0 dB, Mono8"),
    ],
)
def test_a_setting_that_was_not_recorded_is_refused_and_changes_nothing(recorded, wanted, text):
    with ReplayCamera(recorded) as camera:
        before = camera.settings
        with pytest.raises(CameraSettingError) as caught:
            camera.configure(**wanted)
        assert str(caught.value) == (
            f"nothing was recorded with {text}: this session has 0.004998 s, 0 dB, Mono12, 4 x 3 pixels; "
            "0.020003 s, 0 dB, Mono12, 4 x 3 pixels; 0.004998 s, 6 dB, Mono12, 4 x 3 pixels"
        )
        assert camera.settings == before
        assert_same(camera.snap(), FRAMES[0][0])


def test_a_frame_is_given_once_and_only_while_the_camera_is_open(recorded):
    camera = ReplayCamera(recorded)
    for number in (1, 2):
        for use in (camera.snap, camera.configure, camera.features, lambda: camera.settings, lambda: camera.identity):
            with pytest.raises(CameraError, match=r"the replayed camera is not open: open it first"):
                use()
        with camera:
            assert camera.snap().frame_id == number
    assert len(camera.unused) == len(FRAMES) - 2


def test_a_damaged_frame_is_refused_and_stays_unused(recorded):
    (recorded / "frames" / "0001_light_4.998ms.tif").write_bytes(b"II*\0")
    with ReplayCamera(recorded) as camera:
        with pytest.raises(SessionError, match=r"0001_light_4.998ms.tif is truncated: 4 of \d+ bytes are left"):
            camera.snap()
        assert len(camera.unused) == len(FRAMES)


def test_readings_come_in_order_until_none_is_left(recorded):
    meter = ReplayMeter(recorded)
    with meter:
        assert meter.identity == METER
        assert meter.measure() == reading(75.6)
        assert [record.reading for record in meter.unused] == [reading(75.8)]
    with meter:
        assert meter.measure() == reading(75.8)
        with pytest.raises(MeterError, match=r"^2 readings were recorded, and all were given: ask for at most 2$"):
            meter.measure()
    with pytest.raises(MeterError, match="not open"):
        meter.measure()


@pytest.mark.parametrize("device", [ReplayCamera, ReplayMeter])
def test_a_folder_that_is_not_a_session_is_refused_on_opening(tmp_path, device):
    with pytest.raises(SessionError, match=r"is not a session: it has no journal.jsonl"):
        device(tmp_path).open()


def test_the_replayed_camera_tells_what_was_recorded(tmp_path):
    with Session.create(tmp_path / "new", SessionConfiguration.from_toml(BENCH, "bench.toml")) as session:
        session.add_event("camera features", {"features": {"Gain": 1.0}})
        session.add_frame(frame(1, 0.01, temperature_c=31.0))
        session.add_frame(frame(2, 0.002, temperature_c=None))
        session.add_event("camera features", {"features": {"Gain": 2.0, "DeviceID": "SIM", "ReverseX": False}})
        session.add_event("other", {"features": {}})
    with ReplayCamera(tmp_path / "new") as camera:
        assert camera.exposure_range_s == (0.002, 0.01)
        assert camera.features() == {"Gain": 2.0, "DeviceID": "SIM", "ReverseX": False}
        assert (camera.gaps, camera.temperature_c, camera.statistics) == ((), None, StreamStatistics())
        camera.snap()
        assert camera.temperature_c == 31.0
        camera.configure(exposure_s=0.002)
        camera.snap()
        assert (camera.temperature_c, camera.statistics) == (None, StreamStatistics(completed=2))


# Pace


#: Times of arrival in seconds; the recording's clock was set back by an hour after the third frame.
FRAMES_S = (0.0, 0.25, 12.5, -3587.0, -3580.0)
READINGS_S = (5.0, 6.0, 64.0)
#: What lay between them, without the step.
FRAMES_SPAN_S, READINGS_SPAN_S = 12.5 + 7.0, 59.0


@pytest.fixture
def timed(tmp_path):
    path = tmp_path / "timed"
    with Session.create(path, SessionConfiguration.from_toml(BENCH, "bench.toml")) as session:
        for at_s in READINGS_S:
            session.add_reading(reading(75.0, at_s), patch="A1")
        for number, at_s in enumerate(FRAMES_S, start=1):
            session.add_frame(frame(number, 0.01, at_s=at_s))
    return path


@pytest.mark.parametrize("speed", [1, 10, 0.5, 3600])
def test_the_time_waited_is_the_recorded_span_over_the_speed(timed, speed):
    clock = SimulatedClock()
    with ReplayCamera(timed, speed, clock) as camera:
        times = [clock.monotonic_s() for _ in camera.grab(len(FRAMES_S))]
    assert times == pytest.approx([t / speed for t in (0, 0.25, 12.5, 12.5, FRAMES_SPAN_S)], rel=1e-12)
    clock = SimulatedClock()
    with ReplayMeter(timed, speed=speed, clock=clock) as meter:
        for _ in READINGS_S:
            meter.measure()
    assert clock.monotonic_s() == pytest.approx(READINGS_SPAN_S / speed, rel=1e-12)


def test_time_that_passed_already_is_not_waited_for_again_nor_made_up_for(timed):
    clock = SimulatedClock()
    with ReplayCamera(timed, 1, clock) as camera, ReplayMeter(timed, 1, clock) as meter:
        list(camera.grab(2))
        meter.measure()
        clock.sleep(30)
        meter.measure()
        meter.measure()
        # The meter's time is more than the 12.25 s between these two frames.
        assert clock.monotonic_s() == 0.25 + 30 + 58
        camera.snap()
        assert clock.monotonic_s() == 0.25 + 30 + 58
    with pytest.raises(InputError, match="speed is 0: give a factor above 0"):
        ReplayCamera(timed, 0)
