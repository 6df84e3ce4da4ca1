"""How a command ends before it is done: by Ctrl-C, or by a signal that ends a process."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

#: Commands that record what they have done and go on with it.
_GOES_ON = ("acquire", "import", "sweep", "video")


class EndedBySignal(BaseException):
    """The process was told to end; no error handler may take this for one.

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
    """Let SIGTERM and SIGHUP unwind the process, as Ctrl-C does, so that nothing half done is left behind.

    Raises
    ------
    EndedBySignal
        When one comes.
    """
    owner = os.getpid()

    def end(number: int, _frame: FrameType | None) -> None:
        if os.getpid() != owner:
            # A process that was forked from this one has nothing of its own to clear away.
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
            return
        raise EndedBySignal(number)

    # nohup wants the end of the terminal to be ignored.
    numbers = [one for one in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(one) != signal.SIG_IGN]
    before = {number: signal.signal(number, end) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def what_is_left(command: str | None) -> str:
    """Say what a command that was stopped leaves."""
    if command in _GOES_ON:
        return "labcdp: stopped; what was recorded is safe, and the same command goes on with it"
    return "labcdp: stopped before it was done; the same command begins anew"
