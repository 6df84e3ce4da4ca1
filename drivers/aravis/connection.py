"""Connection to a camera from open to close, across reconnects."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from ipaddress import AddressValueError, IPv4Address
from typing import Any, TypeVar

from ...core.disk.quoting import printable
from ..camera import CameraError, CameraLostError, Gap
from . import gvcp
from .library import CameraInfo, choose, discover
from .link import Link, connect
from .recovery import Changes, bring_back
from .snapshot import Snapshot, take_snapshot

_log = logging.getLogger(__name__)

_T = TypeVar("_T")


class Connection:
    """A camera that is reconnected when lost.

    Parameters
    ----------
    selector : str or None
        Serial number, address or model; None for the only camera.
    patience_s : float
        How long to wait for it to come back.
    """

    def __init__(self, selector: str | None, patience_s: float) -> None:
        self._selector = selector
        self._patience_s = patience_s
        self._link: Link | None = None
        self._closed = threading.Event()
        self.changes = Changes()
        self._snapshot: Snapshot = {}
        self.gaps: tuple[Gap, ...] = ()

    @property
    def usable(self) -> bool:
        """Whether it is open, and not known to be lost."""
        return self._link is not None and not self._link.lost

    @property
    def link(self) -> Link:
        """Current link; raises CameraError if not open."""
        if self._link is None:
            raise CameraError("the camera is not open: use it as a context manager or call open() first")
        return self._link

    def open(self) -> None:
        """Find the camera and take control of it."""
        link = connect(_found(self._selector))
        self._closed.clear()
        self.changes, self.gaps = Changes(), ()
        self._link = link
        try:
            self.remember_settings()
        except BaseException:
            self.close()
            raise
        _log.info("opened %s at %s", link.identity, link.info.address)

    def close(self) -> None:
        """Release the camera and cancel a wait for it; may be called twice."""
        self._closed.set()
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def remember_settings(self) -> None:
        """Read all settings, for restoring them if the camera is lost; call it after a change."""
        if self._patience_s > 0:
            self._snapshot = self.retry_after_reconnect(take_snapshot)

    def ask(self, what: str, question: Callable[[Any], _T]) -> _T:
        """Query Aravis' camera; `what` names the operation in error messages."""

        def ask(link: Link) -> _T:
            with link.using(what) as camera:
                return question(camera)

        return self.retry_after_reconnect(ask)

    def retry_after_reconnect(self, action: Callable[[Link], _T]) -> _T:
        """Run an operation on the camera; repeat it after a reconnect."""
        while True:
            try:
                return action(self.link)
            except CameraLostError as error:
                loss = error
            try:
                self.recover(loss)
            finally:
                del loss  # the traceback refers to this frame and those of the lost camera

    def recover(self, loss: CameraLostError) -> None:
        """Wait up to `patience_s` for a lost camera; then raises the loss."""
        lost = self.link
        if self._patience_s == 0:
            raise loss
        link, gap = bring_back(loss, lost, self.changes, self._snapshot, self._patience_s, self._closed)
        if self._closed.is_set():
            link.close()
            raise CameraError(f"{link.identity} was closed while it was waited for: open it again")
        self._link = link
        self.gaps = (*self.gaps, gap)


def _found(selector: str | None) -> CameraInfo:
    """Find the camera: by address within milliseconds, else by Aravis' search of about a second."""
    try:
        address = str(IPv4Address(selector or ""))
    except AddressValueError:
        return choose(discover(), selector)
    seen = gvcp.announce(address)
    if seen is None:
        return choose(discover(), selector)
    return CameraInfo(printable(seen.vendor), printable(seen.model), printable(seen.serial), address, "GigEVision")
