"""Line to a meter on a port: commands and replies, repeated requests, and a lost meter."""

from __future__ import annotations

import logging
import termios
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import serial

from ..device import on_error
from ..meter import (
    MeterError,
    MeterIncident,
    MeterIncidentKind,
    MeterLostError,
    MeterNotFoundError,
    MeterProtocolError,
    MeterReportedError,
    MeterTimeoutError,
)
from .port import Port, TranscriptWriter, connect

_log = logging.getLogger(__name__)

#: Ends each command; those of the LS-100 and CS-100A also end their replies with it.
CRLF: Final = b"\r\n"
#: In bytes: a port that sends without end is not read for ever.
_MOST_DRAINED: Final = 65536
#: Of no manual: asks the simulated meter what it is. A real one does not know the command.
SIMULATED_COMMAND: Final = "SIM"
#: What the answer of the simulated meter holds.
SIMULATED_NAME: Final = b"labcdp"
#: Polling interval for a lost port, in seconds.
_LOOK_EVERY_S: Final = 0.2
#: Command not understood: the only error code worth a retry.
_NOT_UNDERSTOOD: Final = "ER00"

T = TypeVar("T")


@dataclass(frozen=True)
class LineProtocol:
    """How a meter is set up, and what its replies look like.

    Parameters
    ----------
    set_up : tuple of str
        Commands on opening and after a loss, at least one, each acknowledged.
    parse_acknowledgement : callable
        Accepts the reply to one of them; raises MeterReportedError or MeterProtocolError.
    silence_remedy : str
        Remedy for a meter that does not answer.
    reply_end : bytes
        Ends a reply.
    longest_reply : int
        In bytes; the longest reply of a manual has 28.
    """

    set_up: tuple[str, ...]
    parse_acknowledgement: Callable[[bytes], None]
    silence_remedy: str
    reply_end: bytes = CRLF
    longest_reply: int = 64


