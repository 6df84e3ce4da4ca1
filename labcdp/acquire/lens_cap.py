"""The lens cap: an operator is asked for it only when it is not as it should be."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal

from .operator import HandNeededError, Operator


class LensCap:
    """The cap of the lens, moved by an operator.

    Parameters
    ----------
    operator : Operator
        Moves it.
    """

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._is: Literal["unknown", "on", "off"] = "unknown"

    def on(self) -> None:
        """See to it that the lens is covered; raises HandNeededError."""
        if self._is != "on":
            self._operator.cover_lens()
            self._is = "on"

    def off(self) -> None:
        """See to it that the lens is free; raises HandNeededError."""
        if self._is != "off":
            self._operator.uncover_lens()
            self._is = "off"

    def leave_off(self) -> None:
        """Take the cap off at the end, if it was put on and somebody is there."""
        if self._is == "on":
            with suppress(HandNeededError):
                self.off()
