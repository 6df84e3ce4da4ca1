"""Readings in a mode that was not asked for are used by no command that takes readings."""

from contextlib import ExitStack

import numpy as np
import pytest

from labcdp.cli.bench.connected import serial_meter
from labcdp.cli.bench.options import DeviceOptions
from labcdp.core.luminance import LuminanceMap
from labcdp.drivers.simulated import PtyMeter, SimulatedLS
from labcdp.session import Session, SessionConfiguration
from labcdp.web.bench.day_log import DayLog
from labcdp.web.bench.desk import MeterDesk
from labcdp.web.regions.page_image import PageImage

from .conftest import plan, rows_of


class Keyed(SimulatedLS):
    """A meter whose keys were used: what it measures has other flags of peak, unit and correction (the manual)."""

    flags = ""

    def answer(self, command):
        reply = super().answer(command)
        shown = reply.startswith(b"OK00,") and self.flags
        return reply[:5] + self.flags.encode() + reply[8:] if shown else reply


@pytest.fixture(scope="module")
def keyed():
    engine = Keyed(lambda: 83.02)
    with PtyMeter(engine, response_time_s=0.0) as served:
        engine.port = served.port
        yield engine


def by_meter(meter, labcdp, _tmp_path, _stack):
    done = labcdp("meter", "--meter", meter.port, "-n", "1")
    return done.returncode == 0, done.stderr


def by_doctor(meter, labcdp, _tmp_path, _stack):
    labcdp("meter", "--meter", meter.port, "-n", "1")  # the doctor looks at the display
    done = labcdp("doctor", "--meter", meter.port, "--json")
    of_meter = [row for row in rows_of(done, "checks") if row["group"].startswith("Luminance meter")]
    return {row["state"] for row in of_meter} == {"good"}, done.stdout


def by_acquire(meter, labcdp, tmp_path, _stack):
    (tmp_path / "plan.toml").write_text(plan("P12", [0.002]))
    done = labcdp("acquire", "plan.toml", "own", "--meter", meter.port, stdin="\n\n\n\n")
    with Session.open(tmp_path / "own") as session:
        return bool(session.readings()), done.stderr


def by_bench(meter, _labcdp, tmp_path, stack):
    nothing = LuminanceMap(np.zeros((4, 4)), np.zeros((4, 4)), (), np.zeros((4, 4), np.uint8))
    image = PageImage("live", np.zeros((4, 4), np.uint16), True, None, nothing, "relative")
    described = SessionConfiguration.from_toml(plan("P12", [0.002]), "plan").meter
    opened = serial_meter(stack, described, meter.port, DeviceOptions(patience=0.0))
    desk = MeterDesk(opened, None, lambda: (image, ()), lambda: False, DayLog(tmp_path / "bench.rois.json"))
    said = "".join(desk.take(opened, "", 1))
    return bool(desk.log.readings), said


@pytest.fixture
def stack():
    with ExitStack() as stack:
        yield stack


@pytest.mark.parametrize("command", [by_meter, by_doctor, by_acquire, by_bench])
@pytest.mark.parametrize("flags", ["CcP", "PcP", "CcL", "CcK", "PcT", "C% "])
def test_a_reading_in_another_mode_is_used_by_no_command(command, flags, keyed, labcdp, running_bench, tmp_path, stack):
    keyed.flags = flags
    used, said = command(keyed, labcdp, tmp_path, stack)
    assert used == (flags == "CcP"), said
    assert used or "the reading is not used" in said or "the meter shows a ratio" in said
