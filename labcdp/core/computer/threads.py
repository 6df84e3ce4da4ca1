"""Threads: waiting for one without losing what it does, and independent parts of a calculation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Event, Thread
from typing import TypeVar

_Part = TypeVar("_Part")
_Result = TypeVar("_Result")

#: Number of values from which threads are worth their overhead (a few tenths of a millisecond).
LONG = 2**16


class InterruptSafeThread:
    """A thread whose end can be awaited even if a signal arrives meanwhile.

    If Ctrl-C interrupts `threading.Thread.join`, CPython up to 3.12 treats the thread as ended although it still runs.

    Parameters
    ----------
    work : callable
        What it does.
    name : str
        Of the thread.
    """

    def __init__(self, work: Callable[[], None], name: str) -> None:
        self._ended = Event()
        self._work = work
        self._thread = Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def finish(self, request_end: Callable[[], None]) -> None:
        """Request the end of the thread and wait for it; an interrupt is raised only afterwards."""
        interrupted: BaseException | None = None
        while not self._ended.is_set():
            try:
                request_end()
                self._ended.wait()
            except BaseException as error:
                interrupted = error
        self._thread.join()
        if interrupted is not None:
            raise interrupted

    def _run(self) -> None:
        try:
            self._work()
        finally:
            self._ended.set()


def each_in_thread(function: Callable[[_Part], _Result], parts: Sequence[_Part], size: int) -> list[_Result]:
    """Call a function for each of a few parts, in threads if the parts process `LONG` values or more.

    NumPy releases the GIL while it sorts and searches. The parts are the same with and without threads, and so are the
    results.
    """
    if size < LONG:
        return [function(part) for part in parts]
    with ThreadPoolExecutor(len(parts)) as pool:
        return list(pool.map(function, parts))
