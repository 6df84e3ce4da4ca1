"""Packets of a stream made by hand: what has no place in a frame ends no process, and leaves no wrong pixel."""

import socket
import struct
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from labcdp.drivers.aravis import gvcp
from labcdp.drivers.aravis.stream_filter import PacketPlan
from labcdp.drivers.camera import CameraSettingError
from labcdp.drivers.camera_settings import Trigger
from tests.conftest import wait_until
from tests.drivers.conftest import opened

LEADER, TRAILER, PAYLOAD = 1, 2, 3
SIZE, BLOCK = 64 * 48, 576 - 36
PIXELS = np.random.default_rng(36).integers(0, 256, SIZE, dtype=np.uint8).tobytes()
N_BLOCKS = -(-SIZE // BLOCK)


def packet(frame_id, kind, packet_id, data=b"", status=0):
    return struct.pack(">HHI", status, frame_id, kind << 24 | packet_id) + data


def long_packet(frame_id, kind, packet_id, data=b""):
    return struct.pack(">HHIQI", 0, 0, 0x80 << 24 | kind << 24, frame_id, packet_id) + data


def leader(form=0x01080001):
    return struct.pack(">HHQIIIIII", 0, 1, 0, form, 64, 48, 0, 0, 0)


def frame(frame_id, pixels=PIXELS):
    """The packets of a good frame, by their number."""
    blocks = [pixels[start : start + BLOCK] for start in range(0, SIZE, BLOCK)]
    payload = [packet(frame_id, PAYLOAD, n, block) for n, block in enumerate(blocks, 1)]
    return [packet(frame_id, LEADER, 0, leader()), *payload, packet(frame_id, TRAILER, N_BLOCKS + 1, bytes(8))]


def changed(frame_id, **replaced):
    packets = frame(frame_id)
    for number, data in replaced.items():
        n = int(number[1:])
        packets[n] = packet(frame_id, PAYLOAD, n, data)
    return packets


FOREIGN = b"\xa5" * 4 * BLOCK
CORRUPT = {
    "a short and a long one": lambda i: changed(i, p1=PIXELS[: BLOCK - 9], p2=PIXELS[BLOCK : 2 * BLOCK] + FOREIGN[:9]),
    "a long and a short one": lambda i: changed(i, p3=FOREIGN[: BLOCK + 99], p4=FOREIGN[: BLOCK - 99]),
    "a short last one": lambda i: changed(i, p1=PIXELS[:BLOCK] + FOREIGN[:100], p6=PIXELS[5 * BLOCK : -100]),
    "an empty one": lambda i: changed(i, p2=b"", p3=FOREIGN[: 2 * BLOCK]),
    "payload as leader": lambda i: [packet(i, PAYLOAD, 0, FOREIGN[:BLOCK]), *frame(i)[1:]],
    "leader in the middle": lambda i: [*frame(i)[:3], packet(i, LEADER, 3, leader()), *frame(i)[4:]],
    "trailer in the middle": lambda i: [*frame(i)[:3], packet(i, TRAILER, 3, bytes(8))],
    "number beyond": lambda i: [*frame(i)[:3], packet(i, PAYLOAD, 99, FOREIGN[:BLOCK]), *frame(i)[4:]],
}

GIANT = [2**32 - 2, *(2**power - 1 for power in (7, 16, 24, 28, 31, 32))]
KINDS = (0, 1, 2, 3, 4, 5, 7, 8, 0x7F)
HOSTILE = {
    "long ids": [long_packet(2**40, kind, n, bytes(100)) for kind in KINDS for n in GIANT],
    "short ids": [packet(9, kind, n % 2**24, bytes(112)) for kind in KINDS for n in GIANT],
    "multipart": [packet(9, LEADER, 0, struct.pack(">HHQ", 0xFF, 10, 0) + b"\xff" * 400)],
    "short": [long_packet(7, kind, 1)[:n] for kind in KINDS for n in range(21)],
}


@pytest.fixture(params=["packet socket", "UDP socket"])
def sending(aravis, request):
    """Send packets to a camera's stream, and collect the frames and those that were refused."""
    with opened() as camera, ThreadPoolExecutor(1) as executor, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        link = camera._connection.link
        if request.param == "UDP socket":
            link.camera.gv_set_stream_options(aravis.GvStreamOption.PACKET_SOCKET_DISABLED)
        camera.configure(pixel_format="Mono8", trigger=Trigger("Line1"))
        camera.set_feature("GevSCPSPacketSize", 576)
        out.bind(("127.0.0.1", 0))

        def send(packets, n_frames, source=out):
            refused = []
            frames = executor.submit(lambda: list(camera.grab(n_frames, 10, refused.append)))
            wait_until(lambda: link.stream_port or frames.done(), "the stream")
            port = link.stream_port
            answer = gvcp.read_register("127.0.0.1", gvcp.STREAM_CHANNEL_PORT)
            assert answer.register & 0xFFFF == port
            for each in packets:
                source.sendto(each, ("127.0.0.1", port))
            return [bytes(each.dn.tobytes()) for each in frames.result(120)], [error.frame_id for error in refused]

        yield send


@pytest.mark.parametrize("kind", CORRUPT)
def test_no_frame_holds_pixels_of_another_place(sending, kind):
    packets = [each for i in (1, 2, 3) for each in [*CORRUPT[kind](2 * i - 1), *frame(2 * i)]]
    frames, refused = sending(packets, 3)
    assert frames == [PIXELS] * 3
    assert len(refused) == 3


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_stream_survives_packets_that_have_no_place(sending, kind):
    frames, refused = sending([*HOSTILE[kind], *frame(1), *HOSTILE[kind], *frame(2)], 2)
    assert frames == [PIXELS] * 2
    assert not refused


def test_a_stream_survives_random_packets(sending):
    rng = np.random.default_rng(36)
    noise = [rng.bytes(n) for n in rng.integers(0, 1500, 2000)]
    noise += [
        packet(1, int(rng.integers(0, 128)), int(n), rng.bytes(int(n) % 700)) for n in rng.integers(9, 2**24, 500)
    ]
    assert sending([*noise, *frame(1)], 1)[0] == [PIXELS]


def test_packets_of_other_computers_are_dropped(sending):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.9", 0))
        hostile = [(other, each) for each in frame(1, FOREIGN[:SIZE])]

        class Both:
            def sendto(self, each, to):
                (other if (other, each) in hostile else own).sendto(each, to)

        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
            own.bind(("127.0.0.1", 0))
            packets = [*(each for _, each in hostile), *frame(2)]
            assert sending(packets, 1, Both()) == ([PIXELS], [])


@pytest.mark.parametrize("packet_bytes", [0, 28, 36, 48])
def test_packets_without_data_are_refused(packet_bytes):
    with pytest.raises(CameraSettingError, match=f"packets have {packet_bytes} bytes"):
        PacketPlan(packet_bytes, 3072, 3072)
