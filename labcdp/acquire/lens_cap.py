"""The lens cap; the operator is asked to move it only when necessary."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal

from .operator import HandNeededError, Operator


class LensCap:
    """State of the lens cap, which an operator moves.

    Parameters
    ----------
    operator : Operator
        Moves the cap.
    """

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._is: Literal["unknown", "on", "off"] = "unknown"

    def on(self) -> None:
        """Ensure that the lens is covered; raises HandNeededError."""
        if self._is != "on":
            self._operator.cover_lens()
            self._is = "on"

    def off(self) -> None:
        """Ensure that the lens is uncovered; raises HandNeededError."""
        if self._is != "off":
            self._operator.uncover_lens()
            self._is = "off"

    def leave_off(self) -> None:
        """Remove the cap at the end if it was put on and an operator is present."""
        if self._is == "on":
            with suppress(HandNeededError):
                self.off()
