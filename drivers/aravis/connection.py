"""Connection to a camera from open to close: reconnects to a lost one and restores its settings."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from ipaddress import AddressValueError, IPv4Address
from itertools import count
from typing import Any, TypeVar

from ...core.frame import CameraIdentity
from ..camera import CameraError, CameraLostError, CameraSettingError, Gap
from ..camera_settings import CameraSettings, CameraSetup, FeatureValue
from ..device import on_error
from . import gvcp
from .chunks import CHUNK_MODE
from .features import is_same, read_feature, readable_features, writable, write_feature
from .library import CameraInfo, choose, discover
from .link import Link, connect

#: First letters of features that belong to a connection or an operation and not to the picture: transport and clock
#: of GigE Vision, data beside the pixels, events, stored sets, files, locks. `transport` sets those of the stream anew.
_NOT_OF_THE_PICTURE = (
    *("Gev", "Stream", "DeviceLink", "Ptp", "Chunk", "Event", "UserSet", "File", "Action", "TLParams"),
)
#: Those of the stream that `transport` sets.
_OF_THE_STREAM = (
    "GevSCPSPacketSize",
    "GevSCPD",
    "StreamBytesPerSecond",
    "DeviceLinkThroughputLimitMode",
    "DeviceLinkThroughputLimit",
)
#: Relative difference from a wanted number that a camera may round to.
_ROUNDED_REL = 0.01
#: Rounds of writing; one feature may be locked, or have another range, until another one is restored.
_MAX_ROUNDS = 5

Snapshot = Mapping[str, FeatureValue]


def take_snapshot(link: Link, *, stream: bool = False) -> Snapshot:
    """Read all writable features that may change a picture, by name in the camera's order; `stream` adds its own."""
    with link.using("its settings cannot be read") as camera:
        snapshot = dict(readable_features(camera, access="RW", left_out=_NOT_OF_THE_PICTURE))
        if writable(camera, CHUNK_MODE):
            snapshot[CHUNK_MODE] = read_feature(camera, CHUNK_MODE)
        if stream:
            snapshot |= {name: read_feature(camera, name) for name in _OF_THE_STREAM if writable(camera, name)}
        return snapshot


def restore_snapshot(link: Link, wanted: Snapshot) -> None:
    """Write the features that differ from a snapshot, and verify all of them by reading back.

    Raises
    ------
    CameraSettingError
        If some still differ, or are missing; the message names them.
    """
    now = take_snapshot(link, stream=True)
    different = _different(wanted, now)
    for _ in range(_MAX_ROUNDS):
        if not different:
            return
        refused: CameraSettingError | None = None
        for name in different:
            try:
                with link.using(f"{name} cannot be restored") as camera:
                    write_feature(camera, name, wanted[name])
            except CameraSettingError as error:
                refused = error
        now = take_snapshot(link, stream=True)
        different = _different(wanted, now)
    if different:
        named = ", ".join(f"{name} = {now.get(name, 'missing')}, not {wanted[name]}" for name in different)
        reason = "" if refused is None else f" [{refused}]"
        raise CameraSettingError(
            f"{link.identity} has other settings than before, which it does not change: {named}{reason}"
        )


def require_kept(
    who: CameraIdentity, wanted: CameraSetup, settings: CameraSettings, feature: Callable[[str], FeatureValue]
) -> None:
    """Refuse a camera that keeps other settings than those it was given.

    Parameters
    ----------
    who : CameraIdentity
        The camera.
    wanted : CameraSetup
        Settings that it was given.
    settings : CameraSettings
        In force.
    feature : callable
        Reads a feature by name.

    Raises
    ------
    CameraSettingError
        Naming the first that differs.
    """
    pairs = {name: (value, getattr(settings, name)) for name, value in wanted.settings.items()}
    pairs |= {name: (value, feature(name)) for name, value in wanted.features.items()}
    for name, (value, kept) in pairs.items():
        if not is_same(value, kept, _ROUNDED_REL):
            raise CameraSettingError(f"{who} keeps {name} at {kept}, not {value}", "give a value that it keeps")


def _different(wanted: Snapshot, now: Snapshot) -> list[str]:
    return [name for name, value in wanted.items() if name not in now or not is_same(value, now[name])]


_log = logging.getLogger(__name__)

_T = TypeVar("_T")


#: Interval of the search for a lost camera.
_PAUSE_S = 0.25

