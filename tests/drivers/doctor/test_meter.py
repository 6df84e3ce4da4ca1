"""The meter's check on a pseudo-terminal: what it says of a good meter, and of each way not to work."""

import serial

from labcdp.drivers.doctor.meter import check_meter
from labcdp.drivers.simulated.pty import PtyMeter


class Scripted:
    """A meter that takes every mode and shows one thing; it is silent if it shows nothing."""

    def __init__(self, shown):
        self.shown = shown
        self.heard = []

    def answer(self, command):
        self.heard.append(command[:3])
        return b"OK00\r\n" if self.shown and command.startswith(b"MDS") else self.shown


def checked(engine, timeout_s=5.0):
    with PtyMeter(engine, response_time_s=0) as served:
        found = check_meter(served.port, timeout_s=timeout_s)
        # It is closed again: another program may have the port.
        serial.Serial(served.port, exclusive=True).close()
    return found


def test_a_meter_in_order():
    engine = Scripted(b"OK00,CcPH 83.02\r\n")
    assert {one.state for one in checked(engine)} == {"good"}
    # It changes nothing but modes, and does not measure: too dark a first reading can end remote mode.
    assert set(engine.heard) == {b"MDS", b"DSR"}


def test_a_meter_that_does_not_answer_and_a_port_that_another_program_uses():
    assert [one.state for one in checked(Scripted(b""), timeout_s=0.2)] == ["good", "fault"]
    with PtyMeter(Scripted(b"")) as served, serial.Serial(served.port, exclusive=True):
        _, in_use = check_meter(served.port, timeout_s=0.2)
    assert str(in_use).endswith("another program uses it: end that program")
