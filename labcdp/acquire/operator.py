"""The operator: manual steps at the bench, by the user or the simulated bench."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, Protocol

from ..core.errors import DeviceError
from .checks import CheckFinding


class Operator(Protocol):
    """Performs manual steps; each method returns when its step is done."""

    def cover_lens(self) -> None:
        """Cover the lens."""

    def uncover_lens(self) -> None:
        """Uncover the lens."""

    def point_meter(self, patch: str) -> None:
        """Point the luminance meter at the centre of a patch."""

    def show_patch(self, patch: str) -> None:
        """Place a patch in front of camera and meter, where patches are shown one by one."""

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Decide whether to repeat a unit because of its problems."""


class HandNeededError(DeviceError):
    """A manual step is required, but no operator is present."""


class Unattended:
    """Unattended bench: manual steps are refused, so that an acquisition skips them.

    Parameters
    ----------
    lens : {'uncovered', 'covered'}
        State of the lens cap.
    """

    def __init__(self, lens: Literal["uncovered", "covered"] = "uncovered") -> None:
        self._lens = lens
        self._repeated: set[str] = set()

    def cover_lens(self) -> None:
        """Refuse, unless the cap is on the lens."""
        if self._lens != "covered":
            raise HandNeededError("cover the lens")

    def uncover_lens(self) -> None:
        """Refuse, unless the lens is free."""
        if self._lens != "uncovered":
            raise HandNeededError("uncover the lens and light the target")

    def point_meter(self, patch: str) -> None:
        """Refuse."""
        raise HandNeededError("point the luminance meter at each patch")

    def show_patch(self, patch: str) -> None:
        """Refuse."""
        raise HandNeededError("put each patch before camera and meter")

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Repeat a unit once if that may solve the problem without a manual step."""
        again = what not in self._repeated and any(finding.passing for finding in findings)
        self._repeated.add(what)
        return again
