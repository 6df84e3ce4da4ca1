"""Two benches on one computer, at once."""

import numpy as np
import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera import CameraError
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.drivers.simulated.control import free_loopback_address


def test_two_cameras_and_two_meters_work_at_once_until_no_address_is_free(aravis, small_configuration):
    devices = BenchDevices.standard(seed=3)
    one, other = (SimulatedBench(small_configuration, devices.specimen(n), (400, 480)) for n in (0, 1))
    with one.gige_camera(free_loopback_address()) as first, one.pty_meter(0) as first_pty:
        with other.gige_camera(free_loopback_address()) as second, other.pty_meter(0) as second_pty:
            with pytest.raises(CameraError, match="ip addr add"):
                free_loopback_address()
            one.point_meter("upper left"), other.point_meter("P01")
            with (
                AravisCamera(first.address) as here,
                AravisCamera(second.address) as there,
                MinoltaLS110(first_pty.port) as this,
                MinoltaLS110(second_pty.port) as that,
            ):
                frames = zip(here.grab(10), there.grab(10), strict=True)
                assert all(len({a.camera.serial, b.camera.serial}) == 2 and np.any(a.dn != b.dn) for a, b in frames)
                for bench, meter in ((one, this), (other, that)):
                    true_cd_m2 = bench.luminance_cd_m2[bench.pointed_at]
                    assert meter.measure().luminance_cd_m2 == pytest.approx(1.006 * true_cd_m2, rel=0.02)
        assert free_loopback_address() == second.address
