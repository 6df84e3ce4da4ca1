"""The command, and who its page lets in."""

import contextlib
import http.client
import os
import re
import signal
import socket
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from bokeh.client import pull_session
from bokeh.models import ImportedStyleSheet

from labcdp.chain import Checkerboard
from labcdp.cli.app import app
from labcdp.core.errors import InputError
from labcdp.regions import RectangleShape, load_regions, rois_of, save_regions
from labcdp.web.gate import Gate

from ..conftest import valid, wait_until
from .conftest import HEIGHT, WIDTH


def run(*arguments):
    """Run the command in this process."""
    app(["rois", *map(str, arguments)], standalone_mode=False)


def refused(*arguments):
    with pytest.raises(InputError) as error:
        run(*arguments)
    return str(error.value)


def get(port, path, **headers):
    """Status, headers and text of an answer."""
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=120)) as connection:
        connection.request("GET", path, headers=headers)
        with closing(connection.getresponse()) as response:
            # A websocket that is let in never ends.
            text = "" if response.status == 101 else response.read().decode("utf-8", "replace")
            return response.status, response.headers, text


def opening(token):
    """Headers of the opening handshake of a websocket (RFC 6455)."""
    return {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Protocol": f"bokeh, {token}",
    }


def websocket_status(port, token, **headers):
    """Status that the opening of a websocket gets: 101 if it is let in."""
    return get(port, "/ws", **{**opening(token), **headers})[0]


@pytest.fixture(scope="module")
def served(picture, tmp_path_factory, serve):
    output = tmp_path_factory.mktemp("served") / "regions.json"
    save_regions(output, [RectangleShape("begin", 10, 10, 30, 30)], (WIDTH, HEIGHT))
    return serve("rois", picture, "--output", output)


def test_nothing_answers_without_the_token(served):
    for path in ("/", "/ws", "/autoload.js", "/metadata", "/static/js/bokeh.min.js", "/?token=wrong", "/x"):
        status, _, text = get(served.port, path)
        assert status == 403
        assert "the address lacks its token" in text


