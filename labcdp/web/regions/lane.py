"""Background work on drawings, one step at a time, always for the newest drawing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Generic, Protocol, TypeVar

from .drawing import Drawing

T = TypeVar("T")


class RunElsewhere(Protocol):
    """Run `steps` without blocking the page; pass each result to `then` and call `done` in the page's thread."""

    def __call__(self, steps: Iterator[Any], then: Callable[[Any], None], done: Callable[[], None]) -> None:
        """Start and return immediately."""


class Lane(Generic[T]):
    """Process drawings, skipping those superseded before they are started.

    Parameters
    ----------
    run_elsewhere : RunElsewhere
        Runs it.
    steps : function of a drawing
        The work in steps; it is abandoned after a step for a newer drawing.
    then : function
        Receives the result of a step.
    """

    def __init__(
        self, run_elsewhere: RunElsewhere, steps: Callable[[Drawing], Iterator[T]], then: Callable[[T], None]
    ) -> None:
        self._run_elsewhere, self._work, self._then = run_elsewhere, steps, then
        self._busy = False
        self._next: Drawing | None = None

    def start(self, drawing: Drawing) -> None:
        """Process a drawing, now or after the current step."""
        if self._busy:
            self._next = drawing
            return
        self._busy = True
        self._run_elsewhere(self._steps(drawing), self._then, self._done)

    def _steps(self, drawing: Drawing) -> Iterator[T]:
        for step in self._work(drawing):
            yield step
            if self._next is not None:
                return

    def _done(self) -> None:
        self._busy = False
        if self._next is not None:
            drawing, self._next = self._next, None
            self.start(drawing)
