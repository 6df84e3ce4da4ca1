"""The simulated GigE Vision camera as Aravis and its tools see it, and its faults on the wire."""

import contextlib
import subprocess
import time
from dataclasses import replace

import numpy as np
import pytest

from labcdp.drivers.gvcp import GVCP_PORT
from labcdp.drivers.simulated.camera import SimulatedGigECamera
from labcdp.drivers.simulated.device import Readout
from labcdp.drivers.simulated.loopback import check_free
from labcdp.drivers.simulated.second_controller import SecondController
from labcdp.drivers.simulated.trouble import NO_TROUBLE, CameraTrouble
from labcdp.errors import InputError
from labcdp.pixel_format import PIXEL_FORMATS

from .conftest import SMALL, Ramp


class Reception:
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

    def until(self, wanted, timeout_s=8.0):
        """The first frame, or the first None, that is wanted."""
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s:
            seen = self.next(0.3)
            if wanted(seen):
                return seen
        raise AssertionError("no such frame")


@pytest.fixture(scope="module")
def served(aravis):
    """One camera for all tests: Aravis takes seconds to take leave of one that has gone."""
    with SimulatedGigECamera(SMALL, Ramp()) as camera:
        yield camera


@pytest.fixture
def camera_on_loopback(served):
    """The camera just switched on."""
    served.suffer(CameraTrouble(gone=True))
    served.suffer(NO_TROUBLE)
    yield served
    served.suffer(NO_TROUBLE)


@pytest.fixture
def no_other_camera(served):
    served.stop()
    yield
    served.start()


@pytest.fixture
def aravis_camera(aravis, camera_on_loopback):
    return aravis.Camera.new("127.0.0.1")


@pytest.fixture
def receiving(aravis):
    @contextlib.contextmanager
    def receive(camera):
        reception = Reception(aravis, camera)
        try:
            yield reception
        finally:
            with contextlib.suppress(Exception):  # lost by intent
                camera.stop_acquisition()
            # A stream that is given up after its camera waits for an answer.
            vars(reception).clear()

    return receive


def control(*words):
    done = subprocess.run(["arv-tool-0.8", *words], check=True, capture_output=True, text=True, timeout=20)
    return done.stdout


# --- Description --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("naming", "present", "absent"),
    [
        (
            "prosilica",
            ["'ExposureTimeAbs' = 10000 us", "'AcquisitionFrameRateAbs' = 50 Hz", "'StreamBytesPerSecond' = 124000000"],
            ["'ExposureTime' ", "'DeviceLinkThroughputLimit"],
        ),
        (
            "sfnc",
            [
                "'ExposureTime' = 10000 us",
                "'AcquisitionFrameRate' = 50 Hz",
                "'DeviceLinkThroughputLimit' = 124000000",
                "'DeviceLinkThroughputLimitMode' = 'Off'",
            ],
            ["'ExposureTimeAbs'", "'StreamBytesPerSecond'"],
        ),
    ],
)
def test_aravis_tool_reads_every_feature(aravis_tools, no_other_camera, naming, present, absent):
    with SimulatedGigECamera(replace(SMALL, naming=naming), Ramp()):
        values = control("values")
    for text in (
        *present,
        "'BinningHorizontal' = 1",
        "'BinningVerticalMode' = 'Average'",
        "'WidthMax' = 64",
        "'BlackLevel' = 7 DN",
        "'Gamma' = 1",
        "'ExposureAuto' = 'Off'",
        "'GainAuto' = 'Off'",
        "'TriggerActivation' = 'RisingEdge'",
        "'AcquisitionMode' = 'Continuous'",
        "'GevSCPSPacketSize' = 9000",
        "'GevSCPD' = 0",
        "'GevTimestampTickFrequency' = 1000000000",
        "'PayloadSize' = 6144",
        "'DeviceTemperature' = 31.5 C",
    ):
        assert text in values
    for text in absent:
        assert text not in values


def test_limits_follow_binning(aravis_camera):
    aravis_camera.set_binning(2, 4)
    assert [aravis_camera.get_width_bounds().max, aravis_camera.get_height_bounds().max] == [32, 12]
    aravis_camera.set_region(0, 0, 20, 10)
    assert [aravis_camera.get_x_offset_bounds().max, aravis_camera.get_y_offset_bounds().max] == [12, 2]
    assert aravis_camera.get_payload() == 20 * 10 * 2


def test_transport_settings_are_kept(aravis_camera):
    aravis_camera.gv_set_packet_size(1400)
    aravis_camera.gv_set_packet_delay(2500)
    assert (aravis_camera.gv_get_packet_size(), aravis_camera.gv_get_packet_delay()) == (1400, 2500)
    assert aravis_camera.get_integer("GevSCPSPacketSize") == 1400
    assert aravis_camera.get_integer("GevSCPD") == 2500


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


