"""A luminance meter in this process, without a port, timed by any clock."""

from __future__ import annotations

from collections import deque
from typing import Final, Self

from ....core.clock import Clock
from ....core.reading import MeterIdentity, Reading
from ...device import Device
from ...meter import MeterError, MeterIncident, MeterLostError, MeterNotFoundError, MeterTimeoutError
from ...minolta_ls.protocol import LSDataSheet, parse_reading
from .meter import Fault, SimulatedLS

_CRLF: Final = b"\r\n"


class InProcessMeter(Device):
    """The simulated LS-100 or LS-110 with the meter protocol, without a port.

    Parameters
    ----------
    engine : SimulatedLS
        The meter.
    data_sheet : LSDataSheet
        Its model.
    identity : MeterIdentity
        Identity in the readings.
    clock : Clock
        Clock of its readings.
    response_time_s : float
        Time a reading takes.
    timeout_s : float
        Longest wait for a reply.
    """

    def __init__(
        self,
        engine: SimulatedLS,
        data_sheet: LSDataSheet,
        identity: MeterIdentity,
        clock: Clock,
        *,
        response_time_s: float = 0.8,
        timeout_s: float = 6.0,
    ) -> None:
        self._engine = engine
        self._data_sheet = data_sheet
        self._identity = identity
        self._clock = clock
        self._response_time_s = response_time_s
        self._timeout_s = timeout_s
        self._faults: deque[Fault] = deque()
        self._plugged = True
        self._open = False

    def open(self) -> Self:
        """Connect and check that the meter answers.

        Raises
        ------
        MeterNotFoundError
            If it is unplugged.
        MeterTimeoutError
            If it is not in remote mode.
        """
        if not self._open:
            if not self._plugged:
                raise MeterNotFoundError("the simulated meter is unplugged: plug it in")
            self._exchange(b"MDS,04\r\n", 0.0)
            self._open = True
        return self

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._open = False

    @property
    def identity(self) -> MeterIdentity:
        """Model, serial number and calibration date, as given."""
        return self._identity

    def inject(self, *faults: Fault) -> None:
        """Queue faults, one for each of the next replies."""
        self._faults.extend(faults)

    def recover(self) -> None:
        """Forget the faults that are queued."""
        self._faults.clear()

    def unplug(self) -> None:
        """Pull the cable."""
        self._plugged = False

    def plug_in(self) -> None:
        """Reconnect the cable."""
        self._plugged = True

    @property
    def incidents(self) -> tuple[MeterIncident, ...]:
        """None: it does not recover."""
        return ()

    def measure(self) -> Reading:
        """Take one reading; fails like the meter on a port.

        Raises
        ------
        MeterReportedError, MeterProtocolError
            If the answer is an error code or not a reading.
        MeterTimeoutError
            If it does not answer in time or completely.
        MeterLostError
            If the cable is pulled.
        MeterError
            If the meter is not open.
        """
        if not self._open:
            raise MeterError("the simulated meter is not open: call open(), or use it in a with statement")
        reply = self._exchange(b"MES\r\n", self._response_time_s)
        return parse_reading(reply, self._data_sheet, self._identity, self._clock.now())

    def _exchange(self, command: bytes, takes_s: float) -> bytes:
        """Return a complete reply after its duration."""
        self._require_cable()
        answer = self._engine.answer(command)
        fault = self._faults.popleft() if answer and self._faults else Fault()
        reply = fault.applied_to(answer)
        in_time = takes_s + fault.delay_s <= self._timeout_s
        self._clock.sleep(takes_s + fault.delay_s if in_time and reply.endswith(_CRLF) else self._timeout_s)
        self._require_cable()
        name = command.removesuffix(_CRLF).decode()
        if not (in_time and reply):
            raise MeterTimeoutError(
                f"no answer to {name} within {self._timeout_s:g} s: check that the simulated meter is in remote mode"
            )
        if not reply.endswith(_CRLF):
            raise MeterTimeoutError(
                f"the answer to {name} stopped after {len(reply)} bytes ({reply!r}): repeat the reading"
            )
        return reply

    def _require_cable(self) -> None:
        if not self._plugged:
            raise MeterLostError("the connection to the simulated meter broke: plug it in and open it again")
