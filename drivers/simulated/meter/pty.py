"""A pseudo-terminal that answers like a meter on a serial port, and the faults it can be given."""

from __future__ import annotations

import os
import select
import shutil
import tempfile
import termios
import threading
import time
import tty
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol, Self

import numpy as np

from ....core.errors import DeviceError, InputError

_CRLF: Final = b"\r\n"

#: Interval at which an idle port is prepared for the next program.
_IDLE_S: Final = 0.2

#: Longest garbage; a reading has 17 bytes.
_LONGEST_GARBAGE: Final = 24


class MeterEngine(Protocol):
    """Maps commands to replies, for example `SimulatedLS`."""

    def answer(self, command: bytes) -> bytes:
        """Return the reply to a command, both with CR LF, or nothing; a command without CR LF is incomplete."""


@dataclass(frozen=True)
class Fault:
    r"""Fault of one reply; none without arguments.

    A meter that states fL is no fault of one reply: set `SimulatedLS.unit`.

    Parameters
    ----------
    delay_s : float
        Delay of the reply in seconds; until then the meter accepts no command.
    reply : bytes or None
        Sent instead of the meter's own: ``b""`` for silence, ``b"ER30\r\n"`` for an error code, or any garbage.
    n_bytes : int or None
        Number of bytes after which the reply is truncated.

    Examples
    --------
    Silent once, then an answer 2 s late, a good one, one cut short, and an empty battery:

    >>> faults = [Fault(reply=b""), Fault(delay_s=2), Fault(), Fault(n_bytes=7), Fault(reply=b"ER30\r\n")]
    """

    delay_s: float = 0.0
    reply: bytes | None = None
    n_bytes: int | None = None

    def __post_init__(self) -> None:
        if not self.delay_s >= 0:
            raise InputError(f"delay_s is {self.delay_s}: give a number of seconds of at least 0")
        if self.n_bytes is not None and self.n_bytes < 0:
            raise InputError(f"n_bytes is {self.n_bytes}: give a number of bytes of at least 0")

    @classmethod
    def garbled(cls, seed: int) -> Fault:
        """Return a reply of random bytes of that seed, every other time with a CR LF."""
        rng = np.random.default_rng(seed)
        garbage = rng.bytes(int(rng.integers(1, _LONGEST_GARBAGE)))
        return cls(reply=garbage + (_CRLF if rng.integers(2) else b""))

    def applied_to(self, reply: bytes) -> bytes:
        """Return the bytes sent instead of a good reply."""
        return (reply if self.reply is None else self.reply)[: self.n_bytes]