def test_a_frame_is_not_sooner_than_its_exposure_and_the_camera_answers_meanwhile(aravis_camera, receiving):
    aravis_camera.set_exposure_time(400_000)
    start_s = time.monotonic()
    with receiving(aravis_camera) as reception:
        assert aravis_camera.get_exposure_time() == 400_000
        answered_s = time.monotonic() - start_s
        ids = [reception.next(5)[1] for _ in range(3)]
    # Half a period of the 50 frames/s each.
    assert time.monotonic() - start_s >= 3 * 0.39
    assert answered_s < 0.35
    assert np.diff(ids).tolist() == [1, 1]


def test_a_triggered_frame_takes_its_exposure_and_the_camera_answers_meanwhile(aravis, aravis_camera, receiving):
    aravis_camera.set_exposure_time(300_000)
    aravis_camera.set_trigger("Software")
    with receiving(aravis_camera) as reception:
        assert reception.next(0.2) is None
        for _ in range(2):
            triggered_s = time.monotonic()
            aravis_camera.software_trigger()
            assert aravis_camera.get_exposure_time() == 300_000
            assert reception.next(5)[0] == "success"
            assert time.monotonic() - triggered_s >= 0.29
        assert reception.next(0.2) is None


class Slow(Ramp):
    """Takes long to render."""

    def expose(self, exposure_s, gain_db, index):
        time.sleep(1.5)
        return super().expose(exposure_s, gain_db, index)


def test_the_camera_answers_while_it_renders(aravis, no_other_camera, receiving):
    with SimulatedGigECamera(SMALL, Slow()):
        camera = aravis.Camera.new("127.0.0.1")
        with receiving(camera) as reception:
            longest_s = 0.0
            while reception.next(0.05) is None:
                asked_s = time.monotonic()
                assert camera.get_exposure_time() == 10_000
                longest_s = max(longest_s, time.monotonic() - asked_s)
        del camera
    # Aravis asks again after 0.5 s.
    assert longest_s < 0.5


# --- Readout ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("binning", [(1, 1), (2, 1), (1, 2), (2, 2), (4, 4), (3, 2)])
def test_binning_is_the_mean_of_its_pixels(binning):
    columns, rows = binning
    dn = np.random.default_rng(1).integers(0, 4096, (13, 21), dtype=np.uint16)
    height, width = 13 // rows, 21 // columns
    payload = Readout(0, 0, width, height, binning).payload(dn, PIXEL_FORMATS["Mono12"])
    expected = [
        [np.floor(dn[r * rows : (r + 1) * rows, c * columns : (c + 1) * columns].mean() + 0.5) for c in range(width)]
        for r in range(height)
    ]
    np.testing.assert_array_equal(payload.view("<u2").reshape(height, width), expected)


def test_full_scale_is_full_scale_in_every_format():
    dn = np.array([[0, 4095]], dtype=np.uint16)
    for name, full in (("Mono8", 255), ("Mono12", 4095), ("Mono12Packed", 4095), ("Mono16", 65535)):
        layout = PIXEL_FORMATS[name]
        assert layout.unpack(Readout(0, 0, 2, 1).payload(dn, layout), (1, 2)).tolist() == [[0, full]]


def test_black_level_moves_all_but_what_is_full():
    dn = np.array([[0, 10, 64, 4000, 4094, 4095]], dtype=np.uint16)
    for change, expected in ((-20, [0, 0, 44, 3980, 4074, 4095]), (20, [20, 30, 84, 4020, 4095, 4095])):
        payload = Readout(0, 0, 6, 1, black_level_change_dn=change).payload(dn, PIXEL_FORMATS["Mono12"])
        assert payload.view("<u2").tolist() == expected


# --- Faults -------------------------------------------------------------------------------------------------------


def test_a_stalled_camera_answers_and_sends_nothing(camera_on_loopback, aravis_camera, receiving):
    with receiving(aravis_camera) as reception:
        assert reception.next()[0] == "success"
        camera_on_loopback.suffer(CameraTrouble(stalled=True))
        reception.until(lambda seen: seen is None)
        assert aravis_camera.get_exposure_time() > 0
        camera_on_loopback.suffer(NO_TROUBLE)
        assert reception.until(lambda seen: seen is not None)[0] == "success"


@pytest.mark.parametrize("grabbing", [False, True])
def test_a_frozen_camera_is_silent_and_goes_on(aravis, camera_on_loopback, receiving, grabbing):
    camera = aravis.Camera.new("127.0.0.1")
    with receiving(camera) if grabbing else contextlib.nullcontext() as reception:
        camera_on_loopback.suffer(CameraTrouble(frozen=True))
        if grabbing:
            reception.until(lambda seen: seen is None)
        aravis.update_device_list()
        assert aravis.get_n_devices() == 0
        camera_on_loopback.suffer(NO_TROUBLE)
        aravis.update_device_list()
        assert aravis.get_n_devices() == 1
        if grabbing:
            assert reception.until(lambda seen: seen is not None)[0] == "success"
        assert camera.get_exposure_time() > 0


