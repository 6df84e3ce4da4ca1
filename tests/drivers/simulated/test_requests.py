"""Requests that are no requests of a client: the simulated camera's process survives them, and answers clients."""

import socket
import struct
import subprocess
import sys

import numpy as np
import pytest

from labcdp.drivers.aravis import gvcp
from labcdp.drivers.aravis.camera import AravisCamera

_CAMERA = """
import sys
from tests.drivers.conftest import SMALL, Ramp
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera
with SimulatedGigECamera(SMALL, Ramp()):
    print("ready", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def process(aravis, request):
    with subprocess.Popen(
        [sys.executable, "-c", _CAMERA],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=request.config.rootpath,
        text=True,
    ) as camera:
        assert camera.stdout.readline() == "ready\n"
        yield camera
        camera.stdin.close()
        assert camera.wait(60) == 0


@pytest.fixture
def client():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        sending.connect(("127.0.0.1", gvcp.GVCP_PORT))
        yield sending


def command(code, payload, length=None):
    return struct.pack(">BBHHH", 0x42, 1, code, len(payload) if length is None else length, 1) + payload


def writes(code, *pairs):
    return [command(code, struct.pack(">II", *pair)) for pair in pairs]


#: Control of the camera, its width, height, binning, packet size, pixel format, frame period and acquisition.
WRITTEN = [
    *((address, value) for address in (0x100, 0x104) for value in (0, 65, 49_000, 0xFFFFFFFF)),
    *((0xD04, value) for value in (0, 36, 37, 0xFFFF)),
    *((0x128, value) for value in (0, 0x01FF0005, 0xFFFFFFFF)),
    *((0x108, 0), (0x138, 0), (0x200, 0x4C6F6361), (0xFFFC, 1), (0xFFFE, 1), (0x10000, 1), (0xFFFFFFFC, 1)),
]

HOSTILE = {
    "register beyond": [command(0x80, struct.pack(">I", 0x10000 + n)) for n in (10**5, 10**6, 0x7FFF0000, 0xFFFEFFFF)],
    "memory beyond": [
        command(0x84, struct.pack(">II", address, count))
        for address in (0x10000 + 10**6, 0xFFFFFFFF, 0)
        for count in (0, 4, 512, 0xFFFF)
    ],
    "lengths that lie": [
        command(code, b"\0" * 8, length) for code in (0x80, 0x82, 0x84, 0x86) for length in (0, 3, 0xFFFF)
    ],
    "short": [command(code, b"\0" * n) for code in (0x80, 0x82, 0x84, 0x86) for n in range(8)],
    "written registers": writes(0x82, *WRITTEN),
    "written memory": [*writes(0x86, *WRITTEN), command(0x86, struct.pack(">I", 0xFFF0) + b"\xff" * 500)],
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_camera_serves_on_after_hostile_requests(process, client, kind):
    for address, value in ((0xA00, 2), (0xD18, 0x7F000001), (0xD00, 9), (0x124, 1)):
        assert gvcp.request(client, 0x82, struct.pack(">II", address, value), 1, 60).status == 0
    for datagram in HOSTILE[kind]:
        client.send(datagram)
    # The same socket again: the requests are answered in their order.
    assert gvcp.request(client, 0x82, struct.pack(">II", 0x124, 0), 2, 60).status == 0
    assert gvcp.request(client, 0x82, struct.pack(">II", 0xA00, 0), 3, 60).status == 0
    assert process.poll() is None
    with AravisCamera("127.0.0.1") as camera:
        assert (camera.settings.width, camera.settings.height) == (64, 48)
        assert [frame.dn.shape for frame in camera.grab(3)] == [(48, 64)] * 3


def test_a_camera_serves_on_after_random_datagrams(process, client):
    rng = np.random.default_rng(36)
    codes = (0x00, 0x02, 0x04, 0x40, 0x80, 0x82, 0x84, 0x86, 0xC0, 0x100)
    for length in [*range(64), *rng.integers(64, 9000, 200)]:
        client.send(rng.bytes(length))
        for code in codes:
            client.send(command(code, rng.bytes(length)))
            client.send(command(code, rng.bytes(length), int(rng.integers(0, 2**16))))
    with AravisCamera("127.0.0.1") as camera:
        assert len(list(camera.grab(3))) == 3
    assert process.poll() is None


def test_every_feature_of_the_description_can_be_written(camera):
    for feature in camera.describe_features():
        if (
            feature.limits is not None
            and feature.name not in ("Width", "Height", "OffsetX", "OffsetY")
            and feature.writable
        ):
            for value in feature.limits:
                camera.set_feature(feature.name, type(feature.value)(value))
