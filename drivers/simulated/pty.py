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
from contextlib import suppress
from pathlib import Path
from typing import Final, Self

from ...core.errors import DeviceError
from ..minolta.line import CRLF
from .port import FaultyMeter, MeterEngine

#: Interval at which an idle port is prepared for the next program.
_IDLE_S: Final = 0.2
#: A command interrupted for longer than this is processed as it is, without CR LF (the manual).
_CHARACTER_TIMEOUT_S: Final = 5.0


class PtyMeter(FaultyMeter):
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

    def __init__(self, engine: MeterEngine, *, response_time_s: float = 0.8) -> None:
        super().__init__(engine, response_time_s)
        self._folder: Path | None = None
        self._plugged = False
        self._plugging = threading.Lock()

    @property
    def port(self) -> str:
        """Path of the port, also while it is unplugged; raises DeviceError outside the context."""
        if self._folder is None:
            raise DeviceError("the simulated meter has no port yet", "use it in a with statement")
        return str(self._folder / "meter")

    def __enter__(self) -> Self:
        if self._folder is not None:
            raise DeviceError(f"the simulated meter is already served on {self.port}", "make another one")
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
        while (chunk := self._receive(_CHARACTER_TIMEOUT_S if received else _IDLE_S)) is not None:
            received += chunk
            while CRLF in received:
                command, _, received = received.partition(CRLF)
                if self._respond(command + CRLF):
                    received = b""
            if received and not chunk:
                self._respond(received)
                received = b""

    def _receive(self, timeout_s: float | None) -> bytes | None:
        """Return received bytes, none after the time-out, or None to stop."""
        ready, _, _ = select.select([self._master, self._stop_read], [], [], timeout_s)
        if self._stop_read in ready:
            return None
        # A program may have opened the port without sending.
        self._forget_settings()
        return os.read(self._master, 4096) if ready else b""

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
        replied = self.reply(command)
        if replied is None:
            return False
        reply, busy_s = replied
        ready_at = time.monotonic() + busy_s
        while (left_s := ready_at - time.monotonic()) > 0:
            if self._receive(left_s) is None:
                break
        with suppress(BlockingIOError):  # buffer full without a reader: the meter gives up too
            os.write(self._master, reply)
        return busy_s > 0
