"""What every camera does, whatever carries its frames.

The simulated camera over GigE Vision and in this process, and Aravis' own simulator as a program of others. The one in
this process has a virtual clock, so its seconds take none.
"""

import subprocess
import threading
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from labcdp.core.clock import Clock, SimulatedClock, SystemClock
from labcdp.drivers.aravis import gvcp
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera import (
    CameraError,
    CameraLostError,
    CameraSettingError,
    FrameTimeoutError,
    IncompleteFrameError,
)
from labcdp.drivers.camera_settings import CameraSetup
from labcdp.drivers.simulated.bench import SimulatedBench, SimulatedDevices

from ..conftest import wait_until

ADDRESS = "127.0.0.1"
SHAPE = (400, 480)


@dataclass
class Transport:
    """How a camera is opened, with a patience in seconds, and how it comes to a fault or recovers from one."""

    camera: Callable
    run: Callable
    clock: Clock = field(default_factory=SystemClock)
    gain_db: float = 6.0


def wired(patience_s=0.0):
    return AravisCamera(ADDRESS, patience_s=patience_s)


@contextmanager
def in_process(configuration):
    """The simulated bench's camera without a network."""
    clock = SimulatedClock()
    with SimulatedBench(configuration, SimulatedDevices.standard(seed=3), SHAPE, clock) as bench:
        yield Transport(bench.in_process_camera, bench.run_command, clock)


@contextmanager
def on_the_wire(configuration):
    """The same camera over GigE Vision on loopback."""
    with SimulatedBench(configuration, SimulatedDevices.standard(seed=3), SHAPE) as bench, bench.gige_camera(ADDRESS):
        yield Transport(wired, bench.run_command)


@contextmanager
def with_chunks(configuration):
    """The simulated camera with the names of the standard, which sends its frames with chunk data itself."""
    devices = replace(SimulatedDevices.standard(seed=3), naming="sfnc")
    with SimulatedBench(configuration, devices, SHAPE) as bench, bench.gige_camera(ADDRESS):
        yield Transport(wired, bench.run_command)


@contextmanager
def of_aravis(_configuration):
    """Aravis' simulator, which can only be switched off and on; its gain counts in steps of its own."""
    processes, timers = [], []

    def switch_on():
        processes.append(subprocess.Popen(["arv-fake-gv-camera-0.8", "-i", ADDRESS]))
        wait_until(lambda: gvcp.announce(ADDRESS) is not None, "it answers")

    def switch_off():
        processes[-1].kill()
        processes[-1].wait()

    def run(fault):
        if fault == "recover":
            switch_on()
            return
        switch_off()
        if seconds := fault.removeprefix("vanish").removeprefix(" for ").removesuffix(" s"):
            timers.append(threading.Timer(float(seconds), switch_on))
            timers[-1].start()

    switch_on()
    yield Transport(wired, run, gain_db=0.0)
    for timer in timers:
        timer.join()
    switch_off()


#: The first shows most of what the second does, which has other senders of packets.
WIRES = [pytest.param(on_the_wire, id="wire"), pytest.param(with_chunks, id="wire with chunks", marks=pytest.mark.long)]


@pytest.fixture(
    scope="module",
    params=[*WIRES, pytest.param(in_process, id="in process"), pytest.param(of_aravis, id="of Aravis")],
)
def transport(request, aravis_tools, small_configuration):
    with request.param(small_configuration) as transport:
        yield transport


@contextmanager
def with_fault(transport, fault):
    """Have a fault in the context, and none afterwards."""
    transport.run(fault)
    try:
        yield
    finally:
        transport.run("recover")


def test_a_camera_is_used_while_it_is_open(transport):
    camera = transport.camera()
    with pytest.raises(CameraError, match="not open: use it as a context manager or call open"):
        camera.snap()
    with camera:
        assert camera.open() is camera
        assert camera.identity.simulated


def test_frames_come_whole_in_order_and_with_the_settings_asked_for(transport):
    with transport.camera() as camera:
        for exposure_s in (0.002, 0.004):
            applied = camera.configure(exposure_s=exposure_s, gain_db=transport.gain_db)
            # A busy computer may lose packets: all frames come, or are reported.
            began, ids, seen = transport.clock.now(), [], []
            for frame in camera.grab(5, on_refused=lambda error, ids=ids: ids.append(error.frame_id)):
                ids.append(frame.frame_id)
                seen.append((frame.camera_timestamp_ns, frame.timestamp, frame.temperature_c))
            assert (frame.exposure_s, frame.gain_db) == (applied.exposure_s, applied.gain_db)
            assert (frame.exposure_s, frame.gain_db) == pytest.approx((exposure_s, transport.gain_db))
            stamps, times, temperatures_c = zip(*seen, strict=True)
            # GigE Vision frame ids have 16 bits and leave out 0.
            assert all(step % 65535 == 1 for step in np.diff(ids))
            assert all(step > 0 for step in np.diff(stamps))
            assert began <= times[0] < times[-1] <= transport.clock.now()
            assert set(temperatures_c) == {camera.temperature_c}
            assert frame.shape == (applied.height, applied.width)
            assert frame.pixel_format == applied.pixel_format
            assert frame.camera == camera.identity
            assert frame.saturation_dn == 2**frame.bit_depth - 1
            assert not frame.dn.flags.writeable
        assert camera.statistics.completed >= 10
        assert camera.features()["DeviceModelName"] == camera.identity.model


