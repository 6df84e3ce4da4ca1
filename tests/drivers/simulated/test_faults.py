"""The language of faults, and faults of the devices in this process, in simulated time: each second takes none."""

import pytest

from labcdp.core.clock import SimulatedClock
from labcdp.core.errors import DeviceError
from labcdp.drivers.meter import MeterError
from labcdp.drivers.simulated.bench import SimulatedBench, SimulatedDevices
from labcdp.drivers.simulated.commands import EXAMPLES, Command, parse_command, parse_schedule


@pytest.mark.parametrize(
    ("text", "command"),
    [
        ("lose 12.5 %", Command("lose", 0.125)),
        ("vanish for 1.5 min", Command("vanish", 0, 90)),
        ("WRONG  IDS for 250ms", Command("wrong ids", 0, 0.25)),
        ("light -5% in 1 h", Command("light", -0.05, 3600)),
        ("meter truncate 7", Command("meter truncate", 7)),
        ("meter unit fL", Command("meter unit", "fL")),
    ],
)
def test_what_each_command_means(text, command):
    assert parse_command(text) == command
    assert all(example.startswith(parse_command(example).kind) for example in EXAMPLES)


def test_a_schedule_is_sorted_by_time_and_may_have_comments():
    text = "# a bad night\nat 1 min vanish for 5 s\n\nat 10 s lose 5% for 20 s  # the switch\nmeter ER10\n"
    assert parse_schedule(text) == (
        Command("meter", "ER10"),
        Command("lose", 0.05, 20, at_s=10),
        Command("vanish", 0, 5, at_s=60),
    )


NIGHT = """
light -5% in 8 h
temperature +8 C in 2 h
at 30 min lose 0.2% for 10 min
at 1 h vanish for 90 s
at 2 h stall for 30 s
at 3 h freeze for 20 s
at 4 h wrong ids for 3 min
at 6 h wrong size for 2 min
at 7 h meter ER10
at 7 h meter drop
at 7.5 h meter remote
"""


def test_a_night_passes_in_no_time(small_configuration):
    """8 h with a frame and a reading every two minutes; every frame is whole, or its fault is known."""
    clock = SimulatedClock()
    bench = SimulatedBench(small_configuration, SimulatedDevices.standard(seed=3), (400, 480), clock)
    patch = next(p.region() for p in small_configuration.target.patches if p.name == "upper left")
    bench.schedule(NIGHT)
    refused, failures, frames, readings = [], [], [], []
    with bench.in_process_camera(patience_s=600) as camera, bench.in_process_meter() as meter:
        camera.configure(exposure_s=0.0005)
        while clock.monotonic_s() < 8 * 3600:
            due_s = clock.monotonic_s() + 120
            for take in (
                lambda: frames.extend(camera.grab(1, on_refused=refused.append)),
                lambda: readings.append(meter.measure().luminance_cd_m2),
            ):
                try:
                    take()
                except DeviceError as error:
                    failures.append(error)
            clock.sleep(due_s - clock.monotonic_s())
        gaps = [gap.reason for gap in camera.gaps]
    # The faults of the meter are one code, and 30 min without remote mode.
    n_meter_failures = sum(isinstance(error, MeterError) for error in failures)
    assert 15 <= n_meter_failures <= 17
    assert len(frames) + len(failures) - n_meter_failures == pytest.approx(239, abs=3)
    assert len(gaps) == 2
    assert refused
    # Camera and meter see the same light.
    light = [patch.select(frames[index].dn).mean() - 64 for index in (0, -1)]
    assert light[1] / light[0] == pytest.approx(0.95, abs=0.005)
    assert readings[-1] / readings[0] == pytest.approx(0.95, abs=0.02)
    assert frames[-1].temperature_c == pytest.approx(43)
