"""The simulated GigE Vision camera as Aravis and its tools see it, and its faults on the wire."""

import contextlib
import subprocess
import time
from dataclasses import replace

import numpy as np
import pytest

from labcdp.drivers.simulated.genicam import standard_features
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera

from ..conftest import SMALL, Ramp


class FrameStream:
    """A stream through Aravis itself, without our driver."""

    def __init__(self, aravis, camera):
        self._camera = camera
        self._stream = camera.create_stream(None, None)
        for _ in range(6):
            self._stream.push_buffer(aravis.Buffer.new_allocate(camera.get_payload()))
        camera.start_acquisition()

    def next(self, timeout_s=2.0):
        """Status, id, bytes and size of the next frame; None for none."""
        buffer = self._stream.timeout_pop_buffer(int(timeout_s * 1e6))
        if buffer is None:
            return None
        status = buffer.get_status().value_nick
        if status == "success":
            size = buffer.get_image_width(), buffer.get_image_height()
            seen = status, buffer.get_frame_id(), np.frombuffer(buffer.get_data(), np.uint8), size
        else:
            seen = status, buffer.get_frame_id(), None, None
        self._stream.push_buffer(buffer)
        return seen


@pytest.fixture(scope="module")
def served(aravis):
    """One camera for all tests: Aravis takes seconds to take leave of one that has gone."""
    with SimulatedGigECamera(SMALL, Ramp()) as camera:
        yield camera


@pytest.fixture
def camera_on_loopback(served):
    """The camera just switched on."""
    served.set_faults({"vanish": 0})
    served.set_faults({})
    yield served
    served.set_faults({})


@pytest.fixture
def no_other_camera(served):
    served.close()
    yield
    served.open()


@pytest.fixture
def aravis_camera(aravis, camera_on_loopback):
    return aravis.Camera.new("127.0.0.1")


@pytest.fixture
def receiving(aravis):
    @contextlib.contextmanager
    def receive(camera):
        reception = FrameStream(aravis, camera)
        try:
            yield reception
        finally:
            with contextlib.suppress(Exception):  # lost by intent
                camera.stop_acquisition()
            # A stream that is given up after its camera waits for an answer.
            vars(reception).clear()

    return receive


def control(*words):
    done = subprocess.run(["arv-tool-0.8", *words], check=True, capture_output=True, text=True, timeout=300)
    return done.stdout


@pytest.mark.parametrize(
    ("naming", "present", "absent"),
    [
        ("prosilica", ["'ExposureTimeAbs' = 10000 us", "'StreamBytesPerSecond' = 124000000"], "'ExposureTime' "),
        ("sfnc", ["'ExposureTime' = 10000 us", "'DeviceLinkThroughputLimitMode' = 'Off'"], "'ExposureTimeAbs'"),
    ],
)
def test_aravis_tool_reads_every_feature(aravis_tools, no_other_camera, naming, present, absent):
    with SimulatedGigECamera(replace(SMALL, features=standard_features(naming)), Ramp()):
        values = control("values")
    present += ["'BinningVerticalMode' = 'Average'", "'WidthMax' = 64", "'BlackLevel' = 7 DN", "'Gamma' = 1"]
    present += ["'TriggerActivation' = 'RisingEdge'", "'GevSCPSPacketSize' = 9000", "'PayloadSize' = 6144"]
    for text in (*present, "'GevTimestampTickFrequency' = 1000000000", "'DeviceTemperature' = 31.5 C"):
        assert text in values
    assert absent not in values


def test_binning_region_and_black_level_reach_the_pixels(aravis_camera, receiving):
    aravis_camera.set_exposure_time(3000)
    aravis_camera.set_binning(2, 4)
    aravis_camera.set_region(3, 1, 16, 8)
    aravis_camera.set_float("BlackLevel", 27)
    with receiving(aravis_camera) as reception:
        _, _, data, size = reception.next()
    assert size == (16, 8)
    # Columns 6 and 7 of the ramp average to 6.5, rounded up; black level raised from 7 to 27.
    expected = np.arange(3, 19) * 2 + 1 + 20
    np.testing.assert_array_equal(data.view("<u2").reshape(8, 16), np.tile(expected, (8, 1)))


def test_a_frame_is_not_sooner_than_its_exposure(aravis_camera, receiving):
    aravis_camera.set_exposure_time(300_000)
    start_s = time.monotonic()
    with receiving(aravis_camera) as reception:
        ids = [reception.next(30)[1] for _ in range(2)]
    # Half a period of the 50 frames/s each.
    assert time.monotonic() - start_s >= 2 * 0.29
    assert np.diff(ids).tolist() == [1]


def test_a_triggered_frame_takes_its_exposure_and_the_camera_answers_meanwhile(aravis, aravis_camera, receiving):
    aravis_camera.set_exposure_time(300_000)
    aravis_camera.set_trigger("Software")
    with receiving(aravis_camera) as reception:
        assert reception.next(0.2) is None
        for _ in range(2):
            triggered_s = time.monotonic()
            aravis_camera.software_trigger()
            assert aravis_camera.get_exposure_time() == 300_000
            assert reception.next(30)[0] == "success"
            assert time.monotonic() - triggered_s >= 0.29
        assert reception.next(0.2) is None
