import socket
import struct
import threading
import time
from contextlib import contextmanager

import pytest

from labcdp.core.errors import InputError
from labcdp.drivers.aravis import gvcp
from labcdp.drivers.aravis.gvcp import set_address
from labcdp.drivers.aravis.transport import ask_neighbours
from labcdp.drivers.camera import CameraNotFoundError


@contextmanager
def answering(reply, address="127.0.0.1"):
    """Let a function answer what is sent to the port of cameras: it takes a request and returns what to send back."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo\0")
        server.bind((address, gvcp.GVCP_PORT))

        def serve():
            while (received := server.recvfrom(600))[0]:
                server.sendto(reply(received[0]), received[1])

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield
        finally:
            server.sendto(b"", ("127.0.0.1", gvcp.GVCP_PORT))
            thread.join()


def test_a_request_is_as_the_standard_has_it_and_repeated_if_it_is_lost():
    """READREG_CMD and READREG_ACK of GigE Vision 2.0, 16.5."""
    seen, answer = [], bytes.fromhex("0000 0081 0004 0003 0000002a")
    with answering(lambda request: seen.append(request) or answer * (len(seen) > 2)):
        assert gvcp.read_register("127.0.0.1", 0x0A00, timeout_s=1.0).register == 42
    assert seen == [bytes.fromhex(f"42 01 0080 0004 000{n} 00000a00") for n in (1, 2, 3)]


@pytest.mark.parametrize("message", ["", "0000", "0000 0081 0004 00ff 00000002", "0000 0003 0004 0001 00000002"])
def test_what_does_not_answer_the_request_is_ignored(message):
    with answering(lambda request: bytes.fromhex(message)):
        assert gvcp.read_register("127.0.0.1", 0x0A00, timeout_s=0.05, tries=2) is None


@pytest.mark.parametrize(
    ("answer", "late_s", "controlled"),
    # In use by a program, free, and in exclusive use, which lets no other program read registers.
    [
        ("0000 0081 0004 0001 00000002", 0.3, True),
        ("0000 0081 0004 0001 00000000", 0.0, False),
        ("8006 0081 0000 0001", 0.0, True),
    ],
)
def test_a_camera_in_use_is_noticed_also_if_it_answers_late(answer, late_s, controlled):
    with answering(lambda request: time.sleep(late_s) or bytes.fromhex(answer)):
        assert ask_neighbours(["127.0.0.1", "127.0.0.2"]) == {"127.0.0.1": controlled}


@pytest.fixture
def camera_elsewhere():
    """A camera of another network, which answers requests to everybody; gives what it was asked."""
    asked, identity = [], bytearray(0xF8)
    identity[0x0A:0x10] = bytes.fromhex("000f310221f0")
    identity[0x24:0x28] = socket.inet_aton("10.9.8.7")
    identity[0xD8:0xDC] = b"50-1"

    def reply(request):
        asked.append(request)
        body = identity if request[2:4] == b"\0\2" else b""
        return struct.pack(">HHHH", 0, int.from_bytes(request[2:4], "big") + 1, len(body), 1) + body

    with answering(reply, ""):
        yield asked


def test_a_camera_of_another_network_is_given_an_address(camera_elsewhere):
    """FORCEIP_CMD of GigE Vision 2.0, 16.3: hardware address, address, mask and gateway at bytes 2, 20, 36 and 52."""
    assert str(set_address("50-1", "127.9.9.9")) == "127.9.9.9/8"
    header, body = camera_elsewhere[-1][:8], camera_elsewhere[-1][8:]
    assert header == bytes.fromhex("42 11 0004 0038 0001")
    assert (len(body), body[2:8].hex(), body[52:]) == (56, "000f310221f0", bytes(4))
    assert (socket.inet_ntoa(body[20:24]), socket.inet_ntoa(body[36:40])) == ("127.9.9.9", "255.0.0.0")


@pytest.mark.parametrize(
    ("serial", "address", "message"),
    [
        ("50-2", "127.9.9.9", "no camera 50-2 answers"),
        ("50-1", "192.0.2.1", "is in no network of this computer"),
        ("50-1", "127.0.0.1", "is an address of this computer"),
        ("50-1", "x", "the address is 'x'"),
    ],
)
def test_an_address_that_no_camera_can_take_is_refused(camera_elsewhere, serial, address, message):
    with pytest.raises((InputError, CameraNotFoundError), match=message):
        set_address(serial, address)
    assert all(request[2:4] == b"\0\2" for request in camera_elsewhere)
