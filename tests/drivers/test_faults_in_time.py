"""Faults of the devices in this process, in simulated time: each second takes none."""

import time
from datetime import UTC, datetime

import numpy as np
import pytest

from labcdp.clock import SimulatedClock
from labcdp.drivers.camera import (
    CameraBusyError,
    CameraError,
    CameraLostError,
    CameraNotFoundError,
    FrameTimeoutError,
    IncompleteFrameError,
)
from labcdp.drivers.meter import MeterError, MeterProtocolError, MeterReportedError, MeterTimeoutError
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.drivers.simulated.faults import METER_CODES
from labcdp.errors import ConfigurationError, InputError
from labcdp.reading import CD_M2_PER_FL

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


def test_lost_packets_are_refused_counted_and_taken_again(bench, camera):
    bench.obey("lose 0.3%")
    refused = []
    frames = list(camera.grab(30, on_refused=refused.append))
    # 43 packets a frame: of 30 whole ones, 4 more are lost on average.
    assert len(frames) == 30
    assert refused
    assert {error.status for error in refused} == {"MISSING_PACKETS"}
    assert camera.statistics.completed == 30
    assert camera.statistics.failed == len(refused) <= camera.statistics.missing
    ids = sorted([frame.frame_id for frame in frames] + [error.frame_id for error in refused])
    assert ids == list(range(1, len(ids) + 1))


@pytest.mark.parametrize(
    ("fault", "error", "after_s"),
    [
        ("lose 100% for 5 s", IncompleteFrameError, 5),
        ("wrong ids for 5 s", IncompleteFrameError, 5),
        ("wrong size for 5 s", IncompleteFrameError, 5),
        ("stall for 5 s", FrameTimeoutError, 5),
        ("vanish for 5 s", CameraLostError, 5),
        ("freeze for 5 s", CameraLostError, 5),
        ("second controller for 5 s", CameraLostError, 5),
    ],
)
def test_each_fault_ends_in_its_error_and_then_in_frames(bench, clock, camera, fault, error, after_s):
    bench.obey(fault)
    began_s = clock.monotonic_s()
    with pytest.raises(error):
        camera.snap()
    assert clock.monotonic_s() - began_s <= 3
    clock.sleep(after_s)
    if error is CameraLostError:
        with pytest.raises(CameraLostError, match=r"is lost, .*: let the simulated camera recover, then open it again"):
            camera.snap()
        camera.close()
        camera.open()
    assert camera.snap().dn.shape == SHAPE


@pytest.mark.parametrize("fault", ["vanish for 5 s", "freeze for 5 s", "second controller for 5 s"])
def test_patience_survives_and_records_the_gap(bench, clock, fault):
    with bench.in_process_camera(patience_s=20) as camera:
        camera.configure(exposure_s=0.004, gain_db=6.0)
        bench.obey(fault)
        frame = camera.snap()
        assert (frame.exposure_s, frame.gain_db) == (0.004, 6.0)
        (gap,) = camera.gaps
        assert gap.duration_s == pytest.approx((gap.back_at - gap.lost_at).total_seconds(), abs=1e-5)
        assert gap.duration_s == pytest.approx(5, abs=0.21)
        assert camera.settings.exposure_s == 0.004


def test_patience_ends(bench, clock):
    with bench.in_process_camera(patience_s=20) as camera:
        bench.obey("vanish")
        with pytest.raises(CameraLostError):
            camera.snap()
        assert 20 <= clock.monotonic_s() <= 22
        assert camera.gaps == ()
        bench.obey("recover")
        assert camera.snap().dn.shape == SHAPE
        assert len(camera.gaps) == 1


def test_short_silence_makes_a_late_frame_only(bench, camera):
    for fault in ("freeze for 800 ms", "stall for 1.9 s"):
        bench.obey(fault)
        assert camera.snap().dn.shape == SHAPE
    assert camera.gaps == ()


def test_a_loss_during_a_long_exposure_is_noticed(bench, clock, camera):
    camera.configure(exposure_s=30)
    bench.schedule("at 10 s vanish for 5 s")
    with pytest.raises(CameraLostError, match="it does not answer"):
        camera.snap()


@pytest.mark.parametrize(
    ("fault", "error"),
    [("vanish", CameraNotFoundError), ("freeze", CameraNotFoundError), ("second controller", CameraBusyError)],
)
def test_a_camera_in_trouble_does_not_open(bench, fault, error):
    bench.obey(fault)
    camera = bench.in_process_camera()
    with pytest.raises(error):
        camera.open()
    bench.obey("recover")
    with camera:
        assert camera.snap().dn.shape == SHAPE


def test_a_later_fault_of_a_kind_takes_the_place_of_the_earlier(bench, clock, camera):
    bench.obey("lose 100% for 10 s")
    clock.sleep(5)
    bench.obey("lose 100% for 10 s")
    clock.sleep(8)  # the first would be over by now
    with pytest.raises(IncompleteFrameError):
        camera.snap()
    clock.sleep(3)
    camera.snap()


def test_what_the_camera_tells(camera):
    features = camera.features()
    assert features["ExposureTimeAbs"] == 10_000
    assert (features["SensorWidth"], features["SensorHeight"]) == (480, 400)
    assert camera.exposure_range_s == pytest.approx((21e-6, 60))
    assert camera.temperature_c == 35


