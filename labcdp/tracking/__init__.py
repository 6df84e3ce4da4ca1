"""Regions that follow their objects from frame to frame."""

from .methods import METHODS, Tracker, make_tracker, method_among, methods_of
from .template import NotFollowedError, TrackedRoi

__all__ = ["METHODS", "NotFollowedError", "TrackedRoi", "Tracker", "make_tracker", "method_among", "methods_of"]