#: Failed attempts at its old address after which all networks are searched, as its address may have changed.
_LOOKS_AT_ADDRESS = 8


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
        self.patience_s = patience_s
        self._link: Link | None = None
        self._closed = threading.Event()
        # Settings made since it was opened, by name and in order, to be made again in the same order.
        self._changes: tuple[tuple[str, Callable[[Any], object]], ...] = ()
        # All settings in force: a camera that was switched off and on has lost those of other programs, too.
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
            raise CameraError("the camera is not open", "use it as a context manager or call open() first")
        return self._link

    def open(self) -> None:
        """Find the camera and take control of it."""
        link = connect(find_camera(self._selector))
        self._closed.clear()
        self._changes, self.gaps = (), ()
        self._link = link
        with on_error(self.close):
            self.remember_settings()
        _log.info("opened %s at %s", link.identity, link.info.address)

    def close(self) -> None:
        """Release the camera and cancel a wait for it; may be called twice."""
        self._closed.set()
        link, self._link = self._link, None
        if link is not None:
            link.close()

    @property
    def changed(self) -> frozenset[str]:
        """Names of the settings and features that were set since it was opened."""
        return frozenset(name for name, _ in self._changes)

    def note_change(self, name: str, make: Callable[[Any], object]) -> None:
        """Note a change of Aravis' camera that was made, for making it again."""
        # Only the last change of each is kept; but with a selector one name stands for several features.
        kept = self._changes
        if not any(made.endswith("Selector") for made, _ in kept):
            kept = tuple(change for change in kept if change[0] != name)
        self._changes = (*kept, (name, make))

    def remember_settings(self) -> None:
        """Read all settings, for restoring them if the camera is lost; call it after a change."""
        if self.patience_s > 0:
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
        """Wait up to `patience_s` for a lost camera, reconnect to it and restore its settings.

        Raises
        ------
        CameraError
            The loss, if it does not come back in time; CameraSettingError if it does not take its former settings.
        """
        lost = self.link
        if self.patience_s == 0:
            raise loss
        lost_at, began_s = datetime.now(UTC), time.monotonic()
        _log.warning("%s; waiting up to %g s for it to come back", str(loss), self.patience_s)
        lost.close()
        # As text: a stored exception would keep its traceback and with it a half-opened camera alive.
        last, link = str(loss), None
        for n_looks in count(1):
            waited_s = time.monotonic() - began_s
            if waited_s >= self.patience_s:
                raise CameraLostError(f"{loss}; it did not come back within {self.patience_s:g} s [{last}]") from loss
            try:
                info = _look_for(lost.info, everywhere=n_looks % _LOOKS_AT_ADDRESS == 0)
                link = None if info is None else self._connect_as_before(info)
            except _NotRestoredError as error:
                raise CameraSettingError(error.cause, error.remedy) from error
            except CameraError as error:
                # Not ready yet, still registered with the old connection, or lost again.
                last = str(error)
            if link is not None or self._closed.wait(min(_PAUSE_S, self.patience_s - waited_s)):
                break
        if self._closed.is_set() or link is None:
            if link is not None:
                link.close()
            raise CameraError(f"{lost.identity} was closed while it was waited for", "open it again")
        back_s = time.monotonic() - began_s
        _log.warning("%s came back after %.1f s; its settings are restored", link.identity, back_s)
        self._link = link
        self.gaps = (*self.gaps, Gap(lost_at, datetime.now(UTC), back_s, str(loss)))

    def _connect_as_before(self, info: CameraInfo) -> Link:
        link = connect(info)
        with on_error(link.close):
            for name, make in self._changes:
                with link.using(f"{name} cannot be restored") as camera:
                    make(camera)
            try:
                restore_snapshot(link, self._snapshot)
            except CameraSettingError as error:
                raise _NotRestoredError(error.cause, error.remedy) from error
        return link


class _NotRestoredError(CameraSettingError):
    """The camera answers as before, but not with its settings of before."""


def find_camera(selector: str | None) -> CameraInfo:
    """Find a camera by serial number, address or model, or the only one.

    At an address it is asked itself, which mostly takes milliseconds and also reaches cameras that no broadcast
    reaches; else Aravis searches for about a second.

    Raises
    ------
    CameraNotFoundError
        If none fits, or more than one.
    CameraError
        If Aravis is not installed.
    """
    try:
        address = str(IPv4Address(selector or ""))
    except AddressValueError:
        return choose(discover(), selector)
    seen = gvcp.announce(address, tries=gvcp.PATIENT_TRIES)
    return choose(discover(), selector) if seen is None else replace(seen, address=address)


def _look_for(info: CameraInfo, everywhere: bool) -> CameraInfo | None:
    if info.protocol == "GigEVision" and not everywhere:
        seen = gvcp.announce(info.address, tries=1)
        return info if seen is not None and seen.serial == info.serial else None
    return next((candidate for candidate in discover() if candidate.serial == info.serial), None)
