"""The wire transcript: every byte between driver and meter, as JSON lines."""

import json

import pytest
import serial

from labcdp.core.errors import InputError
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.minolta_ls.port import NamedPort
from labcdp.drivers.simulated.meter import SimulatedLS
from labcdp.drivers.simulated.port import Fault
from labcdp.drivers.simulated.pty import PtyMeter

TIMEOUT_S = 0.4


def test_every_byte_is_written_as_it_happens_also_when_the_meter_is_opened_again(tmp_path):
    path = tmp_path / "wire.jsonl"
    with (
        PtyMeter(SimulatedLS(lambda: 83.02), response_time_s=0) as port,
        MinoltaLS110(NamedPort(port.port, True), timeout_s=TIMEOUT_S, transcript=path, patience_s=5) as meter,
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
