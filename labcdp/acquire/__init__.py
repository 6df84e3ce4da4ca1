"""Acquisition: record what a plan asks for from a camera and a meter, and go on where it was broken off."""

from .before import check_devices
from .checks import CheckFinding
from .control import AcquisitionStoppedError, Control
from .live import Live, PatchNumbers
from .operator import HandNeededError, Operator, Unattended
from .progress import Progress
from .run import Left, acquire, is_complete
from .search import FoundExposures, PatchRate, choose_exposures
from .steps import Remaining, remaining
from .writer import FrameWriter

__all__ = [
    "AcquisitionStoppedError",
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
    "is_complete",
    "remaining",
]
