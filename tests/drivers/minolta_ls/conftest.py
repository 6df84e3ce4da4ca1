"""One meter on two kinds of port: a pseudo-terminal, and one in this process whose virtual clock makes no test wait."""

import threading
import time
from contextlib import contextmanager
from datetime import UTC, datetime

import pytest

from labcdp.core.clock import SimulatedClock
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.port import InProcessPort
from labcdp.drivers.simulated.pty import PtyMeter

#: Short for a test, long for two threads on one machine.
TIMEOUT_S = 0.4


class OnPty:
    """Serves engines on a pseudo-terminal."""

    sleep = staticmethod(time.sleep)

    @contextmanager
    def serve(self, engine):
        with PtyMeter(engine, response_time_s=0) as port:
            yield port, port.port

    @contextmanager
    def later(self, delay_s, action):
        """Do something after a while, which is over at the end of the context."""
        timer = threading.Timer(delay_s, action)
        timer.start()
        yield
        timer.join()


class InThisProcess:
    """Serves engines on a port in this process."""

    def __init__(self):
        self._clock = SimulatedClock(datetime.now(UTC))
        self.sleep = self._clock.sleep

    @contextmanager
    def serve(self, engine):
        port = InProcessPort(engine, self._clock, 0)
        yield port, port

    @contextmanager
    def later(self, delay_s, action):
        self._clock.call_at(self._clock.monotonic_s() + delay_s, action)
        yield


@pytest.fixture(params=[OnPty, InThisProcess], ids=["pseudo-terminal", "in process"])
def transport(request):
    return request.param()


@pytest.fixture
def opened(transport):
    """Serve an engine and open a driver on it; gives both the port and the driver."""

    @contextmanager
    def open_on(engine, *identity, **options):
        with (
            transport.serve(engine) as (port, place),
            MinoltaLS110(place, *identity, **({"timeout_s": TIMEOUT_S} | options)) as meter,
        ):
            yield port, meter

    return open_on
