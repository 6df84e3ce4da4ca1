"""The simulated meter on a pseudo-terminal, with any serial program, and its faults."""

import pytest

from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.meter import SimulatedLS
from labcdp.drivers.simulated.pty import PtyMeter


class Real(SimulatedLS):
    """The manual knows no such command."""

    def answer(self, command):
        return super().answer(command.replace(b"SIM", b"???"))


@pytest.mark.parametrize(("kind", "simulated"), [(SimulatedLS, True), (Real, False)])
def test_a_simulated_meter_says_so_and_a_real_one_behind_a_pseudo_terminal_does_not(kind, simulated):
    with PtyMeter(kind(lambda: 83.02), response_time_s=0) as served, MinoltaLS110(served.port) as driver:
        assert driver.ask_if_simulated() is simulated
        assert driver.measure().meter.simulated is simulated
