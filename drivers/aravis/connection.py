"""Connection to a camera from open to close: reconnects to a lost one and restores its settings."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from ipaddress import AddressValueError, IPv4Address
from typing import Any, TypeVar

from ...core.disk.quoting import printable
from ..camera import CameraError, CameraLostError, CameraSettingError, FeatureValue, Gap
from . import gvcp
from .features import write_feature
from .library import CameraInfo, choose, discover
from .link import Link, connect
from .settings import change_setting
from .snapshot import Snapshot, restore_snapshot, take_snapshot

_log = logging.getLogger(__name__)

_T = TypeVar("_T")


#: Interval of the search for a lost camera.
_PAUSE_S = 0.25

#: Failed attempts at its old address after which all networks are searched, as its address may have changed.
_LOOKS_AT_ADDRESS = 8


class Changes:
    """Log of the settings since a camera was opened, for restoring them in the same order."""

    def __init__(self) -> None:
        self._made: list[tuple[str, str, Any]] = []

    def setting(self, name: str, value: Any) -> None:
        """Record a parameter of `AravisCamera.configure`."""
        self._note("setting", name, value)

    def feature(self, name: str, value: FeatureValue) -> None:
        """Record a GenICam feature."""
        self._note("feature", name, value)

    @property
    def features(self) -> frozenset[str]:
        """Names of the GenICam features that were set."""
        return frozenset(name for kind, name, _ in self._made if kind == "feature")

    def _note(self, kind: str, name: str, value: Any) -> None:
        # Only the last change of each is kept, in order of time; but with a selector one name stands for several
        # features.
        if not any(made.endswith("Selector") for _, made, _ in self._made):
            self._made = [made for made in self._made if made[:2] != (kind, name)]
        self._made = [*self._made, (kind, name, value)]

    def restore(self, link: Link) -> None:
        """Restore all settings."""
        for kind, name, value in self._made:
            with link.using(f"{name} cannot be restored") as camera:
                if kind == "setting":
                    change_setting(camera, name, value)
                else:
                    write_feature(camera, name, value)


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


def bring_back(
    loss: CameraLostError,
    lost: Link,
    changes: Changes,
    snapshot: Snapshot,
    patience_s: float,
    cancelled: threading.Event,
) -> tuple[Link, Gap]:
    """Wait for a lost camera, reconnect to it and restore its settings.

    Parameters
    ----------
    loss : CameraLostError
        Symptom of the loss.
    lost : Link
        Link to the camera; it is closed.
    changes : Changes
        Settings that were made, to be made again in the same order.
    snapshot : Snapshot
        All settings in force, as a camera that was switched off and on has lost those of other programs, too.
    patience_s : float
        How long to wait for it.
    cancelled : Event
        Cancels the wait.

    Returns
    -------
    Link, Gap
        New link to the camera, and the interruption.

    Raises
    ------
    CameraError
        CameraLostError if it does not come back in time, CameraSettingError if it does not take its former settings.
    """
    lost_at, began_s = datetime.now(UTC), time.monotonic()
    _log.warning("%s; waiting up to %g s for it to come back", str(loss), patience_s)
    info = lost.info
    lost.close()
    # As text: a stored exception would keep its traceback and with it a half-opened camera alive.
    last = str(loss)
    n_looks = 0
    while (waited_s := time.monotonic() - began_s) < patience_s:
        try:
            found = _look_for(info, everywhere=n_looks % _LOOKS_AT_ADDRESS == _LOOKS_AT_ADDRESS - 1)
            if found is not None:
                link = _connect_as_before(found, changes, snapshot)
                back_s = time.monotonic() - began_s
                _log.warning("%s came back after %.1f s; its settings are restored", link.identity, back_s)
                return link, Gap(lost_at, datetime.now(UTC), back_s, str(loss))
        except _NotRestoredError as error:
            raise CameraSettingError(str(error)) from error
        except CameraError as error:
            # Not ready yet, still registered with the old connection, or lost again.
            last = str(error)
        n_looks += 1
        if cancelled.wait(min(_PAUSE_S, patience_s - waited_s)):
            raise CameraError(f"camera {info.serial} was closed while it was waited for: open it again")
    raise CameraLostError(f"{loss}; it did not come back within {patience_s:g} s [{last}]") from loss


def _look_for(info: CameraInfo, everywhere: bool) -> CameraInfo | None:
    if info.protocol == "GigEVision" and not everywhere:
        seen = gvcp.announce(info.address, tries=1)
        return info if seen is not None and printable(seen.serial) == info.serial else None
    return next((each for each in discover() if each.serial == info.serial), None)


class _NotRestoredError(CameraSettingError):
    """The camera answers as before, but not with its settings of before."""


def _connect_as_before(info: CameraInfo, changes: Changes, snapshot: Snapshot) -> Link:
    link = connect(info)
    try:
        changes.restore(link)
        try:
            restore_snapshot(link, snapshot)
        except CameraSettingError as error:
            raise _NotRestoredError(str(error)) from error
    except BaseException:
        link.close()
        raise
    return link
