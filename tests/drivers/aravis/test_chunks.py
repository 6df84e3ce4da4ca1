"""Chunk data and ids of 64 bits: real streams of a simulated camera, received by Aravis over loopback."""

import logging
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.aravis.chunks import ChunkData, n_frames_unsent, repetition
from labcdp.drivers.aravis.library import discover
from labcdp.drivers.camera import MOST_REFUSED, IncompleteFrameError
from labcdp.drivers.doctor.camera import check_camera
from labcdp.drivers.network import interfaces
from labcdp.drivers.simulated.genicam import standard_features
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera

from ..conftest import SMALL, Ramp

#: Odd sizes: packed pixels end within a byte, and chunks begin at a multiple of 4.
DEVICE = replace(SMALL, width=63, height=47, frame_rate_hz=100, features=standard_features("sfnc"))
LONG_IDS = {"GevGVSPExtendedIDMode": "On"}


@contextmanager
def simulated(planned=None, faults=None, **device):
    """The simulated camera, with faults, and the driver, which sets features as a plan does."""
    with SimulatedGigECamera(replace(DEVICE, **device), Ramp((47, 63))) as camera:
        camera.set_faults(faults or {})
        with opened(planned) as driver:
            yield camera, driver


@contextmanager
def opened(features):
    with AravisCamera("127.0.0.1") as driver:
        for name, value in (features or {}).items():
            driver.set_feature(name, value)
        yield driver


@pytest.mark.parametrize("bare_chunks", [False, True])
def test_each_frame_comes_with_exposure_gain_time_and_number_as_set(aravis, bare_chunks):
    with simulated(bare_chunks=bare_chunks) as (_, camera):
        for exposure_s, gain_db, pixel_format in ((2e-3, 4.5, "Mono12Packed"), (3e-3, 0.0, "Mono12")):
            settings = camera.configure(exposure_s=exposure_s, gain_db=gain_db, pixel_format=pixel_format)
            values = []
            for frame in camera.grab(3):
                assert list(frame.dn[0, :2]) == [round(exposure_s * 1e6), round(gain_db * 10)]
                assert list(frame.dn[5, 3:6]) == [3, 4, 5]
                assert camera.chunk_data.counter == frame.frame_id
                values.append(camera.chunk_data)
            assert [data.exposure_us for data in values] == pytest.approx([settings.exposure_s * 1e6] * 3)
            assert [data.gain_db for data in values] == pytest.approx([gain_db] * 3)
            assert all(before.timestamp < after.timestamp for before, after in pairwise(values))
        # 63 x 47 pixels of 2 bytes, to a multiple of 4; then 4 chunks of 4 or 8 bytes, and 5 times id and size.
        assert camera.feature("PayloadSize") == 5924 + (3 * 4 + 8) + 5 * 8


def test_a_frame_that_is_not_as_set_is_refused_and_taken_again(aravis):
    with simulated() as (sender, camera):
        camera.configure(exposure_s=2e-3)
        sender.set_faults({"wrong exposure": 0.0})
        refused = []

        def recover(error):
            refused.append(error)
            if len(refused) == 2:
                sender.set_faults({})

        frame = camera.snap(on_refused=recover)
        assert {error.status for error in refused} == {"NOT_AS_SET"}
        assert frame.dn[0, 0] == 2000


def test_a_camera_that_stays_otherwise_ends_in_one_clear_line(aravis):
    with simulated() as (sender, camera):
        camera.configure(exposure_s=2e-3)
        sender.set_faults({"wrong exposure": 0.0})
        refused = []
        with pytest.raises(IncompleteFrameError) as raised:
            camera.snap(on_refused=refused.append)
        assert len(refused) == MOST_REFUSED - 1
        (line,) = str(raised.value).splitlines()
        assert "is not as set, it was exposed for 4 ms, not for the 2 ms set: it was discarded; switch off what" in line
        # Its remedy for a camera whose chunk data are wrong.
        assert "set ChunkModeActive = false in [camera.features]" in line
        camera.set_feature("ChunkModeActive", False)
        assert camera.snap().dn[0, 0] == 4000
        assert camera.chunk_data == ChunkData()


def test_chunks_that_are_switched_off_are_not_compared(aravis):
    with simulated({"ChunkSelector": "ExposureTime", "ChunkEnable": False}) as (sender, camera):
        sender.set_faults({"wrong exposure": 0.0})
        camera.configure(exposure_s=2e-3)
        assert camera.snap().dn[0, 0] == 4000
        assert camera.chunk_data.exposure_us is None
        assert camera.chunk_data.gain_db == 0.0


