"""Device: opened and closed explicitly or as a context manager."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, Self


class Device(Protocol):
    """A camera or meter as a context manager; its constructor does no I/O."""

    def open(self) -> Self:
        """Connect; does nothing if it is open."""

    def close(self) -> None:
        """Disconnect; may be called twice."""

    def be_patient(self, patience_s: float) -> None:
        """Wait this long for the device when it is lost; 0 also ends a wait. Nothing for one that cannot be lost."""
        return

    def __enter__(self) -> Self:
        """Open."""
        return self.open()

    def __exit__(self, *exc: object) -> None:
        """Close."""
        self.close()


@contextmanager
def on_error(clean_up: Callable[[], object]) -> Iterator[None]:
    """Clean up if the context is left by an exception."""
    try:
        yield
    except BaseException:
        clean_up()
        raise


def size(n_bytes: float) -> str:
    """Return a number of bytes with its unit, for example ``10.1 MB`` (10^6 bytes)."""
    if n_bytes < 1e5:
        return f"{n_bytes:.0f} bytes"
    return f"{n_bytes / 1e3:.0f} kB" if n_bytes < 1e6 else f"{n_bytes / 1e6:.1f} MB"
