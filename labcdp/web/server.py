"""The server of a page: on loopback, protected by a token, until Ctrl-C."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

from ..core.computer import give_back_memory
from ..core.errors import InputError, printable
from .gate import TOKEN, Gate, guard, is_loopback, limit_viewers

_log = logging.getLogger(__name__)

#: Largest message of the page, and body of a request, in bytes: the page sends no bodies.
_MOST_BYTES, _MOST_BODY_BYTES = 4 * 2**20, 1024
#: Most tabs of a page: each holds its own pictures, 25 MB with a camera of 5 megapixels.
_MOST_TABS = 20

#: As wide as the screen of a phone or tablet, which else shows a page of 980 px made small.
_OF_SCREENS = """{% block preamble %}{{ super() }}
<meta name="viewport" content="width=device-width, initial-scale=1">{% endblock %}"""


@dataclass(frozen=True)
class Address:
    """Address of the page.

    Parameters
    ----------
    host : str
        Bound address, as given.
    port : int
        Port.
    token : str
        Token a client must present.
    """

    host: str
    port: int
    token: str

    @property
    def loopback(self) -> bool:
        """Whether it is reachable only from this computer."""
        return is_loopback(self.host)

    @property
    def url(self) -> str:
        """Address to open, with the token."""
        return f"{self.url_without_token}/?{TOKEN}={self.token}"

    @property
    def url_without_token(self) -> str:
        """Address without the token."""
        return f"http://{self._visible}:{self.port}"

    @property
    def tunnel(self) -> str:
        """SSH command that forwards a loopback page to another computer."""
        return f"ssh -N -L {self.port}:{self._visible}:{self.port} {_user()}@{socket.gethostname()}"

    @property
    def _visible(self) -> str:
        if self.host in ("0.0.0.0", "::"):  # noqa: S104 - compared, not bound
            return socket.gethostname()
        return f"[{self.host}]" if ":" in self.host else self.host


@dataclass(frozen=True)
class Site:
    """Content of a server.

    Parameters
    ----------
    title : str
        Title of the page.
    tab : function
        Make a tab from its Bokeh document; returns its layout and the script that starts with it.
    begin : function
        Called when the server runs, in its thread.
    warn : function
        Receives errors of background work.
    lifetime_s : float
        Time within which a disconnected tab can reconnect.
    results : function
        Return the folder that is served under ``/report/``, or None.
    """

    title: str
    tab: Callable[[Any], tuple[Any, Any]]
    begin: Callable[[], None]
    warn: Callable[[Exception], None]
    lifetime_s: float = 600.0
    results: Callable[[], Path | None] = lambda: None


class Server:
    """A page that is served until it is stopped.

    Parameters
    ----------
    host : str
        Address to bind.
    port : int
        Port; 0 for a free one.

    Raises
    ------
    InputError
        If the address cannot be bound.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        self._socket = _bound(host, port)
        bound: int = self._socket.getsockname()[1]
        self._gate = Gate.new(is_loopback(host))
        self.address = Address(host, bound, self._gate.token)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._site: Site | None = None

    def run(self, site: Site, ready: Callable[[Address], None]) -> None:
        """Serve until SIGINT, SIGTERM or SIGHUP; `ready` is called once the page can be opened."""
        for name in ("bokeh", "panel", "tornado", "tornado.application", "param"):
            # They log every request; errors are shown on the page.
            logging.getLogger(name).setLevel(logging.CRITICAL)
        self._site = site
        give_back_memory()
        asyncio.run(self._serve(site, ready))

    async def _serve(self, site: Site, ready: Callable[[Address], None]) -> None:
        from bokeh.server.server import BaseServer
        from bokeh.server.tornado import BokehTornado
        from panel.io.application import build_applications
        from panel.io.server import get_static_routes
        from tornado.httpserver import HTTPServer
        from tornado.ioloop import IOLoop

        self._loop = asyncio.get_running_loop()
        self._loop.set_exception_handler(_without_closed_tabs)
        stopped = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            # nohup ignores SIGHUP.
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
                self._loop.add_signal_handler(number, stopped.set)
        application = BokehTornado(
            build_applications({"/": self._tab}, title=printable(site.title), location=False),
            # The gate checks the origin of every request, also behind a tunnel with another port.
            extra_websocket_origins=["*"],
            extra_patterns=[*get_static_routes({}), results_route(site.results)],
            websocket_max_message_size_bytes=_MOST_BYTES,
            use_index=False,
            unused_session_lifetime_milliseconds=round(1000 * site.lifetime_s),
            check_unused_sessions_milliseconds=min(1_000, round(500 * site.lifetime_s)),
            include_headers=[],
            include_cookies=[],
        )
        guard(application, self._gate)
        # After it: requests without the token take no place.
        limit_viewers(application, _MOST_TABS)
        # Nobody has a token before the request is read: neither long bodies nor idle connections are kept.
        http = HTTPServer(application, max_body_size=_MOST_BODY_BYTES, idle_connection_timeout=60, body_timeout=60)
        http.add_socket(self._socket)
        server = BaseServer(IOLoop.current(), application, http)
        server.start()
        site.begin()
        ready(self.address)
        await stopped.wait()
        server.unlisten()
        server.stop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            self._loop.remove_signal_handler(number)

    def _tab(self) -> Any:
        import panel as pn
        from panel.io.resources import LOCAL_DIST

        assert self._site is not None, "the server runs"
        document = pn.state.curdoc
        # Else style sheets come from the network if the tab is made anew for a browser that was slow to connect.
        document.template_variables["dist_url"] = LOCAL_DIST
        document.template = _OF_SCREENS
        layout, script = self._site.tab(document)
        document.config.notify_connection_status = False  # shown by the page itself
        document.js_on_event("document_ready", script)
        return layout

    def call(self, function: Callable[[], None]) -> None:
        """Call a function in the server's thread; nothing happens once the server has stopped."""
        assert self._loop is not None, "the server runs"
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(function)

    def elsewhere(self, steps: Iterator[Any], then: Callable[[Any], None], done: Callable[[], None]) -> None:
        """Run `steps` in another thread; pass each result to `then` and call `done` in the server's thread."""

        def run() -> None:
            try:
                for step_result in steps:
                    self.call(partial(then, step_result))
            except Exception as error:
                # An internal error must not leave the page waiting for results.
                _log.exception("background work failed")
                if self._site is not None:
                    self.call(partial(self._site.warn, error))
            self.call(done)

        # A daemon thread, so that Ctrl-C does not wait for results.
        Thread(target=run, name="measure", daemon=True).start()


