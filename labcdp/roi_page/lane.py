"""Work that follows a drawing: one piece at a time, always on to the newest."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Generic, Protocol, TypeVar

from .drawing import Drawing

T = TypeVar("T")


class RunElsewhere(Protocol):
    """Take `steps` without keeping the page waiting; hand each to `then`, and call `done`, where the page is."""

    def __call__(self, steps: Iterator[Any], then: Callable[[Any], None], done: Callable[[], None]) -> None:
        """Begin; return at once."""


class Lane(Generic[T]):
    """Do work for each drawing, unless a newer one has come before it is begun.

    Parameters
    ----------
    run_elsewhere : RunElsewhere
        Runs it.
    steps : function of a drawing
        The work, in steps; after a step it is left for a newer drawing.
    then : function
        Takes what a step found.
    """

    def __init__(
        self, run_elsewhere: RunElsewhere, steps: Callable[[Drawing], Iterator[T]], then: Callable[[T], None]
    ) -> None:
        self._run_elsewhere, self._work, self._then = run_elsewhere, steps, then
        self._busy = False
        self._next: Drawing | None = None

    def start(self, drawing: Drawing) -> None:
        """Do the work for a drawing, now or after the step that is under way."""
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
