"""The simulated bench: camera and meter with real protocols that view one simulated target."""

from .bench import SimulatedBench
from .devices import BenchDevices, SimulatedBenchFile
from .faults.schedule_file import parse_command, parse_schedule
from .faults.trouble import CameraTrouble
from .gige.camera import SimulatedGigECamera
from .gige.device import SimulatedDevice
from .in_process import InProcessCamera
from .meter.in_process import InProcessPort
from .meter.meter import MeterErrorModel, SimulatedLS
from .meter.pty import PtyMeter
from .meter.replies import Fault

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
