"""Trouble: all that is wrong with a simulated camera at one moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ...errors import InputError


@dataclass(frozen=True)
class CameraTrouble:
    """What is wrong with a camera; without arguments, nothing.

    Parameters
    ----------
    loss : float
        Share of the stream's packets that are lost, 0 to 1.
    frozen : bool
        It neither answers nor sends, and goes on afterwards as if nothing had been.
    stalled : bool
        It answers, but sends no frame.
    gone : bool
        It has no power; afterwards all its settings are those after switching on.
    wrong_ids : bool
        It sends frame ids again, or older ones.
    wrong_size : bool
        Its frames have half the height.
    taken : bool
        Another program controls it; that program switched it off and on to get it.

    Raises
    ------
    InputError
        If `loss` is no share.
    """

    loss: float = 0.0
    frozen: bool = False
    stalled: bool = False
    gone: bool = False
    wrong_ids: bool = False
    wrong_size: bool = False
    taken: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.loss <= 1:
            raise InputError(f"loss is {self.loss}: give a share from 0 to 1")

    @property
    def out_of_reach(self) -> bool:
        """Whether its user has lost the camera for now."""
        return self.frozen or self.gone or self.taken


#: All is well.
NO_TROUBLE = CameraTrouble()


class TroubledCamera(Protocol):
    """A simulated camera that trouble can befall."""

    def suffer(self, trouble: CameraTrouble) -> None:
        """Be in this trouble from now on, and in no other."""

    def follow_temperature(self) -> None:
        """Let the registers tell the temperature of now."""
