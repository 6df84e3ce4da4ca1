"""The connection to one camera, from open to close, through its losses."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from ipaddress import AddressValueError, IPv4Address
from typing import Any, TypeVar

from . import gvcp
from .aravis_library import CameraInfo, choose, discover
from .aravis_link import Link, connect
from .aravis_recovery import Changes, bring_back
from .camera import CameraError, CameraLostError, Gap

_log = logging.getLogger(__name__)

_T = TypeVar("_T")


class Connection:
    """A camera that is looked for again when it is lost.

    Parameters
    ----------
    selector : str or None
        Serial number, address or model; None takes the only camera.
    patience_s : float
        How long to wait for it to come back.
    """

    def __init__(self, selector: str | None, patience_s: float) -> None:
        self._selector = selector
        self._patience_s = patience_s
        self._link: Link | None = None
        self._closed = threading.Event()
        self.changes = Changes()
        self.gaps: tuple[Gap, ...] = ()

    @property
    def usable(self) -> bool:
        """Whether it is open, and not known to be lost."""
        return self._link is not None and not self._link.lost

    @property
    def link(self) -> Link:
        """The link of now; raises CameraError if not open."""
        if self._link is None:
            raise CameraError("the camera is not open: use it as a context manager or call open() first")
        return self._link

    def open(self) -> None:
        """Find the camera and take control of it."""
        link = connect(_found(self._selector))
        self._closed.clear()
        self.changes, self.gaps = Changes(), ()
        self._link = link
        _log.info("opened %s at %s", link.identity, link.info.address)

    def close(self) -> None:
        """Let the camera go, and end a wait for it; may be called twice."""
        self._closed.set()
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def ask(self, what: str, question: Callable[[Any], _T]) -> _T:
        """Ask Aravis' camera something; `what` says what could not be done if it goes wrong."""

        def ask(link: Link) -> _T:
            with link.using(what) as camera:
                return question(camera)

        return self.survive(ask)

    def survive(self, action: Callable[[Link], _T]) -> _T:
        """Do something with the camera; where it is lost meanwhile and comes back, do it again."""
        while True:
            try:
                return action(self.link)
            except CameraLostError as error:
                loss = error
            try:
                self.recover(loss)
            finally:
                del loss  # holds this frame, and the frames of the camera that was lost

    def recover(self, loss: CameraLostError) -> None:
        """Wait for a lost camera as long as patience lasts; raises the loss after that."""
        lost = self.link
        if self._patience_s == 0:
            raise loss
        link, gap = bring_back(loss, lost, self.changes, self._patience_s, self._closed)
        if self._closed.is_set():
            link.close()
            raise CameraError(f"{link.identity} was closed while it was waited for: open it again")
        self._link = link
        self.gaps = (*self.gaps, gap)


def _found(selector: str | None) -> CameraInfo:
    """Find the camera: at an address in milliseconds, by anything else in Aravis' search of about a second."""
    try:
        address = str(IPv4Address(selector or ""))
    except AddressValueError:
        return choose(discover(), selector)
    seen = gvcp.announce(address)
    if seen is None:
        return choose(discover(), selector)
    return CameraInfo(seen.vendor, seen.model, seen.serial, address, "GigEVision")
