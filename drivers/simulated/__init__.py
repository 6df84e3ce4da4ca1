"""The simulated bench: a camera and a meter on their real protocols that look at one simulated target."""

from .bench import BenchDevices, SimulatedBench
from .camera import SimulatedGigECamera
from .device import SimulatedDevice
from .faults import parse_command, parse_schedule
from .in_process import InProcessCamera
from .in_process_meter import InProcessMeter
from .meter import MeterErrorModel, SimulatedLS
from .meter_pty import Fault, PtyMeter
from .trouble import CameraTrouble

__all__ = [
    "BenchDevices",
    "CameraTrouble",
    "Fault",
    "InProcessCamera",
    "InProcessMeter",
    "MeterErrorModel",
    "PtyMeter",
    "SimulatedBench",
    "SimulatedDevice",
    "SimulatedGigECamera",
    "SimulatedLS",
    "parse_command",
    "parse_schedule",
]
