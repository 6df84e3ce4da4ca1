"""Device: opened and closed explicitly or as a context manager."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self


class Device(ABC):
    """A camera or meter as a context manager; its constructor does no I/O."""

    @abstractmethod
    def open(self) -> Self:
        """Connect; does nothing if it is open."""

    @abstractmethod
    def close(self) -> None:
        """Disconnect; may be called twice."""

    def __enter__(self) -> Self:
        """Open."""
        return self.open()

    def __exit__(self, *exc: object) -> None:
        """Close."""
        self.close()