def without(**changed):
    """Features of a camera whose chunk data differ."""
    table = standard_features("sfnc")
    chunks = {name: of | changed.get(name, {}) for name, of in table["ChunkDataControl"].items()}
    return dict(table) | {"ChunkDataControl": chunks}


#: What the registers of the camera take is not what its description says, or it has other chunks.
ODD = {
    "the mode is locked": without(ChunkModeActive={"access": "RO"}),
    "no chunk can be switched": without(ChunkEnable={"access": "RO"}),
    "none can be selected": without(ChunkSelector={"access": "RO"}),
    "it has others": without(ChunkSelector={"choices": {"CRC": 0, "LineStatusAll": 1}}),
    "its exposure is in other units": without(ChunkExposureTime={"unit": "ms", "steps": 7}),
}


@pytest.mark.parametrize("features", ODD.values(), ids=ODD)
def test_a_camera_with_odd_chunks_is_opened_and_its_frames_come(aravis, features):
    with simulated(features=features) as (_, camera):
        camera.configure(exposure_s=2e-3)
        assert camera.snap().dn[0, 0] == 2000


def test_the_doctor_names_what_comes_with_frames_and_leaves_the_mode_as_it_was(aravis):
    with SimulatedGigECamera(DEVICE, Ramp((47, 63))) as sender:
        (info,) = [camera for camera in discover() if camera.address == sender.address]
        checks = {check.topic: check for check in check_camera(info, interfaces(), stream=True)}
        assert "exposure time 10 ms, gain 0 dB, timestamp" in checks["chunk data"].cause
        assert sender._registers.read(0x180) == 0
        sender.set_faults({"wrong exposure": 0.0})
        checks = {check.topic: check for check in check_camera(info, interfaces(), stream=True)}
        assert "chunk data" not in checks
        assert checks["frames"].state == "fault"
        assert "exposed for 20 ms, not for the 10 ms set" in checks["frames"].cause


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        (ChunkData(timestamp=5), ChunkData(timestamp=5), "its timestamp 5 is that of the frame before"),
        (ChunkData(counter=5), ChunkData(counter=5), "its frame counter 5 is that of the frame before"),
    ],
)
def test_a_frame_that_comes_twice_is_told_from_the_next(before, now, said):
    assert repetition(before, now).startswith(said)


@pytest.mark.parametrize(
    ("before", "now", "n_unsent"),
    [
        ((7, 5), (8, 6), 0),
        ((7, 5), (9, 7), 0),
        ((7, 5), (8, 9), 3),
        ((7, 0xFFFF), (8, 0), 0),
        ((0xFFFF, 5), (1, 6), 0),
        ((7, 5), (8, 2**24), 0),
    ],
)
def test_frames_that_the_camera_counted_but_did_not_send_are_noted(before, now, n_unsent):
    assert n_frames_unsent(*before, *now) == n_unsent


@pytest.mark.parametrize("first_frame_id", [0xFFFE, 0xFFFFFFFE, 2**63 - 2])
def test_ids_of_64_bits_go_on_where_shorter_ones_run_over(aravis, first_frame_id):
    with simulated(LONG_IDS, first_frame_id=first_frame_id) as (_, camera):
        ids = [frame.frame_id for frame in camera.grab(5)]
        assert all(after == before + 1 for before, after in pairwise(ids))
        assert ids[0] >= first_frame_id
        assert ids[-1] > first_frame_id + 2
        assert camera.statistics.failed == 0


@pytest.mark.parametrize("features", [{}, LONG_IDS], ids=["16 bits", "64 bits"])
def test_lost_packets_of_frames_with_chunks_come_again(aravis, features, caplog):
    # Frames of many packets.
    with (
        simulated(features, {"resend": 0.0}, first_frame_id=0xFFF0) as (sender, camera),
        caplog.at_level(logging.ERROR),
    ):
        camera.set_feature("GevSCPSPacketSize", 576)
        camera.configure(exposure_s=1e-3, pixel_format="Mono12")
        sender.set_faults({"resend": 0.0, "lose": 0.05})
        expected = np.arange(63)
        for frame in camera.grab(30, on_refused=lambda _: None):
            assert (frame.dn[1:] == expected).all()
        counted = camera.statistics
        assert counted.resent > 0
    assert not caplog.records
