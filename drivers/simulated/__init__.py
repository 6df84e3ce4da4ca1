"""The simulated bench: camera and meter with real protocols that view one simulated target."""

from .bench import SimulatedBench
from .devices import BenchDevices, SimulatedBenchFile
from .gige_camera import SimulatedDevice, SimulatedGigECamera
from .in_process import InProcessCamera
from .meter import SimulatedLS
from .pty import PtyMeter

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
