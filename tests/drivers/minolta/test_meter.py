"""The LS-100/LS-110 driver: what goes over the wire, what goes wrong there, and how it recovers."""

import json
import os
import termios
import threading
from contextlib import contextmanager, suppress
from datetime import UTC, datetime

import pytest
import serial

from labcdp.core.clock import SimulatedClock
from labcdp.core.errors import InputError
from labcdp.core.reading import SERIAL_MODELS, MeterIdentity
from labcdp.drivers.meter import MeterLostError, MeterProtocolError, MeterReportedError, MeterTimeoutError
from labcdp.drivers.minolta.ls import MinoltaLS110
from labcdp.drivers.minolta.models import DRIVERS
from labcdp.drivers.minolta.port import NamedPort
from labcdp.drivers.minolta.protocol import ERROR_CODES, MeterMode
from labcdp.drivers.simulated.meter import SimulatedLS
from labcdp.drivers.simulated.port import Fault, InProcessPort
from labcdp.drivers.simulated.pty import PtyMeter

#: For a test that waits for it, and for one that does not, however late threads come to run.
TIMEOUT_S, LONG_S = 2.0, 60.0
METER = MeterIdentity("LS-110", "73323007", "2018-03-01")


class Engine(SimulatedLS):
    """A meter whose luminance grows by 1 cd/m^2 with each measurement, and which keeps its commands."""

    def __init__(self, **options):
        values = iter(range(1, 1000))
        super().__init__(lambda: next(values), **options)
        self.commands = []

    def answer(self, command):
        self.commands.append(command.decode().strip())
        return super().answer(command)


@contextmanager
def asked(*identity, **options):
    """A driver on a new engine: gives engine, port and driver."""
    engine = Engine()
    with (
        PtyMeter(engine, response_time_s=0) as port,
        MinoltaLS110(port.port, *identity, timeout_s=LONG_S, **options) as meter,
    ):
        yield engine, port, meter


@contextmanager
def later(delay_s, action):
    """Do something after a while, which is over at the end of the context."""
    timer = threading.Timer(delay_s, action)
    timer.start()
    yield
    timer.join()


@pytest.mark.parametrize("mode", [None, *MeterMode])
def test_opening_sets_one_mode_of_each_group(mode):
    with asked(modes=[] if mode is None else [mode]) as (engine, _, meter):
        assert [f"MDS,{each.value}" for each in meter.modes] == engine.commands
    others = {"MDS,00", "MDS,04", "MDS,06", "MDS,09"}
    assert len(engine.commands) == 4
    assert set(engine.commands) - others == ({f"MDS,{mode.value}"} - others if mode else set())


def test_measure_and_held_value():
    with asked(METER) as (engine, _, meter):
        reading, held = meter.measure(), meter.read_held()
    assert engine.commands[4:] == ["MES", "DSR"]
    assert reading.luminance_cd_m2 == held.luminance_cd_m2 == 1.0
    assert reading.meter == METER
    assert (datetime.now(UTC) - reading.timestamp).total_seconds() < 60


@pytest.mark.parametrize(
    ("rtscts", "problem"),
    [(True, "its RTS line low: check power, and RTS and CTS of the cable"), (False, "the adapter")],
)
def test_a_port_that_takes_nothing_is_explained_by_its_handshake(rtscts, problem):
    with (
        PtyMeter(Engine(), response_time_s=0) as served,
        MinoltaLS110(NamedPort(served.port, rtscts), timeout_s=TIMEOUT_S) as meter,
        open(served.port, "rb", 0) as port,
    ):
        assert bool(termios.tcgetattr(port)[2] & termios.CRTSCTS) == rtscts
        termios.tcflow(port, termios.TCOOFF)
        with pytest.raises(MeterTimeoutError, match=f"MES cannot be sent, .*{problem}"):
            meter.measure()
        termios.tcflow(port, termios.TCOON)
        # Nothing that was held back has come through.
        assert meter.measure().value == 1.0


def test_a_pseudo_terminal_as_of_socat_serves_one_program_after_another():
    _, slave = os.openpty()
    for _ in range(3):
        NamedPort(os.ttyname(slave)).connect(0.1, 0.1).close()


# When it goes wrong


