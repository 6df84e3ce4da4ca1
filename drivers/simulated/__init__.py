"""The simulated bench: camera and meter with real protocols that view one simulated target."""

from .bench import SimulatedBench
from .devices import BenchDevices, SimulatedBenchFile
from .gige.camera import SimulatedDevice, SimulatedGigECamera
from .in_process import InProcessCamera
from .meter.meter import SimulatedLS
from .meter.pty import PtyMeter

__all__ = [
    "BenchDevices",
    "InProcessCamera",
    "PtyMeter",
    "SimulatedBench",
    "SimulatedBenchFile",
    "SimulatedDevice",
    "SimulatedGigECamera",
    "SimulatedLS",
]
