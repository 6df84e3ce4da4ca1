import socket
import threading

import pytest

from labcdp.drivers.aravis import gvcp


@pytest.fixture
def answering():
    """Let a function answer what is sent to 127.0.0.1; it takes a request and returns what to send back."""
    opened = []

    def start(reply):
        server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        server.bind(("127.0.0.1", gvcp.GVCP_PORT))
        opened.append(server)

        def serve():
            while True:
                request, client = server.recvfrom(600)
                if not request:
                    return
                for message in reply(request):
                    server.sendto(message, client)

        thread = threading.Thread(target=serve)
        thread.start()
        opened.append(thread)

    yield start
    for each in opened:
        if isinstance(each, threading.Thread):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as last:
                last.sendto(b"", ("127.0.0.1", gvcp.GVCP_PORT))
            each.join()
    for each in opened:
        if isinstance(each, socket.socket):
            each.close()


def test_a_request_is_as_the_standard_has_it(answering):
    seen = []
    answering(lambda request: seen.append(request) or [bytes.fromhex("0000 0081 0004 0001 0000002a")])
    answer = gvcp.read_register("127.0.0.1", 0x0A00)
    assert seen == [bytes.fromhex("42 01 0080 0004 0001 00000a00")]
    assert answer.register == 42


def test_a_lost_request_is_repeated(answering):
    seen = []

    def reply(request):
        seen.append(request)
        return [] if len(seen) < 3 else [b"\0\0\0\x81\0\x04" + request[6:8] + b"\0\0\0\x02"]

    answering(reply)
    assert gvcp.read_register("127.0.0.1", 0x0A00, timeout_s=0.5).register == 2
    assert [request[7] for request in seen] == [1, 2, 3]


@pytest.mark.parametrize("message", ["", "0000", "0000 0081 0004 00ff 00000002", "0000 0003 0004 0001 00000002"])
def test_what_does_not_answer_the_request_is_ignored(answering, message):
    answering(lambda request: [bytes.fromhex(message)])
    assert gvcp.read_register("127.0.0.1", 0x0A00, timeout_s=0.05) is None
