"""Keys a person presses while something runs: p pauses and goes on, q ends."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Self

from .terminal import say

if TYPE_CHECKING:
    from ..acquire import Control

#: How often the listener looks whether it is to end.
_LOOK_S = 0.1


class Keys:
    """Listens while the context lasts, if a person sits at the terminal; what is typed is not shown then.

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
        """Begin to listen."""
        if _in_foreground():
            say("Keys: p pauses and goes on, q ends")
            self._start()
        return self

    def __exit__(self, *exc: object) -> None:
        """Listen no more and leave the terminal as it was."""
        self._stop()

    @contextmanager
    def silent(self) -> Iterator[None]:
        """Leave the terminal to somebody who asks the person something."""
        listening = self._thread is not None
        self._stop()
        try:
            yield
        finally:
            if listening:
                self._start()

    def _start(self) -> None:
        descriptor = sys.stdin.fileno()
        self._saved = termios.tcgetattr(descriptor)
        self._ending.clear()
        self._thread = threading.Thread(target=self._listen, args=(descriptor,), name="labcdp keys", daemon=True)
        # Single keys, unseen; Ctrl-C still interrupts.
        tty.setcbreak(descriptor)
        self._thread.start()

    def _stop(self) -> None:
        if self._thread is None:
            return
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
            say("Going on")
            self._control.resume()
        else:
            say("Paused after this frame: p goes on, q ends")
            self._control.pause()


def _in_foreground() -> bool:
    """Whether keys come here: a background job that touched the terminal's settings would be stopped."""
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (AttributeError, OSError, ValueError):
        # No standard input, or one that is closed.
        return False