def test_a_long_body_is_refused_before_it_is_read(served):
    with socket.create_connection(("127.0.0.1", served.port), timeout=60) as line:
        line.sendall(b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 10000\r\n\r\n")
        answer = line.recv(100)
    assert answer == b"" or b" 4" in answer.split(b"\r\n")[0]


@pytest.mark.long
def test_tabs_beyond_a_limit_are_refused_until_others_are_closed(serve, picture, tmp_path):
    served = serve("rois", picture, "--output", tmp_path / "regions.json")
    cookie = get(served.port, f"/?{urlsplit(served.url).query}")[1]["Set-Cookie"].split("; ")[0]

    def status():
        return get(served.port, "/", Cookie=cookie)[0]

    assert {get(served.port, "/")[0] for _ in range(30)} == {403}
    with contextlib.ExitStack() as tabs:
        for _ in range(20):
            text = get(served.port, "/", Cookie=cookie)[2]
            token = re.search(r'"token":"([^"]+)"', text)[1]
            headers = {**opening(token), "Cookie": cookie, "Origin": f"http://127.0.0.1:{served.port}"}
            connection = tabs.enter_context(closing(http.client.HTTPConnection("127.0.0.1", served.port, timeout=120)))
            connection.request("GET", "/ws", headers=headers)
            assert tabs.enter_context(closing(connection.getresponse())).status == 101
        assert status() == 503
        assert "too many viewers" in get(served.port, "/", Cookie=cookie)[2]
    wait_until(lambda: status() == 200, "there is room again")


def test_page_and_websocket_open_with_the_token_from_their_own_origin_only(served):
    parts = urlsplit(served.url)
    status, headers, _ = get(served.port, f"/?{parts.query}")
    assert (status, headers["Location"]) == (303, "/")
    cookie, *rules = headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Lax"} <= set(rules)
    status, headers, text = get(served.port, "/", Cookie=cookie)
    assert (status, headers["X-Frame-Options"]) == (200, "DENY")
    session = re.search(r'"token":"([^"]+)"', text)
    assert session is not None
    here = f"http://127.0.0.1:{served.port}"
    for headers, status in (
        ({"Cookie": cookie, "Origin": here}, 101),
        ({"Origin": here}, 403),
        ({"Cookie": cookie, "Origin": "http://evil.example"}, 403),
        ({"Cookie": cookie, "Origin": "http://127.0.0.1:1"}, 403),
        ({"Cookie": cookie, "Host": "evil.example", "Origin": "http://evil.example"}, 403),
        ({"Cookie": "a=b; =;;,", "Origin": here}, 403),
        ({"Cookie": cookie.partition("=")[0] + "=", "Origin": here}, 403),
        ({"Cookie": cookie, "Origin": "null"}, 403),
        # Through a tunnel that ends at another port, the page is the origin of its own websocket.
        ({"Cookie": cookie, "Host": "localhost:8080", "Origin": "http://localhost:8080"}, 101),
    ):
        assert websocket_status(served.port, session[1], **headers) == status, headers


def test_a_tab_that_is_made_anew_for_a_slow_browser_loads_nothing_from_elsewhere(served):
    parts = urlsplit(served.url)
    arguments = {"token": parts.query.partition("=")[2]}

    def style_sheets():
        import labcdp.web.regions.page  # noqa: F401, its models are those of Panel and its own

        # Without the page that comes before: its session was given up meanwhile.
        with closing(pull_session(url=f"http://{parts.netloc}/", arguments=arguments)) as session:
            return {str(one.url) for one in session.document.models if isinstance(one, ImportedStyleSheet)}

    # In a thread of its own, as a browser of other tests may have a loop in this one.
    with ThreadPoolExecutor(1) as pool:
        urls = pool.submit(style_sheets).result()
    assert urls
    assert not [url for url in urls if "//" in url]


def test_a_second_process_for_one_port_or_file_is_refused_until_the_first_has_ended(serve, picture, tmp_path):
    output = tmp_path / "r.json"
    served = serve("rois", picture, "-o", output)
    line = refused(picture, "-o", tmp_path / "other.json", "--port", str(served.port))
    assert f"port {served.port} cannot be used (Address already in use)" in line
    board(tmp_path / "board.png")
    for arguments in ((picture,), (tmp_path / "board.png", "--detect", "checkerboard", "--no-page")):
        assert (
            f"{output} is in use by another labcdp (process {served.process.pid}, http://127.0.0.1:{served.port})"
        ) in refused(*arguments, "-o", output)
    assert served.url.partition("token=")[2] not in (tmp_path / ".r.json.lock").read_text()
    served.stop(signal.SIGKILL)
    # The lock ends with the process, however that ends.
    serve("rois", picture, "-o", output).stop()
    assert [path.name for path in tmp_path.iterdir()] == ["board.png"]


def board(path):
    """A board of 6 x 8 squares."""
    assert cv2.imwrite(str(path), Checkerboard(400, 300, 40.0, 4.0, 50).luminance_map().astype(np.uint8))
    return path


def test_what_is_found_is_written_without_the_page(tmp_path, capsys):
    file, command = tmp_path / "board.rois.json", (board(tmp_path / "board.png"), "--detect", "checkerboard")

    def new():
        run(*command, "--no-page", "--json")
        values = valid(capsys.readouterr().out)
        return [bool(row["new"]) for row in values["tables"]["regions"]["rows"]]

    assert new() == [True] * 48
    before = file.read_bytes()
    assert new() == [False] * 48
    assert file.read_bytes() == before
    save_regions(file, load_regions(file)[:-3], force=True)
    assert sum(new()) == 3
    assert len({roi.name for roi in rois_of(load_regions(file))}) == 48


def test_other_names_of_the_host_are_refused_unless_another_address_was_asked_for():
    gate, host = Gate("secret-token-0123", loopback_only=True), "bench.lab:5006"
    for own in ("127.0.0.1", "127.0.0.2", "localhost", "[::1]"):
        assert gate.refusal(f"{own}:5006", f"http://{own}:5006", "", f"token={gate.token}") == ""
    for other in ("127.0.0.2.example.org", "192.0.2.7", "[::2]", ""):
        assert "on loopback only" in gate.refusal(f"{other}:5006", None, "", f"token={gate.token}")
    cookie = f"{gate.cookie}={gate.token}"
    assert gate.refusal("[::1]:5006", None, cookie, "") == ""
    for name in (host, "[bad"):
        assert "loopback only" in gate.refusal(name, None, cookie, "")
    assert Gate(gate.token, loopback_only=False).refusal(host, f"http://{host}", cookie, "") == ""
    assert "lacks its token" in gate.refusal("127.0.0.1:5006", None, "", "token=%C3%A4%00")


@pytest.mark.parametrize(
    "command", [("rois",), ("view",), ("bench", "--simulated", "--roi", "rois.json")], ids=lambda command: command[0]
)
def test_the_browser_is_opened_without_the_token_on_its_command_line(command, serve, picture, tmp_path):
    """Every user of a computer can read the command lines of all programs; the file that leads to the page, none."""
    browser = tmp_path / "xdg-open"
    browser.write_text(f"#!/bin/sh\nstat -c '%a %n' \"$1\" \"${{1%/*}}\" >{tmp_path}/new; cat \"$1\" >>{tmp_path}/new\n"
                       f"mv {tmp_path}/new {tmp_path}/opened\n")  # fmt: skip
    browser.chmod(0o755)
    files = () if command[0] == "bench" else (picture,)
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    served = serve(*command, *files, folder=tmp_path, environment=environment, opened=True)
    wait_until((tmp_path / "opened").exists, "the browser is opened")
    file, folder, *page = (tmp_path / "opened").read_text().splitlines()
    assert (file.split()[0], folder.split()[0]) == ("600", "700")
    assert "token" not in file
    assert f'url={served.url}"' in "".join(page)
    served.stop()
    assert not Path(folder.split()[1]).exists()
