"""Acquisition: record the frames and readings of a plan, and resume it after an interruption."""

from .checks import CheckFinding
from .control import AcquisitionStoppedError, Announced, Control, Progress
from .live import LiveStatistics, PatchNumbers
from .operator import AskedOperator, HandNeededError, Operator, ShutterOperator, Unattended
from .plan import forget, remaining, repeated_units
from .run import Left, acquire, is_complete

__all__ = [
    "AcquisitionStoppedError",
    "Announced",
    "AskedOperator",
    "CheckFinding",
    "Control",
    "HandNeededError",
    "Left",
    "LiveStatistics",
    "Operator",
    "PatchNumbers",
    "Progress",
    "ShutterOperator",
    "Unattended",
    "acquire",
    "forget",
    "is_complete",
    "remaining",
    "repeated_units",
]
