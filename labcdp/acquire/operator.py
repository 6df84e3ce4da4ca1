"""The operator: what hands do at the bench, a person's or the simulated bench's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, Protocol

from ..errors import DeviceError
from .checks import CheckFinding


class Operator(Protocol):
    """Does what is asked and returns when it is done."""

    def cover_lens(self) -> None:
        """Put the cap on the lens."""

    def uncover_lens(self) -> None:
        """Take the cap off the lens."""

    def point_meter(self, patch: str) -> None:
        """Point the luminance meter at the middle of a patch."""

    def show_patch(self, patch: str) -> None:
        """Put a patch before camera and meter, where patches are shown one by one."""

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Say whether what was found is reason to take this part again."""


class HandNeededError(DeviceError):
    """Only a person can do this, and none is there."""


class Unattended:
    """Nobody is at the bench: what needs a hand is refused, so that an acquisition leaves it for later.

    Parameters
    ----------
    lens : {'uncovered', 'covered'}
        How the lens was left.
    """

    def __init__(self, lens: Literal["uncovered", "covered"] = "uncovered") -> None:
        self._lens = lens
        self._repeated: set[str] = set()

    def cover_lens(self) -> None:
        """Refuse, unless the cap is on the lens."""
        if self._lens != "covered":
            raise HandNeededError("put the cap on the lens")

    def uncover_lens(self) -> None:
        """Refuse, unless the lens is free."""
        if self._lens != "uncovered":
            raise HandNeededError("take the cap off the lens and light the target")

    def point_meter(self, patch: str) -> None:
        """Refuse."""
        raise HandNeededError("point the luminance meter at each patch")

    def show_patch(self, patch: str) -> None:
        """Refuse."""
        raise HandNeededError("put each patch before camera and meter")

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Take each part again once if it may then be good: what is too bright or too dark stays so without a hand."""
        again = what not in self._repeated and any(finding.passing for finding in findings)
        self._repeated.add(what)
        return again
