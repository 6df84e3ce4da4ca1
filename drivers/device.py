"""Device: opened and closed explicitly or as a context manager."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal, Protocol, Self


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


State = Literal["good", "notice", "fault", "unknown"]


@dataclass(frozen=True)
class Finding:
    """The outcome of one check.

    Parameters
    ----------
    topic : str
        Subject of the check, for example ``receive buffer``.
    state : {'good', 'notice', 'fault', 'unknown'}
        Good; works but could be better; does not work; unknown.
    cause : str
        Observation, with values and units.
    remedy : str or None
        Command or manual step that fixes it; None if good.
    """

    topic: str
    state: State
    cause: str
    remedy: str | None = None

    def __str__(self) -> str:
        """Return cause and remedy on one line."""
        return self.cause if self.remedy is None else f"{self.cause}: {self.remedy}"

    @classmethod
    def judged(cls, topic: str, cause: str, remedy: str | None, state: State = "notice") -> Self:
        """Return a good finding, or one of a `state` if there is a remedy."""
        return cls(topic, "good" if remedy is None else state, cause, remedy)

    @classmethod
    def of_error(cls, topic: str, error: Exception, state: State = "fault") -> Self:
        """Convert an error of labcdp, whose message ends with the remedy after its last colon."""
        text = " ".join(str(error).split())
        cause, colon, remedy = text.rpartition(": ")
        # A reason by another program is in brackets at the end and may contain a colon.
        if not colon or remedy.count("]") > remedy.count("["):
            return cls(topic, state, text)
        return cls(topic, state, cause, remedy)