def _without_closed_tabs(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Report errors of the server as usual, except that a tab was closed while something was sent to it."""
    from tornado.iostream import StreamClosedError
    from tornado.websocket import WebSocketClosedError

    if not isinstance(context.get("exception"), WebSocketClosedError | StreamClosedError):
        loop.default_exception_handler(context)


def _bound(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        bound = socket.create_server((host, port), family=family, backlog=128)
    except OSError as error:
        where = f"port {port}" if port else f"address {host}"
        # create_server adds text of its own; negative numbers are errors of the name look-up.
        why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror
        raise InputError(f"{where} cannot be used ({why}): give another, or leave it out for a free one") from error
    bound.setblocking(False)
    return bound


def _user() -> str:
    from getpass import getuser

    try:
        return getuser()
    except (KeyError, OSError):
        return "USER"


def results_route(folder: Callable[[], Path | None]) -> tuple[str, Any]:
    """Return a route that serves the files of a folder, once there is one, under ``/report/``."""
    from tornado.web import HTTPError, StaticFileHandler

    class Results(StaticFileHandler):
        def initialize(self) -> None:  # type: ignore[override]
            super().initialize(os.path.realpath(folder() or os.devnull))

        def prepare(self) -> None:
            if folder() is None:
                raise HTTPError(404)

    return r"/report/(.*)", Results
