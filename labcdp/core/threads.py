"""Waiting for threads without losing what they do."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event, Thread


class FinishedThread:
    """A thread whose end can be waited for although a signal comes meanwhile.

    `threading.Thread.join` takes a thread for ended when Ctrl-C interrupts it, although it runs (CPython up to 3.12).

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