def test_the_frame_rate_of_a_plan_is_set_and_read_back(transport):
    with transport.camera() as camera:
        camera.prepare(CameraSetup(frame_rate_hz=11.0))
        assert camera.settings.frame_rate_hz == pytest.approx(11.0, rel=1e-4)
        with pytest.raises(CameraSettingError, match=r"frame_rate_hz is 1e\+06 Hz.*takes .* to "):
            camera.prepare(CameraSetup(frame_rate_hz=1e6))
        assert camera.settings.frame_rate_hz == pytest.approx(11.0, rel=1e-4)


@pytest.mark.parametrize(
    "settings", [{"exposure_s": 1e4}, {"exposure_s": 1e-9}, {"gain_db": 1e3}, {"pixel_format": "Y"}]
)
def test_what_it_cannot_do_is_refused_and_changes_nothing(transport, settings):
    with transport.camera() as camera:
        before = camera.configure(exposure_s=0.003)
        with pytest.raises(CameraSettingError, match=r"takes .* to |no pixel format 'Y'.*choose|not in dB"):
            camera.configure(**({"exposure_s": 0.004} | settings))
        assert camera.settings == before
        shortest_s, longest_s = camera.exposure_range_s
        assert shortest_s < before.exposure_s < longest_s


@pytest.mark.parametrize("patience_s", [pytest.param(0.0, marks=pytest.mark.long), 0.5])
def test_a_lost_camera_is_an_error_until_it_is_opened_again(transport, patience_s):
    with transport.camera(patience_s) as camera, with_fault(transport, "vanish"):
        for use in (camera.snap, camera.snap, lambda: camera.configure(exposure_s=0.002)):
            with pytest.raises(CameraLostError, match=r": .*then open it again"):
                use()
    with transport.camera() as camera:
        assert camera.snap().dn.any()


def test_patience_bridges_a_loss_of_power_with_all_settings_and_notes_the_gap(transport):
    with transport.camera(patience_s=120) as camera:
        before = camera.configure(exposure_s=0.005, gain_db=transport.gain_db)
        frames = camera.grab(8)
        taken = [next(frames) for _ in range(2)]
        transport.run("vanish for 1 s")
        taken += frames
        (gap,) = camera.gaps
        assert camera.settings == before
        assert len(taken) == 8
        assert {(frame.exposure_s, frame.gain_db) for frame in taken} == {(before.exposure_s, before.gain_db)}
        assert gap.lost_at < gap.back_at
        assert taken[1].timestamp <= gap.lost_at
        assert all(not gap.lost_at < frame.timestamp < gap.back_at for frame in taken)
        # However late a busy computer noticed it.
        assert 0 < gap.duration_s == pytest.approx((gap.back_at - gap.lost_at).total_seconds(), abs=0.5)


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("lose 100%", (IncompleteFrameError, FrameTimeoutError)),
        ("wrong ids", IncompleteFrameError),
        ("wrong size", IncompleteFrameError),
        ("stall", FrameTimeoutError),
        ("freeze", CameraLostError),
    ],
)
# Aravis' simulator has no faults.
@pytest.mark.parametrize("transport", [*WIRES, pytest.param(in_process, id="in process")], indirect=True)
def test_each_fault_has_its_error_and_leaves_a_camera_that_works(transport, fault, error):
    camera = transport.camera().open()
    frames = camera.grab(100, timeout_s=3.0)
    next(frames)
    with with_fault(transport, fault), pytest.raises(error) as raised:
        list(frames)
    assert len(str(raised.value).splitlines()) == 1
    camera.close()
    with transport.camera() as camera:
        assert camera.snap().shape == SHAPE


@pytest.mark.parametrize("transport", WIRES, indirect=True)
def test_a_camera_that_another_program_has_taken_says_so(transport):
    with wired() as camera:
        frames = camera.grab(100, timeout_s=3.0)
        next(frames)
        # Who controls a camera loses it only with its power.
        with with_fault(transport, "vanish"):
            pass
        with wired(), pytest.raises(CameraLostError, match="taken by another program"):
            list(frames)
