"""Keys during an acquisition: p pauses and resumes, q ends."""

from __future__ import annotations

import os
import select
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Self

from ..terminal import say

if TYPE_CHECKING:
    from ...acquire import Control

#: Interval at which the listener checks whether to end.
_LOOK_S = 0.1


class Keys:
    """Listen to keys during the context, if the process runs in the foreground of a terminal; without echo.

    Parameters
    ----------
    control : Control
        What is paused and ended.
    """

    def __init__(self, control: Control) -> None:
        self._control = control
        self._thread: threading.Thread | None = None
        self._ending = threading.Event()
        self._saved: list[Any] = []

    def __enter__(self) -> Self:
        """Start listening."""
        if _in_foreground():
            say("Keys: p pauses or resumes, q ends")
            self._start()
        return self

    def __exit__(self, *exc: object) -> None:
        """Stop listening and restore the terminal."""
        self._stop()

    @contextmanager
    def silent(self) -> Iterator[None]:
        """Stop listening while another part asks a question."""
        listening = self._thread is not None
        self._stop()
        try:
            yield
        finally:
            if listening:
                self._start()

    def _start(self) -> None:
        import termios  # neither is on all systems
        import tty

        descriptor = sys.stdin.fileno()
        self._saved = termios.tcgetattr(descriptor)
        self._ending.clear()
        self._thread = threading.Thread(target=self._listen, args=(descriptor,), name="labcdp keys", daemon=True)
        # Single keys without echo; Ctrl-C still interrupts.
        tty.setcbreak(descriptor)
        self._thread.start()

    def _stop(self) -> None:
        if self._thread is None:
            return
        import termios

        try:
            self._ending.set()
            self._thread.join()
        finally:
            self._thread = None
            termios.tcsetattr(sys.stdin.fileno(), termios.TCSADRAIN, self._saved)

    def _listen(self, descriptor: int) -> None:
        while not self._ending.is_set():
            readable, _, _ = select.select([descriptor], [], [], _LOOK_S)
            pressed = os.read(descriptor, 1) if readable else b""
            if readable and not pressed:
                return
            if pressed == b"p":
                self._toggle()
            elif pressed == b"q":
                say("Ending after this frame")
                self._control.stop()

    def _toggle(self) -> None:
        if self._control.paused:
            say("Resumed")
            self._control.resume()
        else:
            say("Pausing after this frame: p resumes, q ends")
            self._control.pause()


def _in_foreground() -> bool:
    """Whether keys reach this process: a background job that changes terminal settings is stopped."""
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (AttributeError, OSError, ValueError):
        # No standard input, or one that is closed.
        return False