@pytest.mark.parametrize("attempts", [1, 3])
@pytest.mark.parametrize(
    ("fault", "error"),
    [
        *((Fault(delay_s=delay_s), MeterTimeoutError) for delay_s in (1.5 * TIMEOUT_S, 2.2 * TIMEOUT_S)),
        *((fault, MeterTimeoutError) for fault in (Fault(reply=b""), Fault(n_bytes=1), Fault(n_bytes=16))),
        # Garbage, and no end.
        *((Fault(reply=reply), MeterProtocolError) for reply in (b"\x00?!\r\n", b"U" * 100)),
    ],
)
def test_a_reading_is_of_a_command_of_its_own_call_whatever_came_before(fault, error, attempts):
    port = InProcessPort(engine := Engine(), SimulatedClock(), 0)
    with MinoltaLS110(port, timeout_s=TIMEOUT_S, attempts=attempts) as meter:
        port.inject(fault)
        failed = []
        for _ in range(5):
            before = engine.commands.count("MES")
            try:
                value = meter.measure().value
                assert before < value <= engine.commands.count("MES")
            except (MeterTimeoutError, MeterProtocolError) as raised:
                failed.append(type(raised))
        assert failed[:1] == ([error] if attempts == 1 else [])
        assert meter.incidents[0].kind == ("error" if attempts == 1 else "asked again")


@pytest.mark.parametrize("code", ERROR_CODES)
def test_codes_that_repeat_themselves_are_not_asked_for_again(code):
    with asked(attempts=3) as (engine, port, meter):
        port.inject(Fault(reply=code.encode() + b"\r\n"))
        with suppress(MeterReportedError):
            # ER00 says that the command did not arrive as it was sent.
            assert meter.measure().value == 2.0
        assert engine.commands.count("MES") == 1 + (code == "ER00")


def test_an_interrupted_measurement_does_not_answer_the_next_one(monkeypatch):
    def interrupt(_n):
        raise KeyboardInterrupt

    port = InProcessPort(Engine(), SimulatedClock(), 0)
    with MinoltaLS110(port) as meter:
        monkeypatch.setattr(port, "read", interrupt)
        with pytest.raises(KeyboardInterrupt):
            meter.measure()
        monkeypatch.undo()
        assert meter.measure().value == 2.0


# A meter that is gone


def test_a_pulled_cable_is_waited_for_and_the_modes_restored():
    with asked(patience_s=LONG_S, modes=[MeterMode.SLOW]) as (engine, port, meter):
        assert meter.measure().value == 1.0
        port.unplug()
        for command in (b"MDS,06\r\n", b"MDS,08\r\n"):
            engine.answer(command)
        engine.commands.clear()
        with later(0.5, port.plug_in):
            reading = meter.measure()
        assert (reading.value, reading.peak) == (2.0, False)
        assert engine.commands == ["MDS,00", "MDS,04", "MDS,07", "MDS,09", "MES"]
        assert [incident.kind for incident in meter.incidents] == ["lost and back"]


def test_a_cable_that_stays_pulled_ends_in_one_error_that_names_both_problems():
    before = len(os.listdir("/proc/self/fd"))
    with asked(patience_s=0.5, attempts=2) as (_, port, meter):
        port.unplug()
        with pytest.raises(MeterLostError, match=r"connection .* broke .*not come back within 0\.5 s, last: .*no such"):
            meter.measure()
        assert meter.modes == ()
    assert len(os.listdir("/proc/self/fd")) <= before


# Its transcript, in JSON lines


def test_every_byte_is_written_as_it_happens_also_when_the_meter_is_opened_again(tmp_path):
    path = tmp_path / "wire.jsonl"
    with (
        PtyMeter(SimulatedLS(lambda: 83.02), response_time_s=0) as port,
        MinoltaLS110(NamedPort(port.port, True), timeout_s=TIMEOUT_S, transcript=path, patience_s=LONG_S) as meter,
    ):
        meter.measure()
        name = port.port
        header, *entries = map(json.loads, path.read_text().splitlines())
        port.inject(Fault(n_bytes=7))
        meter.measure()
        meter.close()
        meter.open()
        port.unplug()
        port.plug_in()
        meter.measure()
    settings = {"baudrate": 4800, "bytesize": 7, "parity": "E", "stopbits": 2, "rtscts": True, "timeout_s": TIMEOUT_S}
    assert header.items() >= {"format": 1, "meter": "LS-110", "port": name, **settings}.items()
    times = [entry.pop("t_s") for entry in entries]
    assert times == sorted(times)
    # After four modes with their answers.
    assert entries[8:] == [{"sent": "MES\r\n"}, {"received": "OK00,CcPH 83.02\r\n"}]

    text = path.read_text()
    assert ('"received": "OK00,Cc"' in text, text.count("MDS,04"), text.count("format")) == (True, 4, 1)
    with PtyMeter(SimulatedLS(lambda: 1.0), response_time_s=0) as port:
        with pytest.raises(InputError, match=r"wire\.jsonl exists already: give the transcript another name"):
            MinoltaLS110(port.port, timeout_s=TIMEOUT_S, transcript=path).open()
        serial.Serial(port.port, exclusive=True).close()
    assert path.read_text() == text


def test_each_model_has_a_driver():
    assert {name: driver.data_sheet.model for name, driver in DRIVERS.items()} == {name: name for name in SERIAL_MODELS}
