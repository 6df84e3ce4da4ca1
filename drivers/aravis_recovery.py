"""Finding a lost camera again, and giving it the settings it had."""

from __future__ import annotations

import logging
import threading
import time
from datetime import UTC, datetime
from typing import Any

from . import gvcp
from .aravis_features import write_feature
from .aravis_library import CameraInfo, discover
from .aravis_link import Link, connect
from .aravis_settings import change_setting
from .camera import CameraError, CameraLostError, FeatureValue, Gap

_log = logging.getLogger(__name__)

#: Pause between two looks for a lost camera.
_PAUSE_S = 0.25

#: After so many looks in vain at its old address, all networks are searched: its address may have changed.
_LOOKS_AT_ADDRESS = 8


class Changes:
    """What was set since a camera was opened, so that it can be set again in the same order."""

    def __init__(self) -> None:
        self._made: list[tuple[str, str, Any]] = []

    def setting(self, name: str, value: Any) -> None:
        """Note a parameter of `AravisCamera.configure`."""
        self._note("setting", name, value)

    def feature(self, name: str, value: FeatureValue) -> None:
        """Note a GenICam feature."""
        self._note("feature", name, value)

    @property
    def features(self) -> frozenset[str]:
        """Names of the GenICam features that were set."""
        return frozenset(name for kind, name, _ in self._made if kind == "feature")

    def _note(self, kind: str, name: str, value: Any) -> None:
        # The last change of each counts, at its place in time; but behind a selector one name means several features.
        if not any(made.endswith("Selector") for _, made, _ in self._made):
            self._made = [made for made in self._made if made[:2] != (kind, name)]
        self._made = [*self._made, (kind, name, value)]

    def restore(self, link: Link) -> None:
        """Set everything again."""
        for kind, name, value in self._made:
            with link.using(f"{name} cannot be restored") as camera:
                if kind == "setting":
                    change_setting(camera, name, value)
                else:
                    write_feature(camera, name, value)


def bring_back(
    loss: CameraLostError, lost: Link, changes: Changes, patience_s: float, cancelled: threading.Event
) -> tuple[Link, Gap]:
    """Wait for a camera that was lost, connect to it and restore its settings.

    Parameters
    ----------
    loss : CameraLostError
        How the loss showed.
    lost : Link
        To the camera; is closed.
    changes : Changes
        What to set again.
    patience_s : float
        How long to wait for it.
    cancelled : Event
        Ends the wait.

    Returns
    -------
    Link, Gap
        To the camera, and the time without it.

    Raises
    ------
    CameraLostError
        If it does not come back in time.
    CameraError
        If the wait was cancelled, or it refuses a setting it took before.
    """
    lost_at, began_s = datetime.now(UTC), time.monotonic()
    _log.warning("%s; waiting up to %g s for it to come back", str(loss), patience_s)
    info = lost.info
    lost.close()
    # As text: an error kept here would keep the frames it passed through, and with them a camera half opened.
    last = str(loss)
    n_looks = 0
    while (waited_s := time.monotonic() - began_s) < patience_s:
        try:
            found = _look_for(info, everywhere=n_looks % _LOOKS_AT_ADDRESS == _LOOKS_AT_ADDRESS - 1)
            if found is not None:
                link = _connect_as_before(found, changes)
                gap = Gap(lost_at, datetime.now(UTC), time.monotonic() - began_s, str(loss))
                _log.warning("%s came back after %.1f s; its settings are restored", link.identity, gap.duration_s)
                return link, gap
        except CameraError as error:
            # Not ready yet, or the camera still counts us as its controller; gone again.
            last = str(error)
        n_looks += 1
        if cancelled.wait(min(_PAUSE_S, patience_s - waited_s)):
            raise CameraError(f"camera {info.serial} was closed while it was waited for: open it again")
    raise CameraLostError(f"{loss}; it did not come back within {patience_s:g} s [{last}]") from loss


def _look_for(info: CameraInfo, everywhere: bool) -> CameraInfo | None:
    if info.protocol == "GigEVision" and not everywhere:
        seen = gvcp.announce(info.address, tries=1)
        return info if seen is not None and seen.serial == info.serial else None
    return next((each for each in discover() if each.serial == info.serial), None)


def _connect_as_before(info: CameraInfo, changes: Changes) -> Link:
    link = connect(info)
    try:
        changes.restore(link)
    except BaseException:
        link.close()
        raise
    return link