@pytest.mark.parametrize("patience_s", [-1, float("nan")])
def test_patience_is_checked(bench, patience_s):
    with pytest.raises(InputError, match=f"patience_s is {patience_s}: give a number of seconds of at least 0"):
        bench.in_process_camera(patience_s=patience_s)


# --- Drifts -------------------------------------------------------------------------------------------------------


def test_light_drifts_for_camera_and_meter(bench, clock, camera, meter, small_configuration):
    bench.point_meter("upper left")
    region = next(p.region() for p in small_configuration.target.patches if p.name == "upper left")
    camera.configure(exposure_s=0.0005)

    def seen():
        return region.select(camera.snap().dn).mean() - 64, meter.measure().luminance_cd_m2

    camera_before, meter_before = seen()
    bench.obey("light -20% in 100 s")
    clock.sleep(50)
    # A frame and a reading take less than 1 s, which is 0.2 % of light; repeatability is 0.1 %.
    halfway = seen()
    assert halfway[0] / camera_before == pytest.approx(0.9, abs=0.005)
    assert halfway[1] / meter_before == pytest.approx(0.9, abs=0.008)
    clock.sleep(1000)
    assert bench.light_rel == pytest.approx(0.8)
    bench.obey("light +25%")
    assert bench.light_rel == pytest.approx(1.0)


def test_temperature_drifts_in_steps_that_renew_the_pool(bench, clock, camera):
    states = {bench._source.state}
    bench.obey("temperature +8 C in 10 min")
    for _ in range(60):
        clock.sleep(10)
        states.add(bench._source.state)
    assert bench.temperature_c == pytest.approx(43)
    assert camera.temperature_c == bench.temperature_c
    assert camera.snap().temperature_c == bench.temperature_c
    assert len(states) == 61


# --- Meter --------------------------------------------------------------------------------------------------------


def test_a_reading_takes_its_time(clock, meter):
    before_s = clock.monotonic_s()
    reading = meter.measure()
    assert clock.monotonic_s() - before_s == pytest.approx(0.8)
    assert reading.timestamp == clock.now()
    assert reading.meter.simulated


@pytest.mark.parametrize("code", METER_CODES)
def test_each_code_of_the_manual(bench, meter, code):
    bench.obey(f"meter {code}")
    with pytest.raises(MeterReportedError) as raised:
        meter.measure()
    assert raised.value.code == code
    assert meter.measure().value > 0


@pytest.mark.parametrize(
    ("fault", "error", "message", "takes_s"),
    [
        ("meter truncate 7", MeterTimeoutError, r"broke off after 7 bytes \(b'OK00,Cc'\)", 6),
        ("meter truncate 0", MeterTimeoutError, "no answer to MES within 6 s", 6),
        ("meter delay 8 s", MeterTimeoutError, "no answer to MES within 6 s", 6),
        ("meter drop", MeterTimeoutError, "no answer to MES within 6 s: .*in remote mode", 6),
        ("meter garble", MeterError, "sent|broke off", 6),
        ("meter unplug", MeterError, "connection to the simulated meter broke: plug it in", 0),
    ],
)
def test_each_fault_of_the_meter_ends_in_its_error_and_then_in_readings(
    bench, clock, meter, fault, error, message, takes_s
):
    bench.obey(fault)
    before_s = clock.monotonic_s()
    with pytest.raises(error, match=message):
        meter.measure()
    assert clock.monotonic_s() - before_s <= takes_s
    bench.obey("recover")
    assert meter.measure().value > 0


def test_garbage_comes_with_and_without_its_end(bench, meter):
    kinds = set()
    for _ in range(20):
        bench.obey("meter garble")
        with pytest.raises(MeterError) as raised:
            meter.measure()
        kinds.add(type(raised.value))
    assert kinds == {MeterProtocolError, MeterTimeoutError}


def test_a_short_delay_only_delays(bench, clock, meter):
    bench.obey("meter delay 3 s")
    before_s = clock.monotonic_s()
    assert meter.measure().value > 0
    assert clock.monotonic_s() - before_s == pytest.approx(3.8)


def test_the_unit_switch_changes_the_number_and_not_the_luminance(bench, meter):
    bench.point_meter("upper left")
    before = meter.measure()
    bench.obey("meter unit fL")
    after = meter.measure()
    assert (before.unit, after.unit) == ("cd/m2", "fL")
    # Repeatability 0.1 % and four digits.
    assert after.value * CD_M2_PER_FL == pytest.approx(before.value, rel=0.008)


def test_a_meter_out_of_remote_mode_does_not_open(bench):
    bench.obey("meter drop")
    meter = bench.in_process_meter()
    bench.obey("meter drop")
    with pytest.raises(MeterTimeoutError, match="remote mode"):
        meter.open()
    bench.obey("meter remote")
    with meter:
        assert meter.measure().value > 0


# --- Schedule -----------------------------------------------------------------------------------------------------


def test_a_schedule_with_a_mistake_does_nothing(bench, clock, camera):
    with pytest.raises(ConfigurationError, match=r"night, line 2: .*write for example"):
        bench.schedule("at 1 s vanish\nat 2 s vanisch", "night")
    clock.sleep(5)
    camera.snap()


def test_a_closed_bench_has_no_more_faults(bench, clock, camera):
    bench.schedule("at 1 s vanish")
    bench.close()
    clock.sleep(5)
    camera.snap()


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
