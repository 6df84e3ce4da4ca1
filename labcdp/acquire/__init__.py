"""Acquisition: record what a plan asks for from a camera and a meter, and go on where it was broken off."""

from .operator import Operator
from .run import Progress, acquire, check_devices, remaining

__all__ = ["Operator", "Progress", "acquire", "check_devices", "remaining"]
