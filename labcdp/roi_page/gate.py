"""Who may talk to the page: only the person who was told its address."""

from __future__ import annotations

from dataclasses import dataclass
from hmac import compare_digest
from http.cookies import CookieError, SimpleCookie
from secrets import token_urlsafe
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from tornado.httputil import HTTPServerRequest
    from tornado.web import Application

#: What the token is called in the address, and what the cookie's name begins with.
TOKEN = "token"  # noqa: S105 - its name
#: Names by which a computer calls itself.
_LOOPBACK = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class Gate:
    """The rule who gets in.

    Parameters
    ----------
    token : str
        What a visitor must know.
    loopback_only : bool
        Whether the page is served on loopback, and a request for any other host is therefore a trick.
    """

    token: str
    loopback_only: bool

    @classmethod
    def new(cls, loopback_only: bool) -> Gate:
        """Gate with a new token of 192 random bits."""
        return cls(token_urlsafe(24), loopback_only)

    @property
    def cookie(self) -> str:
        """Name of the cookie: pages on other ports of the same host have theirs."""
        return f"labcdp-rois-{self.token[:8]}"

    def refusal(self, host: str, origin: str | None, cookies: str, query: str) -> str:
        """Return why a request is refused, empty if it is not.

        Parameters
        ----------
        host : str
            Header ``Host``.
        origin : str or None
            Header ``Origin``; browsers send it with every websocket, with their page's address.
        cookies : str
            Header ``Cookie``.
        query : str
            What follows the question mark of the address.
        """
        if self.loopback_only and _name(host) not in _LOOPBACK:
            return "this page is served on loopback only: open the address that labcdp printed"
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return "this page answers no other page"
        if not (self._known(self._of_query(query)) or self._known(self._of_cookies(cookies))):
            return "the address lacks its token: open the whole address that labcdp printed"
        return ""

    def has_token(self, query: str) -> bool:
        """Whether an address has the right token in it."""
        return self._known(self._of_query(query))

    def _known(self, text: str) -> bool:
        return compare_digest(text.encode(), self.token.encode())

    def _of_query(self, query: str) -> str:
        return parse_qs(query).get(TOKEN, [""])[0]

    def _of_cookies(self, header: str) -> str:
        try:
            found = SimpleCookie(header).get(self.cookie)
        except CookieError:
            return ""
        return found.value if found is not None else ""


def guard(application: Application, gate: Gate) -> None:
    """Put a gate before everything an application serves: pages, files and websockets alike."""
    from tornado.routing import Matcher, Rule
    from tornado.web import RequestHandler

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
        """Keep the token in a cookie, and take it out of the address and the history."""

        def get(self) -> None:
            self.set_cookie(gate.cookie, gate.token, httponly=True, samesite="Lax", path="/")
            self.set_header("Cache-Control", "no-store")
            self.redirect("/", status=303)

    application.add_handlers(r".*", [Rule(NotAllowed(), Refused), Rule(WithToken(), Enter)])


def _name(host: str) -> str:
    """Host without its port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