def test_lost_packets_make_incomplete_frames(camera_on_loopback, aravis_camera, receiving):
    aravis_camera.gv_set_packet_size(1000)
    with receiving(aravis_camera) as reception:
        camera_on_loopback.suffer(CameraTrouble(loss=0.5))
        assert reception.until(lambda seen: seen is not None and seen[0] != "success")[0] in (
            "missing-packets",
            "timeout",
        )
        camera_on_loopback.suffer(NO_TROUBLE)
        assert reception.until(lambda seen: seen is not None and seen[0] == "success")


def test_wrong_ids_go_back(camera_on_loopback, aravis_camera, receiving):
    with receiving(aravis_camera) as reception:
        first = reception.next()[1]
        camera_on_loopback.suffer(CameraTrouble(wrong_ids=True))
        assert reception.until(lambda seen: seen is not None and (seen[1] - first) % 65536 > 32768)
        camera_on_loopback.suffer(NO_TROUBLE)
        # The right ids go on as if they had been sent all the time.
        later = [reception.until(lambda seen: seen is not None)[1] for _ in range(8)][-2:]
        assert (later[1] - later[0]) % 65535 == 1
        assert (later[1] - first) % 65535 < 1000


def test_a_wrong_size_is_sent_and_mended(camera_on_loopback, aravis_camera, receiving):
    with receiving(aravis_camera) as reception:
        assert reception.next()[3] == (64, 48)
        camera_on_loopback.suffer(CameraTrouble(wrong_size=True))
        assert reception.until(lambda seen: seen is not None and seen[3] != (64, 48))[3] == (64, 24)
        camera_on_loopback.suffer(NO_TROUBLE)
        assert reception.until(lambda seen: seen is not None and seen[3] == (64, 48))


def test_a_camera_that_vanished_comes_back_as_after_switching_on(aravis, camera_on_loopback):
    camera = aravis.Camera.new("127.0.0.1")
    camera.set_exposure_time(1234)
    camera_on_loopback.suffer(CameraTrouble(gone=True))
    aravis.update_device_list()
    assert aravis.get_n_devices() == 0
    camera_on_loopback.suffer(NO_TROUBLE)
    assert aravis.Camera.new("127.0.0.1").get_exposure_time() == 10_000


def test_a_size_that_was_wrong_when_the_power_went_is_right_afterwards(aravis, camera_on_loopback):
    for trouble in (CameraTrouble(wrong_size=True), CameraTrouble(wrong_size=True, gone=True)):
        camera_on_loopback.suffer(trouble)
    camera_on_loopback.suffer(CameraTrouble(wrong_size=True))
    camera = aravis.Camera.new("127.0.0.1")
    assert camera.get_region().height == 24
    camera_on_loopback.suffer(NO_TROUBLE)
    assert camera.get_region().height == 48


def may_be_controlled():
    client = SecondController(("127.0.0.1", GVCP_PORT))
    try:
        return client.take()
    finally:
        client.release()


@pytest.mark.parametrize("controlled", [False, True])
def test_a_second_controller_has_it_until_it_lets_go(aravis, camera_on_loopback, controlled):
    first = aravis.Camera.new("127.0.0.1") if controlled else None
    assert may_be_controlled() is not controlled
    camera_on_loopback.suffer(CameraTrouble(taken=True))
    assert not may_be_controlled()
    if controlled:
        assert not aravis.Camera.new("127.0.0.1").get_device().is_controller()
    camera_on_loopback.suffer(NO_TROUBLE)
    assert may_be_controlled()
    del first


def test_a_second_controller_stays_in_control(aravis, camera_on_loopback):
    """The camera lets go of a controller that is silent for 3 s."""
    camera_on_loopback.suffer(CameraTrouble(taken=True))
    time.sleep(3.5)
    assert not may_be_controlled()


def test_the_temperature_register_follows(aravis, no_other_camera):
    temperature_c = [20.0]
    with SimulatedGigECamera(SMALL, Ramp(), temperature=lambda: temperature_c[-1]) as served:
        camera = aravis.Camera.new("127.0.0.1")
        assert camera.get_float("DeviceTemperature") == 20.0
        temperature_c.append(28.3)
        served.follow_temperature()
        assert camera.get_float("DeviceTemperature") == pytest.approx(28.3)
        # While there is a camera to take leave of.
        del camera


def test_a_camera_stopped_in_trouble_stays_off(no_other_camera):
    camera = SimulatedGigECamera(SMALL, Ramp()).start()
    camera.suffer(CameraTrouble(gone=True))
    camera.stop()
    camera.suffer(NO_TROUBLE)
    check_free("127.0.0.1")


@pytest.mark.parametrize("loss", [-0.1, 1.5, float("nan")])
def test_a_share_is_one(loss):
    with pytest.raises(InputError, match=r"loss is .*: give a share from 0 to 1"):
        CameraTrouble(loss=loss)