class PtyMeter:
    """Serve a meter on a pseudo-terminal while the context lasts.

    The port is a link in a folder of its own, so that it has the same name after `unplug` and `plug_in`. Programs may
    open and close the port as often as they like, with or without settings and handshake. While the meter measures
    (MES) it accepts no command: what is sent then is lost, as with the real one.

    Parameters
    ----------
    engine : MeterEngine
        The meter; called from the serving thread only, which an exception ends.
    response_time_s : float
        Time a MES takes; the default is that of the FAST response.
    character_timeout_s : float
        A command interrupted for longer than this is processed as it is, without CR LF (5 s in the manual).

    Raises
    ------
    InputError
        If a time is negative.

    Examples
    --------
    >>> with PtyMeter(SimulatedLS(lambda: 83.02)) as meter, MinoltaLS110(meter.port) as ls110:  # doctest: +SKIP
    ...     ls110.measure().value
    83.02
    """

    def __init__(self, engine: MeterEngine, *, response_time_s: float = 0.8, character_timeout_s: float = 5.0) -> None:
        for name, time_s in (
            ("response_time_s", response_time_s),
            ("character_timeout_s", character_timeout_s),
        ):
            if not time_s >= 0:
                raise InputError(f"{name} is {time_s}: give a number of seconds of at least 0")
        self._engine = engine
        self._response_time_s = response_time_s
        self._character_timeout_s = character_timeout_s
        self._faults: deque[Fault] = deque()
        self._folder: Path | None = None
        self._plugged = False
        self._plugging = threading.Lock()

    @property
    def port(self) -> str:
        """Path of the port, also while it is unplugged; raises DeviceError outside the context."""
        if self._folder is None:
            raise DeviceError("the simulated meter has no port yet: use it in a with statement")
        return str(self._folder / "meter")

    def inject(self, *faults: Fault) -> None:
        """Queue faults, one for each of the next replies, of whatever command."""
        self._faults.extend(faults)

    def recover(self) -> None:
        """Forget the faults that are queued."""
        self._faults.clear()

    def __enter__(self) -> Self:
        if self._folder is not None:
            raise DeviceError(f"the simulated meter is already served on {self.port}: make another one")
        self._folder = Path(tempfile.mkdtemp(prefix="labcdp-meter-"))
        self.plug_in()
        return self

    def __exit__(self, *exc: object) -> None:
        self.unplug()
        with self._plugging:
            if self._folder is not None:
                shutil.rmtree(self._folder)
                self._folder = None

    def plug_in(self) -> None:
        """Create the port; does nothing outside the context."""
        with self._plugging:
            if self._plugged or self._folder is None:
                return
            # The slave stays open: without any, the master would report a hang-up between two programs.
            self._master, self._slave = os.openpty()
            self._stop_read, self._stop_write = os.pipe()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            Path(self.port).symlink_to(os.ttyname(self._slave))
            self._thread = threading.Thread(target=self._serve, name=f"meter on {self.port}", daemon=True)
            self._thread.start()
            self._plugged = True

    def unplug(self) -> None:
        """Remove the port, as when the cable is pulled; programs using it can neither read nor write."""
        with self._plugging:
            if not self._plugged:
                return
            os.write(self._stop_write, b"x")
            self._thread.join()
            Path(self.port).unlink()
            for descriptor in (self._stop_read, self._stop_write, self._master, self._slave):
                os.close(descriptor)
            self._plugged = False

    def _serve(self) -> None:
        """Answer commands until told to stop."""
        received = b""
        while (chunk := self._receive(self._character_timeout_s if received else _IDLE_S)) is not None:
            received += chunk
            while _CRLF in received:
                command, _, received = received.partition(_CRLF)
                if self._respond(command + _CRLF):
                    received = b""
            if received and not chunk:
                self._respond(received)
                received = b""

    def _receive(self, timeout_s: float | None) -> bytes | None:
        """Return received bytes, none after the time-out, or None to stop."""
        ready, _, _ = select.select([self._master, self._stop_read], [], [], timeout_s)
        if self._stop_read in ready:
            return None
        if not ready:
            # A program may have opened the port without sending.
            self._forget_settings()
            return b""
        self._forget_settings()
        return os.read(self._master, 4096)

    def _forget_settings(self) -> None:
        """Prepare the port so that the next program can configure it, including parity.

        A pseudo-terminal has no parity. Setting it fails (EINVAL, in the C library) unless another setting
        changes with it; so no two programs in a row could ask for the meter's settings if the speed stayed.
        """
        settings = termios.tcgetattr(self._slave)
        settings[4:6] = [termios.B38400, termios.B38400]
        termios.tcsetattr(self._slave, termios.TCSANOW, settings)

    def _respond(self, command: bytes) -> bool:
        """Answer one command; returns True if the meter ignored input meanwhile."""
        answer = self._engine.answer(command)
        if not answer:
            return False
        fault = self._faults.popleft() if self._faults else Fault()
        reply = fault.applied_to(answer)
        busy_s = fault.delay_s + (self._response_time_s if command.startswith(b"MES") else 0.0)
        ready_at = time.monotonic() + busy_s
        while (left_s := ready_at - time.monotonic()) > 0:
            if self._receive(left_s) is None:
                break
        with suppress(BlockingIOError):  # buffer full without a reader: the meter gives up too
            os.write(self._master, reply)
        return busy_s > 0
