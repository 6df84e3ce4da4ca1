"""Operators of an acquisition on the command line: the user and the keys, a replay, and readings from a file."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Self

from ...acquire import CheckFinding, Control, Operator
from ...acquire.operator import AskedOperator
from ...core.errors import DeviceError
from ...drivers.file_meter import FileMeter
from ...session import ReadingRecord, Session
from ..terminal import Bars, say

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
                say("Stopping after this frame")
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


class Console:
    """Questions to the user at the terminal.

    Parameters
    ----------
    bars : Bars
        Hidden during a question.
    keys : Keys
        Silent during a question.
    """

    def __init__(self, bars: Bars, keys: Keys) -> None:
        self._bars = bars
        self._keys = keys

    def ask(self, question: str) -> str:
        """Return the typed answer; raises DeviceError at the end of standard input."""
        with self._bars.paused(), self._keys.silent():
            say(question)
            try:
                return input()
            except EOFError:
                raise DeviceError(
                    "no answer from the terminal: run the command in an interactive terminal, or with --unattended; "
                    "recorded data are safe"
                ) from None


class ConsoleOperator(AskedOperator):
    """The user at the terminal.

    Parameters
    ----------
    console : Console
        Where the person is asked.
    hands : Operator or None
        The simulated bench, which then does what the person confirmed.
    """

    def __init__(self, console: Console, hands: Operator | None = None) -> None:
        super().__init__(hands)
        self._console = console

    def request(self, step: str, patch: str = "") -> None:
        """Ask the person to press Enter when the step is done."""
        self._console.ask(f"{step}, then press Enter.")

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Show the findings and ask whether to repeat."""
        for finding in findings:
            say(f"Warning: {finding}")
        answer = self._console.ask(f"Fix it and repeat the {what}? [y/N]")
        return answer.strip().lower() in ("y", "yes")


class RecordingOperator(AskedOperator):
    """Operator of a replay, which needs no manual steps."""

    def request(self, step: str, patch: str = "") -> None:
        """Do nothing."""

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Return False: a recording cannot be repeated."""
        return False


class UnpointedOperator(AskedOperator):
    """Operator of a rehearsal whose real readings come from a file: nobody is asked to point the meter.

    Parameters
    ----------
    operator : Operator
        Performs the other steps.
    bench : Operator
        The simulated bench, which points its meter.
    """

    def __init__(self, operator: Operator, bench: Operator) -> None:
        super().__init__(operator)
        self._operator = operator
        self._bench = bench

    def request(self, step: str, patch: str = "") -> None:
        """Leave it to the operator."""

    def point_meter(self, patch: str) -> None:
        """Have the simulated meter pointed."""
        self._bench.point_meter(patch)

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Delegate to the operator."""
        return self._operator.repeat(what, findings)


class FileMeterOperator(AskedOperator):
    """Operator for a meter whose readings come from a file, which is not pointed.

    Parameters
    ----------
    operator : Operator
        Performs the other steps.
    meter : FileMeter
        Open.
    session : Session
        Readings it already has are skipped.
    """

    def __init__(self, operator: Operator, meter: FileMeter, session: Session) -> None:
        super().__init__(operator)
        self._operator = operator
        self._meter = meter
        # Includes discarded readings, whose rows are used.
        self._recorded = [record.patch for record in session.records if isinstance(record, ReadingRecord)]

    def request(self, step: str, patch: str = "") -> None:
        """Leave it to the operator."""

    def point_meter(self, patch: str) -> None:
        """Go to the patch in the file, after the readings recorded earlier."""
        self._meter.point(patch)
        for _ in range(self._recorded.count(patch)):
            self._meter.measure()
        self._recorded = [name for name in self._recorded if name != patch]

    def show_patch(self, patch: str) -> None:
        """Delegate to the operator, and go to the patch in the file."""
        super().show_patch(patch)
        self.point_meter(patch)

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Delegate to the operator."""
        return self._operator.repeat(what, findings)
