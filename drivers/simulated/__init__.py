"""The simulated bench: a camera and a meter on their real protocols that look at one simulated target."""

from .bench import BenchDevices, SimulatedBench
from .camera import SimulatedDevice, SimulatedGigECamera
from .in_process import InProcessCamera
from .meter import MeterErrorModel, SimulatedLS
from .meter_pty import Fault, PtyMeter

__all__ = [
    "BenchDevices",
    "Fault",
    "InProcessCamera",
    "MeterErrorModel",
    "PtyMeter",
    "SimulatedBench",
    "SimulatedDevice",
    "SimulatedGigECamera",
    "SimulatedLS",
]
