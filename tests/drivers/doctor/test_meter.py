"""The meter's check on a pseudo-terminal: what it says of a good meter, and of each way not to work."""

import pytest
import serial

from labcdp.drivers.doctor.meter import check_meter
from labcdp.drivers.simulated.pty import PtyMeter

#: Seconds to wait for an answer; a pseudo-terminal answers at once.
SOON_S = 5.0
#: The same for one that stays silent.
SILENT_S = 0.2


class Scripted:
    """A meter that takes every mode and shows one thing."""

    def __init__(self, shown):
        self.shown = shown
        self.heard = []

    def answer(self, command):
        self.heard.append(command)
        return b"OK00\r\n" if command.startswith(b"MDS") else self.shown


def checked(shown, timeout_s=SOON_S, **options):
    engine = Scripted(shown)
    with PtyMeter(engine, response_time_s=0) as served:
        found = check_meter(served.port, timeout_s=timeout_s, **options)
        # It is closed again: another program may have the port.
        serial.Serial(served.port, exclusive=True).close()
    return found, engine


def test_a_meter_in_order():
    found, engine = checked(b"OK00,CcPH 83.02\r\n")
    assert [one.state for one in found] == ["good"] * 3
    assert [one.topic for one in found][1:] == ["meter", "unit"]
    assert found[1].cause == "it answers, and took PRESET, ABS, FAST and CONT (as LS-110)"
    assert found[2].cause == "cd/m^2; it shows 83.02"
    # It changes nothing but modes, and does not measure: too dark a first reading can end remote mode.
    assert {command[:3] for command in engine.heard} == {b"MDS", b"DSR"}
    assert checked(b"OK00,CcPH 83.02\r\n", model="LS-100")[0][1].cause.endswith("(as LS-100)")


@pytest.mark.parametrize(
    ("shown", "state", "cause"),
    [
        (b"OK00,CfPH 100.0", "notice", "the meter is set to fL; it shows 100 fL, which is 342.626 cd/m^2"),
        (b"OK00,C% H 100.0", "notice", "the meter shows a ratio in %"),
        (b"ER11", "unknown", "the meter holds no reading, which would tell its unit"),
        *((code, "fault", code.decode()) for code in (b"ER20", b"ER30")),
        (b"ER19", "notice", "ER19"),
    ],
)
def test_what_the_display_says_and_what_to_do(shown, state, cause):
    found, _ = checked(shown + b"\r\n")
    assert (found[-1].topic, found[-1].state) == ("unit", state)
    assert cause in found[-1].cause
    assert found[-1].remedy


def test_a_meter_that_does_not_answer():
    class Silent:
        def answer(self, command):
            del command
            return b""

    with PtyMeter(Silent()) as served:
        found = check_meter(served.port, timeout_s=SILENT_S)
    assert [one.state for one in found] == ["good", "fault"]
    assert "no answer to MDS" in found[1].cause
    assert found[1].remedy == (
        "switch the meter off, hold F while switching it on so that it shows C, and check the cable LS-A12"
    )


def test_a_port_that_another_program_uses():
    with PtyMeter(Scripted(b"")) as served, serial.Serial(served.port, exclusive=True):
        found = check_meter(served.port, timeout_s=SILENT_S)
    assert [one.state for one in found] == ["good", "fault"]
    assert "another program uses it" in found[1].cause
    assert found[1].remedy == "end that program"
