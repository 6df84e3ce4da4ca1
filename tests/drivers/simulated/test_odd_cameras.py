"""Simulated cameras with odd names and odd sizes."""

from xml.etree import ElementTree

import numpy as np
import pytest

from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.simulated.genicam import description, standard_features
from labcdp.drivers.simulated.gige_camera import SimulatedDevice, SimulatedGigECamera

from ..conftest import Ramp


@pytest.mark.parametrize("name", ["A & B <x>", "Acme \"q\" 'z'", "Größe ]]> 100 %"])
def test_any_vendor_and_model_is_one(aravis, name):
    root = ElementTree.fromstring(description(name, f"{name} 1", standard_features()))
    assert root.attrib["VendorName"] == name.replace(" ", "")
    if not name.isascii():
        return
    device = SimulatedDevice("SIM-1", vendor=name, model="M<&>", width=64, height=48, frame_rate_hz=50)
    with SimulatedGigECamera(device, Ramp()), AravisCamera("127.0.0.1") as camera:
        assert (camera.identity.vendor, camera.identity.model) == (name, "M<&>")
        assert camera.snap().shape == (48, 64)


@pytest.mark.parametrize(("width", "height"), [(63, 47), (64, 47), (63, 48), (251, 203)])
def test_odd_sizes_in_all_formats(aravis, width, height):
    device = SimulatedDevice("SIM-1", width=width, height=height, frame_rate_hz=50)
    with SimulatedGigECamera(device, Ramp((height, width))), AravisCamera("127.0.0.1") as camera:
        for pixel_format in ("Mono8", "Mono12", "Mono16", "Mono12Packed"):
            camera.configure(pixel_format=pixel_format)
            frame = camera.snap()
            assert frame.shape == (height, width)
            assert np.array_equal(frame.dn[1], np.arange(width) * (16 if pixel_format == "Mono16" else 1)
                                  // (16 if pixel_format == "Mono8" else 1))  # fmt: skip
