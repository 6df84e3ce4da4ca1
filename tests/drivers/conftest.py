"""A simulated GigE Vision camera on loopback."""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.simulated.genicam import standard_features
from labcdp.drivers.simulated.gige_camera import SimulatedDevice, SimulatedGigECamera
from labcdp.drivers.simulated.noise import running


class Ramp:
    """Frames whose pixels tell exposure, gain and number, on top of a ramp along the rows."""

    def __init__(self, shape=(48, 64)):
        self.state = 0
        self.shape = shape
        self._keys = running()

    def next_key(self):
        return next(self._keys)

    def expose(self, exposure_s, gain_db, key):
        dn = np.zeros(self.shape, dtype=np.uint16) + np.arange(self.shape[1], dtype=np.uint16)
        dn[0, :3] = round(exposure_s * 1e6) % 4096, round(gain_db * 10), key[0] % 4096
        return dn


SMALL = SimulatedDevice("SIM-1", width=64, height=48, black_level_dn=7, temperature_c=31.5, frame_rate_hz=50)


def features(*without, **changed):
    """The features of the simulated camera without some, and with other properties or more of them."""
    table = {
        category: {name: changed.pop(name, values) for name, values in of_category.items() if name not in without}
        for category, of_category in standard_features().items()
    }
    return table | {"AnalogControl": table["AnalogControl"] | changed}


@contextmanager
def opened(**device):
    """The driver of a small camera with other properties."""
    with SimulatedGigECamera(replace(SMALL, **device), Ramp()), AravisCamera("127.0.0.1") as camera:
        yield camera


@pytest.fixture
def camera_on_loopback(aravis):
    with SimulatedGigECamera(SMALL, Ramp()) as camera:
        yield camera


@pytest.fixture(params=["prosilica"])
def camera(aravis, request):
    """The driver of a small camera; parametrize indirectly with the naming of its features."""
    with opened(features=standard_features(request.param)) as camera:
        yield camera
