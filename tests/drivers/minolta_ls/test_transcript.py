"""The wire transcript: every byte between driver and meter, as JSON lines."""

import json
from contextlib import contextmanager

import pytest
import serial

from labcdp.core.errors import InputError
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.minolta_ls.port import NamedPort
from labcdp.drivers.simulated.meter import SimulatedLS
from labcdp.drivers.simulated.port import Fault
from labcdp.drivers.simulated.pty import PtyMeter

TIMEOUT_S = 0.4


@contextmanager
def transcribed(path, rtscts=False, **options):
    with (
        PtyMeter(SimulatedLS(lambda: 83.02), response_time_s=0) as port,
        MinoltaLS110(NamedPort(port.port, rtscts), timeout_s=TIMEOUT_S, transcript=path, **options) as meter,
    ):
        yield port, meter


def test_every_byte_is_written_as_it_happens(tmp_path):
    path = tmp_path / "wire.jsonl"
    with transcribed(path, rtscts=True) as (port, meter):
        meter.measure()
        name = port.port
        header, *entries = map(json.loads, path.read_text().splitlines())
    settings = {"baudrate": 4800, "bytesize": 7, "parity": "E", "stopbits": 2, "rtscts": True, "timeout_s": TIMEOUT_S}
    assert header.items() >= {"format": 1, "meter": "LS-110", "port": name, **settings}.items()
    times = [entry.pop("t_s") for entry in entries]
    assert times == sorted(times)
    # After four modes with their answers.
    assert entries[8:] == [{"sent": "MES\r\n"}, {"received": "OK00,CcPH 83.02\r\n"}]


def test_a_transcript_continues_when_its_meter_is_opened_again_but_overwrites_no_file(tmp_path):
    path = tmp_path / "wire.jsonl"
    with transcribed(path, patience_s=5) as (port, meter):
        port.inject(Fault(n_bytes=7))
        meter.measure()
        meter.close()
        meter.open()
        port.unplug()
        port.plug_in()
        meter.measure()
    text = path.read_text()
    assert ('"received": "OK00,Cc"' in text, text.count("MDS,04"), text.count("format")) == (True, 4, 1)
    with PtyMeter(SimulatedLS(lambda: 1.0), response_time_s=0) as port:
        with pytest.raises(InputError, match=r"wire\.jsonl exists already: give the transcript another name"):
            MinoltaLS110(port.port, timeout_s=TIMEOUT_S, transcript=path).open()
        serial.Serial(port.port, exclusive=True).close()
    assert path.read_text() == text
