"""Interruption of a command by Ctrl-C or a signal."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

#: Commands that can be resumed.
_RESUMED = ("acquire", "import", "sweep", "video")


class EndedBySignal(BaseException):
    """The process received a signal to end; error handlers must not catch this.

    Parameters
    ----------
    number : int
        Of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@contextmanager
def unwinding() -> Iterator[None]:
    """Let SIGTERM and SIGHUP unwind the process, as Ctrl-C does, so that temporary files are removed.

    Raises
    ------
    EndedBySignal
        When one comes.
    """
    owner = os.getpid()

    def end(number: int, _frame: FrameType | None) -> None:
        if os.getpid() != owner:
            # A forked process has nothing to clean up.
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
            return
        raise EndedBySignal(number)

    # Not all systems have SIGHUP; nohup ignores it.
    known = [signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if name in signal.Signals.__members__]
    numbers = [one for one in known if signal.getsignal(one) != signal.SIG_IGN]
    before = {number: signal.signal(number, end) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def what_is_left(command: str | None) -> str:
    """Return a message on what an interrupted command leaves."""
    if command in _RESUMED:
        return "labcdp: stopped; recorded data are safe, and the same command resumes"
    return "labcdp: stopped; the same command starts again from the beginning"
