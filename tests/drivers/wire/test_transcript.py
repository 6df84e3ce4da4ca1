"""The wire transcript: every byte between driver and meter, as JSON lines."""

import json
import logging
import time
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from importlib.metadata import version

import pytest
import serial

from labcdp.core.errors import InputError
from labcdp.drivers.minolta_ls.line import NamedPort
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.meter import Fault, SimulatedLS
from labcdp.drivers.simulated.pty import PtyMeter

TIMEOUT_S = 0.4
OPENING = [
    *(("sent", b"MDS,00\r\n"), ("received", b"OK00\r\n"), ("sent", b"MDS,04\r\n"), ("received", b"OK00\r\n")),
    *(("sent", b"MDS,06\r\n"), ("received", b"OK00\r\n"), ("sent", b"MDS,09\r\n"), ("received", b"OK00\r\n")),
]


@contextmanager
def opened(path, rtscts=False, **options):
    with (
        PtyMeter(SimulatedLS(lambda: 83.02), response_time_s=0) as port,
        MinoltaLS110(NamedPort(port.port, rtscts), timeout_s=TIMEOUT_S, transcript=path, **options) as meter,
    ):
        yield port, meter


def lines_of(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def wire(path):
    return [
        (way, text.encode("latin-1")) for entry in lines_of(path)[1:] for way, text in entry.items() if way != "t_s"
    ]


def test_every_byte_is_written_as_it_happens(tmp_path):
    path = tmp_path / "wire.jsonl"
    before = datetime.now(UTC)
    with opened(path, rtscts=True) as (port, meter):
        assert wire(path) == OPENING
        meter.measure()
        assert wire(path)[8:] == [("sent", b"MES\r\n"), ("received", b"OK00,CcPH 83.02\r\n")]
        name = port.port
    header, *entries = lines_of(path)
    assert before <= datetime.fromisoformat(header.pop("started")) <= datetime.now(UTC)
    assert header == {
        "format": 1,
        "meter": "LS-110",
        "port": name,
        "timeout_s": TIMEOUT_S,
        "labcdp": version("labcdp"),
        "baudrate": 4800,
        "bytesize": 7,
        "parity": "E",
        "stopbits": 2,
        "rtscts": True,
    }
    times = [entry["t_s"] for entry in entries]
    assert times == sorted(times)


def test_silence_late_cut_and_unasked_bytes_are_written(tmp_path):
    path = tmp_path / "wire.jsonl"
    with opened(path) as (port, meter):
        # A mode is set where a reply is missing.
        silent, cut, late = Fault(reply=b""), Fault(n_bytes=7), Fault(delay_s=1.5 * TIMEOUT_S)
        port.inject(silent, Fault(), cut, Fault(), late, Fault(reply=b"\xff?\r\nOK00\r\n"))
        for _ in range(4):
            with suppress(Exception):
                meter.measure()
        # Unexpected bytes are read from the port with the next command.
        time.sleep(0.1)
        meter.measure()
    assert wire(path)[8:] == [
        ("sent", b"MES\r\n"),
        ("sent", b"MDS,00\r\n"),
        ("received", b"OK00\r\n"),
        ("sent", b"MES\r\n"),
        ("received", b"OK00,Cc"),
        ("sent", b"MDS,00\r\n"),
        ("received", b"OK00\r\n"),
        ("sent", b"MES\r\n"),
        ("received", b"OK00,CcPH 83.02\r\n"),
        ("sent", b"MES\r\n"),
        ("received", b"\xff?\r\n"),
        ("received", b"OK00\r\n"),
        ("sent", b"MES\r\n"),
        ("received", b"OK00,CcPH 83.02\r\n"),
    ]
    asked, late = lines_of(path)[16:18]
    assert late["t_s"] - asked["t_s"] > TIMEOUT_S


def test_a_transcript_continues_when_its_meter_is_opened_again(tmp_path):
    path = tmp_path / "wire.jsonl"
    with opened(path, patience_s=5) as (port, meter):
        meter.close()
        meter.open()
        port.unplug()
        port.plug_in()
        meter.measure()
    assert wire(path)[:24] == 3 * OPENING
    assert path.read_text().count("format") == 1


def test_an_existing_file_is_not_overwritten_and_the_port_is_free(tmp_path):
    path = tmp_path / "wire.jsonl"
    path.write_text("mine")
    with PtyMeter(SimulatedLS(lambda: 1.0), response_time_s=0) as port:
        with pytest.raises(InputError, match=r"wire\.jsonl exists already: give the transcript another name"):
            MinoltaLS110(port.port, timeout_s=TIMEOUT_S, transcript=path).open()
        serial.Serial(port.port, exclusive=True).close()
    assert path.read_text() == "mine"


def test_a_full_disk_ends_the_transcript_and_not_the_readings(caplog):
    with PtyMeter(SimulatedLS(lambda: 83.02), response_time_s=0) as port:
        meter = MinoltaLS110(port.port, timeout_s=TIMEOUT_S, transcript="/dev/full")
        # The device exists before the driver does, as no transcript may.
        meter._line._transcript._started_s = 0.0
        with meter, caplog.at_level(logging.WARNING):
            assert meter.measure().value == 83.02
    assert [record.getMessage() for record in caplog.records] == [
        "/dev/full cannot be written (No space left on device): the transcript ends here"
    ]


def test_a_transcript_that_cannot_continue_is_not_a_reason_to_lose_the_meter(tmp_path, caplog):
    folder = tmp_path / "wires"
    folder.mkdir()
    with opened(folder / "wire.jsonl", patience_s=5) as (port, meter):
        port.unplug()
        port.plug_in()
        (folder / "wire.jsonl").unlink()
        folder.rmdir()
        assert meter.measure().value == 83.02
    assert "wire.jsonl cannot be written (No such file or directory): the transcript ends here" in caplog.text
