"""The simulated camera as others see it: two GigE Vision clients for Python that share no code with labcdp."""

import struct
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from labcdp.drivers.aravis import gvcp
from labcdp.drivers.simulated.genicam import CHUNK_IDS, RegisterAddress, standard_features
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera

from ..conftest import SMALL, Ramp

DEVICE = replace(SMALL, frame_rate_hz=100, first_frame_id=0xFFFD, features=standard_features("sfnc"))
ADDRESS = "127.0.0.1"
EXPOSURE_US, GAIN_DB = 3000, 4.5


@pytest.fixture
def camera(aravis):
    with SimulatedGigECamera(DEVICE, Ramp()) as camera:
        yield camera


def check(frames, ids):
    """Frames whose pixels tell exposure and gain on top of a ramp, with ids that follow each other."""
    for frame in frames:
        assert (frame.shape, list(frame[0, :2])) == ((48, 64), [EXPOSURE_US, round(GAIN_DB * 10)])
        assert (frame[1:] == np.arange(64)).all()
    assert all(after == before % 0xFFFF + 1 for before, after in pairwise(ids))


@pytest.mark.parametrize("share_lost", [0.0, 0.05])
def test_a_client_in_pure_python_discovers_it_and_receives_its_frames(camera, share_lost):
    gige = pytest.importorskip("pyGigEVision")
    camera.set_faults({"resend": 0.0})
    (seen,) = gige.discover(interface_ip=ADDRESS, timeout=0.5)
    assert (seen["ip"], seen["serial"], seen["model"]) == (ADDRESS, DEVICE.serial, DEVICE.model)
    with gige.GVCPClient(ADDRESS) as client:
        # Its own function takes the address, which is hexadecimal without a prefix, for a decimal one.
        _, address, n_bytes = client.read_mem(0x200, 512).split(b"\0")[0].decode().split(";")
        assert b"ChunkExposureTime" in client.read_mem(int(address, 16), int(n_bytes, 16))
        # It counts the headers of the stream, and not those of IP.
        receiver = gige.GVSPReceiver(local_ip=ADDRESS, gvcp_client=client, packet_size=600 - 28)
        receiver.start()
        for address, value in (
            (0x120, EXPOSURE_US),
            (0x110, round(GAIN_DB * 10)),
            (gvcp.STREAM_CHANNEL_PACKET_SIZE, 600),
            (gvcp.STREAM_CHANNEL_ADDRESS, 0x7F000001),
            (gvcp.STREAM_CHANNEL_PORT, receiver.port),
            (0x124, 1),
        ):
            client.write_reg(address, value)
        camera.set_faults({"resend": 0.0, "lose": share_lost})
        received = [receiver.get_frame_with_info(timeout=3.0) for _ in range(10)]
        client.write_reg(0x124, 0)
        receiver.stop()
        receiver.close()
    whole = [(frame, about["block_id"]) for frame, about in received if about["complete"]]
    assert len(whole) == 10 if not share_lost else whole
    check([frame for frame, _ in whole], [] if share_lost else [number for _, number in whole])


def test_a_client_in_rust_reads_features_and_chunks_of_each_frame(camera):
    viva = pytest.importorskip("viva_genicam")
    (seen,) = [device for device in viva.discover(all=True, timeout_ms=200) if device.ip == ADDRESS]
    assert (seen.manufacturer, seen.model) == (DEVICE.vendor, DEVICE.model)
    with viva.Camera.open(seen) as client:
        assert client.skipped() == []
        assert client.get_string("DeviceModelName") == DEVICE.model
        assert client.get_float("DeviceTemperature") == DEVICE.temperature_c
        client.set_float("ExposureTime", EXPOSURE_US)
        client.set_float("Gain", GAIN_DB)
        assert (client.get_float("ExposureTime"), client.get_float("Gain")) == (EXPOSURE_US, GAIN_DB)
        pixels = client.get_integer("PayloadSize")
        client.set_bool("ChunkModeActive", True)
        for name in client.enum_entries("ChunkSelector"):
            client.set_enum("ChunkSelector", name)
            client.set_bool("ChunkEnable", True)
        assert client.get_integer("PayloadSize") == pixels + 3 * 4 + 8 + 5 * 8
        with client.stream() as stream:
            frames = [next(stream) for _ in range(6)]
    check([frame.to_numpy() for frame in frames], [frame.block_id for frame in frames])
    stamps = []
    for frame in frames:
        chunks = {name: frame.chunks[chunk] for name, chunk in CHUNK_IDS.items()}
        (exposure_us,), (gain,), (number,) = (
            struct.unpack(">I", chunks[name]) for name in ("ExposureTime", "Gain", "FrameID")
        )
        assert (exposure_us, gain / 10, number) == (EXPOSURE_US, GAIN_DB, frame.block_id)
        stamps += struct.unpack(">Q", chunks["Timestamp"])
    assert all(before < after for before, after in pairwise(stamps))


def test_a_client_in_rust_receives_ids_of_64_bits(camera):
    viva = pytest.importorskip("viva_genicam")
    (seen,) = [device for device in viva.discover(all=True, timeout_ms=200) if device.ip == ADDRESS]
    with viva.Camera.open(seen) as client:
        client.set_enum("GevGVSPExtendedIDMode", "On")
        with client.stream() as stream:
            ids = [next(stream).block_id for _ in range(5)]
    assert camera._registers.read(RegisterAddress.LONG_IDS) == 1
    assert all(after == before + 1 for before, after in pairwise(ids))
    assert ids[-1] > 0xFFFF
