"""The simulated bench: camera and meter with real protocols that view one simulated target."""

from .bench import SimulatedBench
from .commands import parse_command, parse_schedule
from .devices import BenchDevices, SimulatedBenchFile
from .gige.camera import SimulatedGigECamera
from .gige.device import SimulatedDevice
from .in_process import InProcessCamera
from .link import CameraTrouble
from .meter.meter import MeterErrorModel, SimulatedLS
from .meter.port import Fault, InProcessPort
from .meter.pty import PtyMeter

__all__ = [
    "BenchDevices",
    "CameraTrouble",
    "Fault",
    "InProcessCamera",
    "InProcessPort",
    "MeterErrorModel",
    "PtyMeter",
    "SimulatedBench",
    "SimulatedBenchFile",
    "SimulatedDevice",
    "SimulatedGigECamera",
    "SimulatedLS",
    "parse_command",
    "parse_schedule",
]