class MeterLine:
    """A meter on a port: each command gets its own reply, is repeated where that helps, and waits for a lost meter.

    The meter sends one reply to each command it accepts, and accepts none while it measures. The reply of a failed
    exchange may arrive late; it is awaited and dropped before the next command, unless the same command is repeated. If
    it has not come by then, a mode is set first: replies keep their order, so that none of before follows its answer.

    Parameters
    ----------
    port : Port
        Where the meter is.
    timeout_s : float
        Longest wait for a reply, in seconds.
    attempts : int
        Largest number of attempts for a command.
    patience_s : float
        How long to wait for a lost meter, in seconds.
    protocol : LineProtocol
        Commands of the meter.
    transcript : TranscriptWriter or None
        Receives every byte.
    """

    def __init__(
        self,
        port: Port,
        timeout_s: float,
        attempts: int,
        patience_s: float,
        protocol: LineProtocol,
        transcript: TranscriptWriter | None,
    ) -> None:
        self._serial_port, self._port, self._clock = port, port.name, port.clock
        self._timeout_s = timeout_s
        # Longest time of a command without a loss.
        self._longest_s = timeout_s * (attempts + 1)
        self._attempts = attempts
        self.patience_s = patience_s
        self._protocol = protocol
        self._transcript = transcript
        self._serial: Any = None
        self._one_at_a_time = threading.Lock()
        # Replies that are due, until when, and whether one is to another command than the present.
        self._n_due, self._due_until_s, self._other_due = 0, 0.0, False
        self.incidents: tuple[MeterIncident, ...] = ()

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._serial is not None

    def open(self) -> None:
        """Open the port exclusively, and set the modes, within timeout_s * (attempts + 1).

        Raises
        ------
        MeterNotFoundError
            If the port is absent, in use, not permitted, or not a serial port.
        MeterError
            If the meter does not take the modes; the port is then closed.
        InputError
            If the transcript cannot be created.
        """
        self._serial = connect(self._serial_port, self._timeout_s)
        with on_error(self.close):
            if self._transcript is not None:
                self._transcript.open()
            give_up_s = self._clock.monotonic_s() + self._longest_s
            for command in self._protocol.set_up:
                self._ask_often(command, self._protocol.parse_acknowledgement, give_up_s)

    def close(self) -> None:
        """Close the port; may be called twice."""
        self._disconnect()
        if self._transcript is not None:
            self._transcript.close()

    def is_simulated(self) -> bool:
        """Whether the meter says that it is labcdp's simulated one; a real one does not understand the question."""
        give_up_s = self._clock.monotonic_s() + self._timeout_s
        try:
            return self._exchange(SIMULATED_COMMAND, lambda reply: SIMULATED_NAME in reply, give_up_s)
        except (MeterReportedError, MeterTimeoutError):
            return False

    def ask(self, command: str, parse: Callable[[bytes], T]) -> T:
        """Send a command, without CR LF, and return its parsed reply; raises MeterError after all retries.

        Takes at most timeout_s * (attempts + 1) + patience_s. A meter that does not come back is closed.
        """
        try:
            return self._ask_patiently(command, parse)
        except MeterError as error:
            self._note("error", error)
            raise

    def _note(self, kind: MeterIncidentKind, error: MeterError, duration_s: float = 0.0) -> None:
        self.incidents = (*self.incidents, MeterIncident(kind, self._clock.now(), str(error), duration_s))

    def _ask_patiently(self, command: str, parse: Callable[[bytes], T]) -> T:
        give_up_s = self._clock.monotonic_s() + self._longest_s + self.patience_s
        lost_until_s: float | None = None
        while True:
            try:
                return self._ask_often(command, parse, give_up_s)
            except (MeterLostError, MeterTimeoutError) as error:
                if self.patience_s == 0:
                    raise
                if lost_until_s is None:
                    # Reserve time for the command after the wait.
                    lost_until_s = min(self._clock.monotonic_s() + self.patience_s, give_up_s - self._timeout_s)
                elif self._clock.monotonic_s() >= lost_until_s:
                    self.close()
                    raise
                self._wait_for_meter(error, lost_until_s)

    def _ask_often(self, command: str, parse: Callable[[bytes], T], give_up_s: float) -> T:
        understood = True
        for attempt in range(1, self._attempts + 1):
            try:
                return self._exchange(command, parse, give_up_s, again=attempt > 1)
            except (MeterReportedError, MeterTimeoutError, MeterProtocolError) as error:
                hopeless = self._clock.monotonic_s() >= give_up_s
                if isinstance(error, MeterReportedError):
                    hopeless, understood = error.code != _NOT_UNDERSTOOD or not understood, False
                if hopeless or attempt == self._attempts:
                    raise
                self._note("asked again", error)
                _log.warning("%s; asking again (attempt %d of %d)", error, attempt + 1, self._attempts)
        raise AssertionError("attempts is at least 1")

    def _wait_for_meter(self, lost: MeterError, until_s: float) -> None:
        """Reopen the port and restore the modes; raises MeterLostError if that fails for too long."""
        began_s = self._clock.monotonic_s()
        _log.warning("%s; waiting up to %g s for the meter to come back", lost, self.patience_s)
        while True:
            self._disconnect()
            try:
                with on_error(self._disconnect):
                    self._serial = connect(self._serial_port, self._timeout_s)
                    for command in self._protocol.set_up:
                        self._exchange(command, self._protocol.parse_acknowledgement, until_s)
            except (MeterNotFoundError, MeterLostError, MeterTimeoutError, MeterProtocolError) as still:
                if self.patience_s == 0 or self._clock.monotonic_s() + _LOOK_EVERY_S >= until_s:
                    raise MeterLostError(
                        f"{lost}; it did not come back within {self.patience_s:g} s, last", f"{still}"
                    ) from still
                self._clock.sleep(_LOOK_EVERY_S)
            else:
                self._note("lost and back", lost, self._clock.monotonic_s() - began_s)
                _log.warning("%s: the meter is back, its modes are restored", self._port)
                return

    def _exchange(self, command: str, parse: Callable[[bytes], T], until_s: float, *, again: bool = False) -> T:
        """Send one command; return its reply, parsed. With `again` that to the same command just before is accepted."""
        with self._one_at_a_time:
            self._other_due = self._n_due > 0 and (self._other_due or not again)
            reply = self._reply(command, until_s)
            try:
                result = parse(reply)
            except (MeterReportedError, MeterLostError):
                self._n_due -= 1
                raise
            self._n_due -= 1
            return result

    def _reply(self, command: str, until_s: float) -> bytes:
        if not self.is_open:
            raise MeterError(f"{self._port}: the meter is not open", "call open(), or use it in a with statement")
        try:
            if self._other_due:
                self._settle(until_s)
            self._drain()
            allowed_s = min(self._timeout_s, until_s - self._clock.monotonic_s())
            if allowed_s <= 0:
                raise MeterTimeoutError(
                    f"{self._port}: earlier failures left no time for {command}", "check the cable, then repeat"
                )
            give_up_s = self._clock.monotonic_s() + allowed_s
            self._send(command)
            reply = self._read_line(give_up_s)
        except serial.SerialTimeoutException as error:
            self._n_due -= 1
            held = "the meter holds its RTS line low: check power, and RTS and CTS of the cable, or leave rtscts out"
            problem = held if self._serial_port.rtscts else "the port accepts no more data: check the adapter"
            raise MeterTimeoutError(f"{self._port}", f"{command} cannot be sent, {problem}") from error
        except (OSError, termios.error) as error:
            self._disconnect()
            raise MeterLostError(
                f"{self._port}: the connection to the meter broke ({error})",
                "check cable and adapter, then open the meter again",
            ) from error
        except (TypeError, AttributeError) as error:
            if self._serial is not None:
                raise
            raise MeterError(f"{self._port}: the meter was closed while it was asked", "open it again") from error
        self._require_whole(reply, command, allowed_s)
        return reply

    def _settle(self, until_s: float) -> None:
        """Drop the replies of earlier commands: those within a time-out, and all before that to setting a mode."""
        wait_s = min(until_s, self._due_until_s, self._clock.monotonic_s() + self._timeout_s)
        while self._n_due > 0 and self._clock.monotonic_s() < wait_s:
            self._n_due -= self._read_line(wait_s).endswith(self._protocol.reply_end)
        self._drain()
        if self._n_due > 0:
            give_up_s = min(until_s, self._clock.monotonic_s() + self._timeout_s)
            command = self._protocol.set_up[0]
            self._send(command)
            while not self._is_acknowledgement(reply := self._read_line(give_up_s)):
                self._require_whole(reply, command, self._timeout_s)
        self._n_due, self._other_due = 0, False

    def _is_acknowledgement(self, reply: bytes) -> bool:
        """Whether a whole reply is one to a command of the set-up."""
        try:
            self._protocol.parse_acknowledgement(reply)
        except (MeterReportedError, MeterProtocolError):
            return False
        return reply.endswith(self._protocol.reply_end)

    def _require_whole(self, reply: bytes, command: str, allowed_s: float) -> None:
        """Raise a specific error if the reply to a command does not end within the time allowed."""
        if reply.endswith(self._protocol.reply_end):
            return
        if len(reply) >= self._protocol.longest_reply:
            raise MeterProtocolError(
                f"{self._port}: {command} was answered with {reply!r} and no CR LF",
                "check that the meter is on this port",
            )
        if reply:
            raise MeterTimeoutError(
                f"{self._port}: the answer to {command} stopped after {len(reply)} bytes ({reply!r}) and did not "
                f"continue within {allowed_s:.3g} s",
                "check the cable, then repeat",
            )
        raise MeterTimeoutError(
            f"{self._port}: no answer to {command} within {allowed_s:.3g} s", self._protocol.silence_remedy
        )

    def _drain(self) -> None:
        """Clear both buffers."""
        data, came_s = b"", self._clock.monotonic_s()
        # A port of the network tells of one byte at a time.
        while len(data) < _MOST_DRAINED and (waiting := self._serial.in_waiting):
            data += self._serial.read(waiting)
        if data:
            self._record("received", data, came_s)
            self._n_due = max(0, self._n_due - data.count(self._protocol.reply_end))
        self._serial.reset_output_buffer()

    def _send(self, command: str) -> None:
        data = command.encode("ascii") + CRLF
        sent_s = self._clock.monotonic_s()
        # Whatever ends the exchange early, its reply stays pending.
        self._n_due += 1
        self._due_until_s = sent_s + 2 * self._timeout_s
        self._serial.write(data)
        self._record("sent", data, sent_s)

    def _read_line(self, until_s: float) -> bytes:
        """Read up to CR LF, or until the time-out."""
        line = bytearray()
        first_s = 0.0
        try:
            while True:
                byte: bytes = self._serial.read(1)
                if byte and not line:
                    first_s = self._clock.monotonic_s()
                line += byte
                if (
                    line.endswith(self._protocol.reply_end)
                    or len(line) >= self._protocol.longest_reply
                    or self._clock.monotonic_s() >= until_s
                ):
                    return bytes(line)
        finally:
            if line:
                self._record("received", bytes(line), first_s)

    def _record(self, direction: Any, data: bytes, at_s: float) -> None:
        _log.debug("%s: %s %r", self._port, direction, data)
        if self._transcript is not None:
            self._transcript.record(direction, data, at_s)

    def _disconnect(self) -> None:
        port, self._serial = self._serial, None
        if port is not None:
            with suppress(OSError, termios.error):  # close the port even if the cable was pulled
                # Bytes held back by RTS/CTS would delay closing and reach the meter at its next start.
                port.reset_output_buffer()
            port.close()
