import pytest

import labcdp
from labcdp.core.reading import MeterIdentity
from labcdp.drivers.simulated import PtyMeter, SimulatedLS


@pytest.mark.parametrize("model", ["LS-100", "LS-110"])
def test_open_meter(model):
    identity = MeterIdentity(model, "73323007", "2026-03-02", simulated=True)
    served = PtyMeter(SimulatedLS(lambda: 83.02), response_time_s=0)
    with served as pty, labcdp.drivers.open_meter(pty.port, model, identity) as meter:
        reading = meter.measure()
    assert (reading.luminance_cd_m2, reading.meter) == (pytest.approx(83.02), identity)
