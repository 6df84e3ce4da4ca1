"""Access control of the page: only clients with its token."""

from __future__ import annotations

from dataclasses import dataclass
from hmac import compare_digest
from http.cookies import CookieError, SimpleCookie
from ipaddress import ip_address
from secrets import token_urlsafe
from time import monotonic
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from bokeh.server.tornado import BokehTornado
    from tornado.httputil import HTTPHeaders, HTTPServerRequest
    from tornado.web import Application

#: Name of the token in the address, and prefix of the cookie's name.
TOKEN = "token"  # noqa: S105 - its name
#: What the page may load, and who may show it. Bokeh makes functions of text, and modules of blobs.
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; connect-src 'self' ws: wss:; "
    "frame-ancestors 'none'; base-uri 'self'; object-src 'none'"
)


#: Paths that open a tab, and the time a browser takes to connect afterwards.
_OPENING, _CONNECTING_MS = ("/", "/autoload.js"), 10_000


@dataclass(frozen=True)
class Gate:
    """Access rule of a page.

    Parameters
    ----------
    token : str
        Token a client must present.
    loopback_only : bool
        Whether the page is served on loopback; requests for any other host are then refused (DNS rebinding).
    """

    token: str
    loopback_only: bool

    @classmethod
    def new(cls, loopback_only: bool) -> Gate:
        """Return a gate with a new token of 192 random bits."""
        return cls(token_urlsafe(24), loopback_only)

    @property
    def cookie(self) -> str:
        """Name of the cookie, by port: cookies are common to all ports of a host."""
        return f"labcdp-rois-{self.token[:8]}"

    def refusal(self, host: str, origin: str | None, cookies: str, query: str) -> str:
        """Return why a request is refused; empty if it is accepted.

        Parameters
        ----------
        host : str
            Header ``Host``.
        origin : str or None
            Header ``Origin``, the address of the page; browsers send it with every websocket request.
        cookies : str
            Header ``Cookie``.
        query : str
            Query string of the address.
        """
        if self.loopback_only and not is_loopback(_name(host)):
            return "this page is served on loopback only: open the address labcdp printed"
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return "requests from other pages are refused"
        if not (self._known(self._token_in_query(query)) or self._known(self._token_in_cookies(cookies))):
            return "the address lacks its token: open the complete address labcdp printed"
        return ""

    def has_token(self, query: str) -> bool:
        """Whether a query string contains the token."""
        return self._known(self._token_in_query(query))

    def _known(self, text: str) -> bool:
        return compare_digest(text.encode(), self.token.encode())

    def _token_in_query(self, query: str) -> str:
        return parse_qs(query).get(TOKEN, [""])[0]

    def _token_in_cookies(self, header: str) -> str:
        try:
            cookie = SimpleCookie(header).get(self.cookie)
        except CookieError:
            return ""
        return cookie.value if cookie is not None else ""


def guard(application: Application, gate: Gate) -> None:
    """Apply a gate to all handlers of an application: pages, files and websockets."""
    from tornado.routing import Matcher, Rule
    from tornado.web import OutputTransform, RequestHandler

    def refusal(request: HTTPServerRequest) -> str:
        headers = request.headers
        return gate.refusal(request.host, headers.get("Origin"), headers.get("Cookie", ""), request.query)

    class NotAllowed(Matcher):
        def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
            return {} if refusal(request) else None

    class WithToken(Matcher):
        def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
            return {} if request.path == "/" and gate.has_token(request.query) else None

    class Refused(RequestHandler):
        def prepare(self) -> None:
            self.set_status(403)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.finish(f"labcdp: {refusal(self.request)}\n")

    class Enter(RequestHandler):
        """Store the token in a cookie and remove it from the address and the history."""

        def get(self) -> None:
            self.set_cookie(gate.cookie, gate.token, httponly=True, samesite="Lax", path="/")
            self.set_header("Cache-Control", "no-store")
            self.redirect("/", status=303)

    class Headers(OutputTransform):
        """Let no other page show this one in a frame, load nothing from elsewhere, and guess no type of a file."""

        def transform_first_chunk(
            self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
        ) -> tuple[int, HTTPHeaders, bytes]:
            headers["Content-Security-Policy"] = _POLICY
            headers["X-Frame-Options"] = "DENY"
            headers["X-Content-Type-Options"] = "nosniff"
            headers["Referrer-Policy"] = "no-referrer"
            return super().transform_first_chunk(status_code, headers, chunk, finishing)

    application.transforms.append(Headers)
    application.add_handlers(r".*", [Rule(NotAllowed(), Refused), Rule(WithToken(), Enter)])


def is_loopback(host: str) -> bool:
    """Whether an address is reachable only from this computer."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def limit_viewers(application: BokehTornado, most: int) -> None:
    """Answer a page beyond a number of open tabs with status 503; closed tabs make room.

    Parameters
    ----------
    application : BokehTornado
        The server's application.
    most : int
        Number of tabs.
    """
    from tornado.routing import Matcher, Rule
    from tornado.web import RequestHandler

    coming: list[float] = []
    known: set[str] = set()

    class Full(Matcher):
        def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
            if request.path not in _OPENING:
                return None
            sessions, now_s = application.get_sessions("/"), monotonic()
            # Sessions are made after the request was let in.
            ids = {session.id for session in sessions}
            del coming[: len(ids - known)]
            known.clear()
            known.update(ids)
            coming[:] = [time_s for time_s in coming if 1000 * (now_s - time_s) < _CONNECTING_MS]
            n_open = len(coming)
            for session in sessions:
                if session.connection_count > 0 or session.milliseconds_since_last_unsubscribe < _CONNECTING_MS:
                    n_open += 1
                elif len(sessions) >= most:
                    # Of a closed tab, which can reconnect as long as nobody needs its room.
                    session.request_expiration()
            if n_open >= most or len(sessions) >= 2 * most:
                return {}
            coming.append(now_s)
            return None

    class TooMany(RequestHandler):
        def prepare(self) -> None:
            self.set_status(503)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.set_header("Retry-After", str(_CONNECTING_MS // 1000))
            self.finish(f"labcdp: too many viewers, this page serves {most} tabs: close others, then reload\n")

    application.add_handlers(r".*", [Rule(Full(), TooMany)])


def _name(host: str) -> str:
    """Host without its port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
