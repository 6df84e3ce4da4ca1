"""Acquisition: record the frames and readings of a plan, and resume it after an interruption."""

from .before import check_devices
from .checks import CheckFinding
from .control import AcquisitionStoppedError, Control, Progress
from .live import Live, PatchNumbers
from .operator import AskedOperator, HandNeededError, Operator, Unattended
from .recording.writer import FrameWriter
from .run import Left, acquire, is_complete
from .search import FoundExposures, PatchRate, choose_exposures
from .steps import Remaining, forget, remaining

__all__ = [
    "AcquisitionStoppedError",
    "AskedOperator",
    "CheckFinding",
    "Control",
    "FoundExposures",
    "FrameWriter",
    "HandNeededError",
    "Left",
    "Live",
    "Operator",
    "PatchNumbers",
    "PatchRate",
    "Progress",
    "Remaining",
    "Unattended",
    "acquire",
    "check_devices",
    "choose_exposures",
    "forget",
    "is_complete",
    "remaining",
]
