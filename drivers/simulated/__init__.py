"""The simulated bench: camera and meter with real protocols that view one simulated target."""

from .bench import SimulatedBench
from .devices import SimulatedBenchFile, SimulatedDevices
from .gige_camera import SimulatedDevice, SimulatedGigECamera
from .in_process import InProcessCamera
from .meter import SimulatedLS
from .pty import PtyMeter
from .shutter import SimulatedShutter

__all__ = [
    "InProcessCamera",
    "PtyMeter",
    "SimulatedBench",
    "SimulatedBenchFile",
    "SimulatedDevice",
    "SimulatedDevices",
    "SimulatedGigECamera",
    "SimulatedLS",
    "SimulatedShutter",
]
