"""Regions that follow their objects from frame to frame."""

from .followed import NotFollowedError, TrackedRoi
from .methods import METHODS, Tracker, make_tracker, method_among, methods_of

__all__ = ["METHODS", "NotFollowedError", "TrackedRoi", "Tracker", "make_tracker", "method_among", "methods_of"]
