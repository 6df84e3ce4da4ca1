"""The operator: what hands do at the bench, a person's or the simulated bench's."""

from __future__ import annotations

from typing import Protocol


class Operator(Protocol):
    """Does what is asked and returns when it is done."""

    def cover_lens(self) -> None:
        """Put the cap on the lens."""

    def uncover_lens(self) -> None:
        """Take the cap off the lens."""

    def point_meter(self, patch: str) -> None:
        """Point the luminance meter at the middle of a patch."""
