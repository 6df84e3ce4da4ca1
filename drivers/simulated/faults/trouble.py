"""Trouble: combined state of all faults of a simulated camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ....core.errors import InputError


@dataclass(frozen=True)
class CameraTrouble:
    """Faults of a camera; none without arguments.

    Parameters
    ----------
    loss : float
        Share of the stream's packets that are lost, 0 to 1.
    frozen : bool
        It neither answers nor sends, and continues normally afterwards.
    stalled : bool
        It answers, but sends no frame.
    gone : bool
        It has no power; afterwards all settings are those after power-on.
    wrong_ids : bool
        It repeats frame ids, or sends older ones.
    wrong_size : bool
        Its frames have half the height.
    taken : bool
        Another program controls it, after a power cycle.

    Raises
    ------
    InputError
        If `loss` is not between 0 and 1.
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
        """Whether the connection to the camera is lost."""
        return self.frozen or self.gone or self.taken


#: No fault.
NO_TROUBLE = CameraTrouble()


class TroubledCamera(Protocol):
    """A simulated camera that supports faults."""

    def set_faults(self, trouble: CameraTrouble) -> None:
        """Replace the current trouble."""

    def follow_temperature(self) -> None:
        """Update the temperature registers."""
